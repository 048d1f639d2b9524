import numpy as np
import pytest

from radard.dsp.median import median


@pytest.mark.parametrize("n", [1, 2, 3, 4, 59, 60, 146, 147])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("level", [1e-38, 1.0, 1e38])
def test_to_the_bit_as_numpys(n, dtype, level):
    values = (np.random.default_rng(n).standard_normal((3, n)) * level).astype(dtype)
    with np.errstate(over="ignore"):
        wanted = np.median(values, axis=-1)
        found = median(values)
    assert found.dtype == dtype
    assert np.array_equal(found, wanted)


def test_equal_values_and_infinity():
    assert median(np.full(4, 2.5)) == 2.5
    assert median(np.array([1.0, np.inf, 2.0])) == 2.0
