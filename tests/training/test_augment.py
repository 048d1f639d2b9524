"""Augmentation: other maps of the same bodies."""

import pytest
import torch

from x2train.sets.augment import _deeper, _kept, _noisier, _shifted, augmented

N, N_CELLS = 64, 40
SHAPES = ((101, N_CELLS), (80, N_CELLS), (61, 24), (81, 9))


def maps(seed=0, n=N):
    rng = torch.Generator().manual_seed(seed)
    made = [torch.rand(n, *shape, generator=rng) for shape in SHAPES]
    # Mostly empty, like the true ones.
    return [(m * (m > 0.6)).clamp(0, 1) for m in made]


def rng(seed=0):
    return torch.Generator().manual_seed(seed)


def test_shapes_and_range_stay_and_what_was_given_too():
    given, before = maps(), maps()
    for seed in range(5):
        made = augmented(*given, rng=rng(seed))
        for new, old in zip(made, given, strict=True):
            assert new.shape == old.shape
            assert new.dtype == torch.float32
            assert new.min() >= 0
            assert new.max() <= 1
    for old, same in zip(given, before, strict=True):
        assert torch.equal(old, same)
    assert len(augmented(*given[:2], rng=rng())) == 2


def test_who_loses_frames_within_has_no_whole_long_cpi():
    velocity, _, medium, long = augmented(*maps(), rng=rng(3))
    is_lost = _kept(torch.rand(N, 7, generator=rng(3))[:, 4:], N_CELLS)[1]
    assert 3 < is_lost.sum() < 20
    for each in (medium, long):
        assert torch.equal(each.flatten(1).any(1), ~is_lost)
    assert velocity.flatten(1).any(1).all()


def test_empty_maps_stay_empty():
    for made in augmented(*(torch.zeros(N, *shape) for shape in SHAPES), rng=rng()):
        assert not made.any()


def test_rows_in_which_nothing_was_shown_get_no_noise():
    ranges = maps()[1]
    ranges[:, 50:] = 0
    made = _noisier(ranges, torch.zeros(N) + 0.2, rng())
    assert not made[:, 50:].any()
    assert (made[:, :50] >= ranges[:, :50]).all()
    assert 0.28 < made[:, :50][ranges[:, :50] == 0].mean() < 0.32


@pytest.mark.parametrize(("u", "rows"), [(0.0, -12), (0.5, 0), (0.9999, 12)])
def test_shifting_moves_along_range_and_lets_nothing_in(u, rows):
    ranges = maps()[1]
    made = _shifted(ranges, torch.full((N,), u))
    if rows == 0:
        assert torch.equal(made, ranges)
    elif rows > 0:
        assert torch.equal(made[:, rows:], ranges[:, :-rows])
        assert not made[:, :rows].any()
    else:
        assert torch.equal(made[:, :rows], ranges[:, -rows:])
        assert not made[:, rows:].any()


def test_depth_keeps_the_reference_and_the_order():
    m = torch.linspace(0, 1, 41).repeat(3, 1, 1)
    made = _deeper(m, torch.tensor([0.0, 0.5, 1.0]))
    assert torch.equal(made[:, :, -1], torch.ones(3, 1))
    assert (made[:, :, 1:].diff(dim=2) >= 0).all()
    torch.testing.assert_close(1 - made[0, 0, 20], torch.tensor(0.5 * 0.8))
    torch.testing.assert_close(1 - made[2, 0, 20], torch.tensor(0.5 * 1.25))
    assert not made[:, :, 0].any()


@pytest.mark.parametrize(
    ("u", "gone"),
    [
        ((0.1, 1.0, 0.2), (0, 14)),
        ((0.1, 1.0, 0.8), (26, 40)),
        ((0.4, 1.0, 0.5), (19, 22)),
        ((0.9, 1.0, 0.5), (0, 0)),
    ],
)
def test_what_is_cut(u, gone):
    kept = _kept(torch.tensor([u]), N_CELLS)[0][0]
    assert kept.sum() == N_CELLS - (gone[1] - gone[0])
    assert not kept[gone[0] : gone[1]].any()
