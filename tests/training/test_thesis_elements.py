from dataclasses import replace

import numpy as np
import pytest

from radard.errors import UsageError
from x2train.thesis import sets
from x2train.thesis.cells import Cell
from x2train.thesis.elements import PROFILE, ElementSpec, element
from x2train.thesis.sets import load_cell, load_maps, make_bodies, rectify

pytestmark = pytest.mark.integration

SPEC = ElementSpec(dwell_s=1.0)
CELL = Cell(2, "dog", 60)


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(sets, "_SHARD", 3)


def make(folder, spec=SPEC, first=0, n=5, workers=1):
    for body in ("dog", "human"):
        told = []

        def tell(*now, told=told):
            told.append(now)

        make_bodies(folder, spec, body, first, n, workers=workers, tell=tell)
        assert told[-1] == (n, n)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"n_cpi": 1}, "M = 1: must be 2 to 120"),
        ({"n_cpi": 121}, "M = 121: must be 2 to 120, the columns of the record"),
        ({"n_cadence": 61}, "I alpha = 61: must be 1 to 60, half the columns"),
        ({"n_cadence": 0}, "I alpha = 0"),
        ({"frame_rate_hz": 0}, "frame rate 0: must be 1 to 1000"),
        ({"frame_rate_hz": 1001}, "frame rate 1001"),
        ({"dwell_s": 0.1}, "M = 28: must be 2 to 6"),
        ({"noise": "pink"}, "noise 'pink': must be one of input, printed"),
    ],
)
def test_what_makes_no_vector_is_refused(wrong, says):
    with pytest.raises(UsageError, match=says):
        ElementSpec(**wrong)


def test_an_element_follows_from_its_seed_body_and_number():
    one, again = element(SPEC, "cat", 7), element(SPEC, "cat", 7)
    np.testing.assert_array_equal(one.vector, again.vector)
    np.testing.assert_array_equal(one.range_time, again.range_time)
    others = [(SPEC, "cat", 8), (SPEC, "dog", 7), (replace(SPEC, seed=1), "cat", 7)]
    for other in others:
        assert not np.array_equal(one.vector, element(*other).vector)


def test_data_sets_alternate_and_do_not_depend_on_chunks_or_workers(tmp_path, monkeypatch):
    # Where linear algebra has several threads, as here, even one worker is a process.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    make(tmp_path / "a")
    whole = load_cell(tmp_path / "a", SPEC, CELL, 0, 10)
    assert whole.x.shape == (10, 1176)
    np.testing.assert_array_equal(whole.y, [0, 1] * 5)
    for k, body in ((4, "dog"), (5, "human")):
        np.testing.assert_allclose(whole.x[k], element(SPEC, body, 2).vector, atol=1e-6)
    monkeypatch.setattr(sets, "_SHARD", 2)
    make(tmp_path / "b", workers=2)
    other = load_cell(tmp_path / "b", SPEC, CELL, 0, 10)
    np.testing.assert_array_equal(whole.x, other.x)
    np.testing.assert_array_equal(whole.in_view, other.in_view)


def test_maps_are_kept_to_a_level(tmp_path):
    make(tmp_path)
    maps, data = load_maps(tmp_path, SPEC, CELL, 0, 10)
    wanted = element(SPEC, "human", 1)
    assert np.abs(maps["mu"][3] - wanted.mu).max() <= 0.5 / 255 + 1e-6
    assert np.abs(maps["range_time"][3] - wanted.range_time).max() <= 0.5 / 255 + 1e-6
    assert data.in_view[3] == np.float32(wanted.in_view)


def test_rectified_profiles_have_their_peak_on_the_left():
    x = np.zeros((3, 1176), np.float32)
    x[0, :5] = [0.2, 0, 0.3, 1, 0.5]
    x[1, :5] = [0.2, 1, 0.3, 0, 0.5]
    x[:, PROFILE:] = np.linspace(0, 1, 784)
    out = rectify(x)
    np.testing.assert_array_equal(out[0, :5], x[0, 4::-1])
    np.testing.assert_array_equal(out[1:], x[1:])
    np.testing.assert_array_equal(out[:, PROFILE:], x[:, PROFILE:])
