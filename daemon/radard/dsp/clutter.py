"""What moves: power left after clutter removal, and the noise it must stand out from.

Every routine takes frames of any real or complex dtype, byte order and memory layout, in any
unit: they are scaled by a power of two first, which is exact, so that no square leaves
float32. Rows that are not finite count as lost. The receiver's noise is that of second differences
along slow time: static clutter and its drift are gone exactly or nearly.
"""

import numpy as np
from numpy.typing import NDArray

_SPIKE = 100.0  # 20 dB, see `spike_rows`
_LOW_QUANTILE = 0.1  # a target fills far less than nine tenths of the cells
# An exponential variable's quantile q lies at -ln(1 - q) of its mean.
_TO_MEAN = -1 / np.log1p(-_LOW_QUANTILE)
_SECOND_DIFFERENCE_GAIN = 6.0  # 1 + 4 + 1, of the power of white noise

AnyFrames = NDArray[np.inexact] | NDArray[np.integer]
Flags = NDArray[np.bool_]


def sound_rows(frames: AnyFrames, valid: Flags) -> tuple[NDArray[np.complex64], Flags, float]:
    """Return frames that arithmetic cannot stumble over, which are usable, and their scale.

    Rows are a C-contiguous copy, complex64, scaled so that the largest part of a usable one is in
    [1, 2): frames = scale * rows, with a power of two; 1 where all is zero. Usable are those that
    are `valid` and finite, shape (n_slow,); what is not finite repeats the usable row before it,
    see `repeat_usable`.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        rows = np.array(frames, np.complex64, order="C")
    parts = rows.view(np.float32)
    finite: Flags = np.asarray(np.isfinite(parts).all(axis=1))
    usable = valid & finite
    if not finite.all():
        repeat_usable(rows, usable, ~finite)
    peak = float(max(parts.max(initial=0), -parts.min(initial=0)))
    if peak == 0:
        return rows, usable, 1.0
    exponent = int(np.frexp(peak)[1]) - 1
    # Two steps: the reciprocal of a denormal is no float32.
    for step in (-exponent // 2, -exponent - (-exponent // 2)):
        if step:
            parts *= np.float32(2.0**step)
    return rows, usable, 2.0**exponent


def repeat_usable(rows: NDArray[np.complex64], usable: Flags, where: Flags) -> None:
    """Let the rows at `where` repeat the usable row before them, in place; else zero."""
    good = np.flatnonzero(usable)
    if good.size == 0:
        rows[where] = 0
        return
    bad = np.flatnonzero(where)
    rows[bad] = rows[good[np.maximum(np.searchsorted(good, bad) - 1, 0)]]


def spike_rows(rows: NDArray[np.complex64], usable: Flags) -> Flags:
    """Return which rows of `sound_rows` are alone in what they show, shape (n_slow,).

    A spike's distance to either neighbour is 20 dB over the usual one and over that from neighbour
    to neighbour. All False for less than five usable rows.
    """
    spikes = np.zeros(len(rows), np.bool_)
    at = np.flatnonzero(usable)
    if at.size < 5:
        return spikes
    good = rows if at.size == len(rows) else rows[at]
    near = _distance(good, 1)
    far = _distance(good, 2)
    usual = float(np.median(near))
    before = np.concatenate((far[:1], near))
    after = np.concatenate((near, far[-1:]))
    across = np.concatenate((near[1:2], far, near[-2:-1]))
    apart = np.minimum(before, after)
    spikes[at] = apart > _SPIKE * np.maximum(usual, across)
    return spikes


def _distance(rows: NDArray[np.complex64], lag: int) -> NDArray[np.float32]:
    step = (rows[lag:] - rows[:-lag]).view(np.float32)
    return np.asarray(np.einsum("tn,tn->t", step, step))


def block_power(
    rows: NDArray[np.complex64], usable: Flags, n_cpi: int, n_parts: int
) -> tuple[NDArray[np.float64], Flags]:
    """Return the residual power of parts of CPIs, and which of the record's CPIs these are of.

    Clutter is the mean over one CPI, as in the spectrogram (2.29). The record, `rows` and `usable`
    of `sound_rows`, is cut into whole CPIs of `n_cpi` frames from its end, at least one, and these
    at `part_edges`. CPIs with fewer than half of their frames are left out. Power is the mean per
    frame, unbiased for noise, shape (n_cpis, n_parts, n_range), float64; zero in parts without a
    usable frame.
    """
    n_cpis = len(rows) // n_cpi
    used = n_cpis * n_cpi
    counts = usable[-used:].reshape(n_cpis, n_cpi)
    kept = counts.sum(axis=1) >= max(2, n_cpi / 2)
    is_whole = bool(counts.all())
    # Static clutter goes first, all of it but rounding, so that the sums are of what moves.
    moving = rows[-used:] - rows[int(np.argmax(usable))]
    parts = moving.view(np.float32).reshape(n_cpis, n_cpi, -1)
    if not is_whole:
        parts, counts = parts[kept], counts[kept]
        parts[~counts] = 0
    n_used = counts.sum(axis=1)
    # Sums of at most a CPI in float32, by matrix products: error below 1e-5 of the result.
    total = np.ones((1, n_cpi), np.float32) @ parts
    parts -= total / n_used[:, None, None].astype(np.float32)
    if not is_whole:
        parts[~counts] = 0
    np.square(parts, out=parts)
    part = np.searchsorted(part_edges(n_cpi, n_parts), np.arange(n_cpi), side="right") - 1
    member = np.arange(n_parts)[:, None] == part
    power = (member.astype(np.float32) @ parts).astype(np.float64)
    power = power[..., ::2] + power[..., 1::2]
    # (n - 1) / n of the noise is left when a mean over n was removed.
    left = (n_used - 1) / np.maximum(n_used, 1)
    power /= np.maximum((counts.astype(np.float64) @ member.T) * left[:, None], 0.5)[..., None]
    return power, kept


def part_edges(n_cpi: int, n_parts: int) -> NDArray[np.intp]:
    """Return the first frames of the parts of a CPI, shape (n_parts,)."""
    return np.asarray(-(-np.arange(n_parts) * n_cpi // n_parts), np.intp)


def centre_spread_m(
    power: NDArray[np.float64], noise: float, range_m: NDArray[np.float64]
) -> float:
    """Return how far the residual power's centre wanders, in metres; 0 when nothing stands out.

    Over the CPIs with at least a tenth of the strongest one's power, shape (n_cpis, n_range);
    cells below four times the noise do not count.
    """
    weight = np.maximum(power - 4 * noise, 0)
    total = weight.sum(axis=1)
    strong = total > 0.1 * total.max(initial=0)
    if not strong.any():
        return 0.0
    return float(np.ptp((weight[strong] @ range_m) / total[strong]))


def second_differences(rows: NDArray[np.complex64], usable: Flags) -> NDArray[np.float32]:
    """Return |y[t+1] - 2 y[t] + y[t-1]|^2 / 6 of `sound_rows`, float32, (n_triples, n_range)."""
    good = usable[2:] & usable[1:-1] & usable[:-2]
    step = rows[1:] - rows[:-1]
    second = step[1:] - step[:-1]
    if not good.all():
        second = second[good]
    parts = second.view(np.float32)
    parts *= np.float32(_SECOND_DIFFERENCE_GAIN**-0.5)
    np.square(parts, out=parts)
    return np.asarray(parts[:, ::2] + parts[:, 1::2])


def noise_of(cells: NDArray[np.float32]) -> float:
    """Return the noise power per live bin and frame of cells from `second_differences`.

    By their low quantile; NaN without cells, 0 where nothing changes at all.
    """
    if len(cells) == 0:
        return float("nan")
    live = cells.any(axis=0)
    if not live.all():
        cells = cells[:, live]
    if cells.size == 0:
        return 0.0
    flat = cells.ravel()
    k = int(_LOW_QUANTILE * (flat.size - 1))
    return float(np.partition(flat, k)[k] * _TO_MEAN)


def noise_profile(cells: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the noise power of every bin by itself, from cells of `second_differences`.

    Shape (n_range,), float64; NaN when there are no cells. It is the median over time, scaled to
    the mean of noise, with about 15 % of scatter for two seconds at 60 Hz.
    """
    if len(cells) == 0:
        return np.full(cells.shape[1], np.nan)
    k = (len(cells) - 1) // 2
    # Bins in rows: along the first axis it takes twice as long.
    middle = np.partition(np.ascontiguousarray(cells.T), k, axis=1)[:, k]
    return np.asarray(middle / np.log(2), np.float64)
