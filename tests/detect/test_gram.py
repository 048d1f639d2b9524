import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp import gram as module
from radard.dsp.gram import (
    GramMap,
    centring,
    checked_taper,
    extend,
    gaussian_taper,
    gram,
    gram_map,
    step_operator,
)
from radard.errors import FeatureError
from tests.dsp_helpers import error, under_clutter
from tests.dsp_reference import micro_doppler_direct
from tests.radar_helpers import noise


def planar(steps):
    return np.concatenate([steps.real, steps.imag], axis=1).astype(np.float32)


def hermitian(q):
    """The complex Gram matrix that a square of reals stands for."""
    even = np.tril(q) + np.tril(q, -1).T
    odd = np.triu(q, 1)
    return even + 1j * (odd - odd.T)


def exact(rows, band=None):
    n = rows.shape[1] // 2
    steps = rows[:, :n].astype(np.float64) + 1j * rows[:, n:]
    if band is not None:
        steps = steps[:, slice(*band)]
    return steps @ steps.conj().T


@pytest.mark.parametrize("band", [(0, 40), (3, 4), (0, 1), (10, 39)])
def test_gram_holds_the_hermitian_matrix(band):
    rows = planar(noise(30, 40))
    assert error(hermitian(gram(rows, band)), exact(rows, band)) < 3e-7


@pytest.mark.parametrize("level", [1e-44, 1e-38, 1e-25, 1e-13, 1.0, 1e15, 1e30, 1e37])
def test_gram_at_any_level(level):
    rows = (planar(noise(20, 8)).astype(np.float64) * level).astype(np.float32)
    assert error(hermitian(gram(rows, (0, 8))), exact(rows)) < 1e-6


def test_a_spike_takes_nothing_from_its_neighbours():
    rows = planar(noise(20, 8))
    spiked = rows.copy()
    spiked[7] *= np.float32(1e32)
    others = np.arange(20) != 7
    ours = hermitian(gram(spiked, (0, 8)))
    assert np.isfinite(ours).all()
    assert error(ours[np.ix_(others, others)], exact(rows)[np.ix_(others, others)]) < 1e-6


def test_rows_of_zeros():
    rows = planar(noise(12, 8))
    rows[[0, 5, 6]] = 0
    ours = hermitian(gram(rows, (0, 8)))
    assert error(ours, exact(rows)) < 3e-7
    assert not ours[5].any()
    assert not gram(np.zeros((4, 6), np.float32), (0, 3)).any()


@pytest.mark.parametrize("clutter_db", [80, 90, 95, 100, 110])
def test_energies_of_whole_quanta_are_not_rounded_one_way(clutter_db):
    # Squares of odd multiples of a quantum are 1 modulo 8 of its square: long chains of
    # float32 additions round them all down.
    rows = planar(np.diff(under_clutter(noise(40, 768), clutter_db), axis=0))
    bias = gram(rows, (0, 768)).diagonal() / exact(rows).real.diagonal() - 1
    assert abs(bias.mean()) < 2e-7


def test_one_more_step_is_the_same_matrix():
    rows = planar(noise(9, 33))
    for band in ((0, 33), (5, 20)):
        ours = extend(gram(rows[:-1], band), rows, band)
        assert error(ours, gram(rows, band)) < 3e-7
    assert extend(np.zeros((0, 0)), rows[:1], (0, 33)).shape == (1, 1)


@pytest.mark.parametrize("level", [0.0, 1e-30, 1e30])
def test_one_more_step_of_no_common_level_is_left_to_gram(level):
    rows = planar(noise(6, 8))
    first, last = rows.copy(), rows.copy()
    first[2] *= np.float32(level)
    last[-1] *= np.float32(level)
    for r in (first, last):
        assert extend(gram(r[:-1], (0, 8)), r, (0, 8)) is None


@pytest.mark.parametrize("n_cpi", [2, 3, 4, 27, 28, 64, 127, 128, 129, 160])
def test_map_is_the_quadratic_form(n_cpi):
    taper = np.random.default_rng(n_cpi).random(n_cpi)
    n, stride = 3, 2
    rows = planar(noise(n_cpi - 1 + stride * (n - 1), 5))
    ours = GramMap(taper).columns(gram(rows, (0, 5)), n, stride)
    b = step_operator(taper)
    c = exact(rows)
    for k in range(n):
        part = slice(stride * k, stride * k + n_cpi - 1)
        wanted = (b @ c[part, part] @ b.conj().T).diagonal().real
        assert error(ours[k], wanted) < 1e-6


def test_stored_and_made_weights_are_the_same(monkeypatch):
    q = gram(planar(noise(30, 5)), (0, 5))
    stored = GramMap(gaussian_taper(20)).columns(q, 12)
    monkeypatch.setattr(module, "_LARGEST_STORED", 0)
    assert error(GramMap(gaussian_taper(20)).columns(q, 12), stored) < 1e-13


def test_maps_are_kept():
    assert gram_map(gaussian_taper(11)) is gram_map(gaussian_taper(11))
    assert gram_map(gaussian_taper(11)) is not gram_map(np.ones(11))


@settings(deadline=None, derandomize=True, max_examples=30)
@given(n_cpi=st.integers(2, 40), seed=st.integers(0, 1000))
def test_operator_by_definition(n_cpi, seed):
    frames = noise(n_cpi, 6, seed=seed).astype(np.complex128)
    taper = np.random.default_rng(seed).random(n_cpi) - 0.3
    steps = np.diff(frames, axis=0)
    centred = frames - frames.mean(axis=0)
    assert np.allclose(centring(n_cpi) @ steps, centred)
    lines = step_operator(taper) @ steps
    wanted = micro_doppler_direct(frames, n_cpi, taper=taper)[:, 0]
    assert np.allclose((np.abs(lines) ** 2).sum(axis=1), wanted)


@pytest.mark.parametrize("n_cpi", [2, 3, 9, 28, 29, 64, 256])
def test_taper_is_one_tenth_at_both_ends(n_cpi):
    taper = gaussian_taper(n_cpi)
    assert taper[0] == pytest.approx(0.1, abs=1e-4)
    assert taper[-1] == pytest.approx(taper[0])
    assert taper.max() <= 1


@pytest.mark.parametrize(
    ("n_cpi", "taper"),
    [(1, None), (0, None), (4, np.ones(5)), (3, np.array([1, np.nan, 1])), (2, np.ones((2, 1)))],
)
def test_tapers_that_make_no_sense(n_cpi, taper):
    with pytest.raises(FeatureError, match=r"CPI|taper"):
        checked_taper(n_cpi, taper)
