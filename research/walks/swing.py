"""What swings in a walk, and how much: spectra over the stretches that count."""

import numpy as np

from research.walks.follow import Array, Flags

STEP_HZ = (0.5, 2.5)
"""Where swinging is looked for: strides and steps of walks from 0.2 to 1.5 m/s."""
_SHORTEST_S = 3.0  # chosen: two strides
_N_FFT = 2048  # chosen: lines 0.015 Hz apart


def swing_rms(x: Array, counts: Flags, rate_hz: float) -> float:
    """Return the rms of what swings within `STEP_HZ`; see `swinging`."""
    frequency_hz, density = swinging(x, counts, rate_hz)
    part = (frequency_hz >= STEP_HZ[0]) & (frequency_hz <= STEP_HZ[1])
    return float(np.sqrt(density[part].sum() * frequency_hz[1]))


def swinging(x: Array, counts: Flags, rate_hz: float) -> tuple[Array, Array]:
    """Return the power spectrum of what swings, over all stretches that count.

    Frequencies are in hertz from 0, densities in squared units per hertz, one-sided, the line
    through each stretch taken off. Stretches shorter than 3 s are left out, unless all are.
    """
    total, weight = np.zeros(_N_FFT // 2 + 1), 0.0
    for bent in _without_lines(x, counts, rate_hz):
        taper = np.hanning(len(bent) + 2)[1:-1]
        spectrum = np.fft.rfft(bent * taper, _N_FFT)
        total += np.abs(spectrum) ** 2 * (len(bent) / (taper @ taper))
        weight += len(bent)
    return np.asarray(np.fft.rfftfreq(_N_FFT, 1 / rate_hz), np.float64), 2 * total / (
        weight * rate_hz
    )


def spread_about_lines(x: Array, counts: Flags, rate_hz: float) -> float:
    """Return the rms of what is left of the stretches that count without a line through each.

    A straight way past a radar has a range rate that changes steadily, and corners lie
    between stretches: neither is in it.
    """
    return float(np.sqrt(np.mean(np.concatenate(_without_lines(x, counts, rate_hz)) ** 2)))


def _without_lines(x: Array, counts: Flags, rate_hz: float) -> list[Array]:
    index = np.flatnonzero(counts)
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    long = [run for run in runs if len(run) >= _SHORTEST_S * rate_hz] or runs
    lines = [np.polynomial.Polynomial.fit(run, x[run], min(1, len(run) - 1)) for run in long]
    return [
        np.asarray(x[run] - line(run), np.float64) for run, line in zip(long, lines, strict=True)
    ]
