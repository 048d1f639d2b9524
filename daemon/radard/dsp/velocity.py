"""Wideband velocity transform: power by velocity and time, aliases suppressed.

With X(f, t) the DFT over range of frame t, f absolute (carrier and baseband frequency), and w a
taper about the column's time t0: P(v, t0) = sum_f |sum_t w(t - t0) X(f, t) exp(-j 4 pi f v (t -
t0) / c)|^2. Every f has its own aliases, v + c fp / (2 f), so they smear over velocity in
proportion to band over carrier, while the true velocity stays one line at any range walk (related:
the keystone transform; Perry, DiPietro and Fante 1999, recalled). The mean over each CPI is taken
off on steps, before the DFT: static clutter is gone exactly (`radard.dsp.columns`).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.dsp.columns import ColumnStore, ColumnStream, Flags, Reals, StepBuffer, whole
from radard.dsp.doppler import centring, gaussian_taper
from radard.errors import FeatureError
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

CPI_S = 28 / 60  # the thesis' CPI: 28 frames at 60 Hz (2.29)
_MIN_CPI = 4  # frames: fewer show no Doppler beside the removed mean
_FLATTEN = 1.5  # see `VelocityTransform`
_BLOCK = 64  # frames at once: a hop at 60 Hz
_LOW, _HIGH = 1e-15, 1e15  # of parts: their squares stay well inside float32
_REACH = 1.3 / 2.3  # of the -10 dB band, to either side: beyond it is noise
_MAX_FREQUENCIES = 64
_UNKNOWN_BANDWIDTH = 0.2  # of the carrier: less than any module's


def range_frequencies(axis: FastTimeAxis) -> Reals:
    """Return the absolute frequencies at which a stream's frames are looked at, in hertz.

    Shape (n_freq,), float64: around the carrier, ascending, over 1.13 of the -10 dB band as far as
    the bins sample it, c / (2 swath) apart or a multiple of it to stay within 64. An unknown
    bandwidth is taken for a fifth of the carrier. Raises FeatureError without a carrier or bins.
    """
    if axis.carrier_hz <= 0 or axis.bin_length_m <= 0:
        msg = f"no frequencies: carrier {axis.carrier_hz:g} Hz, bins of {axis.bin_length_m:g} m"
        raise FeatureError(msg)
    bandwidth_hz = axis.bandwidth_hz or _UNKNOWN_BANDWIDTH * axis.carrier_hz
    sampled_hz = SPEED_OF_LIGHT_MPS / (2 * axis.bin_length_m)
    reach_hz = min(_REACH * bandwidth_hz, 0.49 * sampled_hz)
    spacing_hz = sampled_hz / axis.n_range
    n_side = int(reach_hz / spacing_hz)
    thin = -(-(2 * n_side + 1) // _MAX_FREQUENCIES)
    n_side //= thin
    return np.asarray(axis.carrier_hz + np.arange(-n_side, n_side + 1) * (thin * spacing_hz))


def range_dft(axis: FastTimeAxis, frequency_hz: Reals, flatten: float) -> NDArray[np.complex128]:
    """Return the DFT over range, and the weights of the frequencies, as one matrix.

    Shape (n_range, n_freq), complex128: frames times this are X. `flatten` is the exponent of the
    pulse's amplitude spectrum (one at the carrier) that is divided out, where the bandwidth is
    known. With 0, the squares' sum over the sampled band is the bins' power (Parseval).
    """
    delay_s = 2 * axis.bin_length_m / SPEED_OF_LIGHT_MPS
    baseband_hz = frequency_hz - axis.carrier_hz
    spacing_hz = np.ptp(frequency_hz) / max(len(frequency_hz) - 1, 1) or 1 / delay_s
    weight = np.full(len(frequency_hz), np.sqrt(delay_s * spacing_hz))
    if axis.bandwidth_hz > 0:
        # -10 dB at half the bandwidth.
        weight *= 10 ** (0.5 * flatten * (2 * baseband_hz / axis.bandwidth_hz) ** 2)
    turns = np.outer(np.arange(axis.n_range) * delay_s, baseband_hz)
    return np.asarray(np.exp(-2j * np.pi * (turns % 1.0)) * weight)


class FrameMeans:
    """Steps of a stream in, steps between the means of `n_mean` frames out; 1 changes nothing.

    Slow motion needs few frames a second; means keep the noise down as all frames would, and what
    is too fast for the lower rate is weaker before it folds (at half that rate 3 to 4 dB). With
    s_m the step from frame m - 1 to m, and y_k the mean of the frames from k n on::

        y_k - y_(k-1) = (1 / n) sum_i (n - |i|) s_(k n + i),   |i| < n
    """

    def __init__(self, n_mean: int) -> None:
        self._n_mean = n_mean
        self._weights = ((n_mean - np.abs(np.arange(1 - n_mean, n_mean))) / n_mean).astype("f4")
        self._steps: NDArray[np.complex64] | None = None
        self._flags = np.ones(n_mean - 1, np.bool_)

    def add(
        self, steps: NDArray[np.complex64], flags: Flags
    ) -> tuple[NDArray[np.complex64], Flags]:
        """Take steps, (n, n_freq), and their frames' flags; return the steps that are whole."""
        n = self._n_mean
        if n == 1:
            return steps, flags
        if self._steps is None:
            # Nothing moved before the first frame.
            self._steps = np.zeros((n - 1, steps.shape[1]), np.complex64)
        waiting = np.concatenate([self._steps, steps])
        good = np.concatenate([self._flags, flags])
        n_out = max(0, (len(waiting) - n + 1) // n)
        out = np.zeros((n_out, steps.shape[1]), np.complex64)
        for i, weight in enumerate(self._weights):
            out += weight * waiting[i : i + n_out * n : n]
        means = np.asarray(good[n - 1 : n - 1 + n_out * n].reshape(n_out, n).all(axis=1), np.bool_)
        self._steps, self._flags = waiting[n_out * n :], good[n_out * n :]
        return out, means


class VelocityTransform(ColumnStream):
    """Velocity-time map of a stream of baseband frames, phase falling with range.

    The grid `velocity_mps` reaches from minus to plus `max_mps`, approaching positive, with 0 in
    it; a CPI of 0.47 s resolves 0.07 m/s. Columns lie `stride` whole frames apart,
    `column_rate_hz` a second, as near as may be to the rate that is asked for; a CPI has at least
    four frames. `n_mean` frames in a row are one (`FrameMeans`): CPI, stride and columns count
    these. Amplitudes: 1e-36 to 1e33.

    The pulse's amplitude spectrum to the power `_FLATTEN` is divided out of X. Behind a matched
    filter, 0 would leave its narrow band, 1 makes the noise white again, 2 the echo's spectrum
    flat. With 1.5 the strongest alias of one point of an X2, in CPIs of 0.47 s at 0.6 to 3.6 m/s,
    is 6.5 to 7.4 dB down at 60 Hz and 3.2 to 4.6 at 30 (measured; 8.1 to 8.6 and 4.6 to 5.5 with
    2), for 3.1 dB of signal to white noise (computed; 5.0 with 2).
    """

    def __init__(
        self,
        axis: FastTimeAxis,
        frame_rate_hz: float,
        *,
        max_mps: float = 5.0,
        step_mps: float = 0.1,
        cpi_s: float = CPI_S,
        column_rate_hz: float = 30.0,
        n_keep: int = 256,
        n_mean: int = 1,
    ) -> None:
        settings = (frame_rate_hz, step_mps, cpi_s, column_rate_hz)
        if not all(0 < value < np.inf for value in settings) or not step_mps <= max_mps < np.inf:
            raise FeatureError(
                "velocity transform: frame rate, steps and times must be above zero, and the "
                f"grid must hold a step; got {settings} and {max_mps} m/s"
            )
        rate_hz = frame_rate_hz / n_mean
        self.n_cpi = max(_MIN_CPI, round(cpi_s * rate_hz))
        self.stride = max(1, round(rate_hz / column_rate_hz))
        self.column_rate_hz = rate_hz / self.stride
        n_side = int(max_mps / step_mps + 1e-9)
        self.frequency_hz, self.velocity_mps, *self._lines = _design(
            axis, rate_hz, grid=(n_side, step_mps), n_cpi=self.n_cpi
        )
        self._dft = _planar_dft(axis)
        n_block = max(_BLOCK, self.n_cpi)
        super().__init__(0, n_block, n_keep, len(self.velocity_mps))
        self._means = FrameMeans(n_mean)
        self._spectra = ColumnStore(self.n_cpi + self.stride + n_block)
        self._n_seen = 0

    def advance(self, steps: StepBuffer, n_new: int) -> int:
        """Make the columns that the newest `n_new` frames complete, by their spectra."""
        planar, n_freq = steps.product(self._dft, n_new), len(self.frequency_hz)
        spectra = np.empty((n_new, n_freq), np.complex64)
        spectra.real, spectra.imag = planar[:, :n_freq], planar[:, n_freq:]
        spectra, flags = self._means.add(spectra, steps.flags(n_new))
        n_new = len(spectra)
        self._spectra.append(spectra, flags)
        self._n_seen += n_new
        earliest = max(0, self._n_seen - n_new - self.n_cpi + 1)
        first = -(-earliest // self.stride) * self.stride
        n_columns = (self._n_seen - self.n_cpi - first) // self.stride + 1
        if n_columns < 1:
            return 0
        rows, good = self._spectra.last(self._n_seen - first)
        odd, even = self._lines
        width = self.n_cpi - 1
        power = _powers(rows[1:], odd, even, n=n_columns, stride=self.stride, width=width)
        self._store.append(power, whole(good, self.n_cpi, self.stride))
        return n_columns


@lru_cache(maxsize=24)
def _design(
    axis: FastTimeAxis, frame_rate_hz: float, *, grid: tuple[int, float], n_cpi: int
) -> tuple[Reals, Reals, NDArray[np.float32], NDArray[np.float32]]:
    """Return frequencies, velocities and lines, read-only: they cost more than a dwell's columns.

    The operator that leads from the steps of a CPI to a velocity is C + j S, that of the opposite
    velocity C - j S. C is odd and S even about the middle of the CPI, so half of either is kept,
    shape (n_freq, n_side + 1, (n_cpi + 1) // 2) from velocity 0 up.
    """
    n_side, step_mps = grid
    frequency_hz = range_frequencies(axis)
    velocity_mps = np.arange(-n_side, n_side + 1, dtype=np.float64) * step_mps
    time_s = (np.arange(n_cpi) - (n_cpi - 1) / 2) / frame_rate_hz
    doppler_hz = 2 / SPEED_OF_LIGHT_MPS * np.multiply.outer(frequency_hz, velocity_mps[n_side:])
    turns = np.multiply.outer(doppler_hz, time_s) % 1.0
    operator = (np.exp(-2j * np.pi * turns) * gaussian_taper(n_cpi)) @ centring(n_cpi)
    half = operator[..., : n_cpi // 2].copy()
    if n_cpi % 2 == 0:
        # The step in the middle is its own partner.
        half[..., -1] /= 2
    odd, even = half.real.astype(np.float32), half.imag.astype(np.float32)
    for array in (frequency_hz, velocity_mps, odd, even):
        array.flags.writeable = False
    return frequency_hz, velocity_mps, odd, even


@lru_cache(maxsize=8)
def _planar_dft(axis: FastTimeAxis) -> NDArray[np.float32]:
    """Return planar steps to planar spectra, [[C S], [-S C]]; one object for all maps."""
    dft = range_dft(axis, range_frequencies(axis), _FLATTEN)
    planar = np.block([[dft.real, dft.imag], [-dft.imag, dft.real]]).astype(np.float32)
    planar.flags.writeable = False
    return planar


def _powers(
    rows: NDArray[np.complex64],
    odd: NDArray[np.float32],
    even: NDArray[np.float32],
    *,
    n: int,
    stride: int,
    width: int,
) -> Reals:
    n_freq, _, n_half = odd.shape
    by_frequency = np.ascontiguousarray(rows.T)
    s0, s1 = by_frequency.strides
    # Views, which numpy's own functions take longer to make than the sums below.
    shape, last = (n_freq, n_half, n), (width - 1) * s1
    front = np.ndarray(shape, np.complex64, by_frequency, 0, (s0, s1, stride * s1))
    back = np.ndarray(shape, np.complex64, by_frequency, last, (s0, -s1, stride * s1))
    # C x and S x of the real and the imaginary part: both velocities' lines are made of them.
    apart, together = np.empty((2, n_freq, n_half, 2 * n), np.float32)
    np.subtract(front.real, back.real, out=apart[..., :n])
    np.subtract(front.imag, back.imag, out=apart[..., n:])
    np.add(front.imag, back.imag, out=together[..., :n])
    np.add(front.real, back.real, out=together[..., n:])
    np.negative(together[..., n:], out=together[..., n:])
    # Squares are taken in float32; a column too strong or weak for that is scaled.
    level = np.maximum(np.abs(rows.real).max(axis=1), np.abs(rows.imag).max(axis=1))
    s1 = level.strides[0]
    peak = np.ndarray((n, width), np.float32, level, 0, (stride * s1, s1)).max(axis=1)
    extreme = ((peak < _LOW) & (peak > 0)) | (peak > _HIGH)
    exponent = np.where(extreme, np.frexp(peak)[1], 0)
    if extreme.any():
        for parts in (apart, together):
            np.ldexp(parts, np.tile(-exponent, 2), out=parts)
    falling, rising = odd @ apart, even @ together
    approaching = _sum_of_squares(falling - rising, n)
    falling += rising
    receding = _sum_of_squares(falling, n)
    power = np.concatenate([receding[:0:-1], approaching]).T.astype(np.float64)
    return np.asarray(np.ldexp(power, 2 * exponent[:, None]))


def _sum_of_squares(lines: NDArray[np.float32], n: int) -> NDArray[np.float32]:
    flat = lines.reshape(len(lines), -1)
    both = np.einsum("fy,fy->y", flat, flat).reshape(-1, 2, n)
    return np.asarray(both.sum(axis=1))
