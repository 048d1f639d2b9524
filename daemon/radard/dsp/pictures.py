"""Pictures: frames to columns as bytes on a dB scale, for dashboard and clips to draw.

Three share their columns of time: range, velocity (its aliases fade, see `Unfolding`) and Doppler
(mu). A fourth, gait, is the cadence velocity diagram of the last two seconds.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radard.dsp.cadence import cadence_velocity_diagram
from radard.dsp.columns import SharedSteps
from radard.dsp.doppler import StreamingDoppler
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S, VelocityTransform
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

Bytes = NDArray[np.uint8]
Reals = NDArray[np.float64]

COLUMN_RATE_HZ = 15.0  # a step of a person is some seven columns
GAIT_S = 2.0  # some four steps of a person
SPANS_DB = {"range": 30.0, "velocity": 11.0, "doppler": 26.0, "gait": 20.0}
"""From dark to bright. Aliases of fast bodies lie 7 to 9 dB under the true velocity."""
_MAX_BINS = 256  # above the rows of any picture
_MAX_ROWS = 96  # as many as a page's picture shows
_CELLS_M = (0.05, 0.1, 0.2, 0.5, 1.0)  # the first that gives so few rows
_QUIET_SHARE = 0.3  # a body fills less than the other share of a column
_DIM_DB = 4.0  # peaks of the noise should not look like motion
_RISE_DB_PER_S, _FALL_DB_PER_S = 0.5, 12.0  # a body that stays is not learned as noise
_TINY = 1e-300  # for log10 of zero
_LAGS = (0, 2, 4, 6, 8)  # columns: half a second, in which a body hardly changes its speed
_SHARPNESS = 1.5  # strong cells count for more: the trunk, not the limbs
_NOTCH = 2  # rows beside zero that the removed mean takes along
_LINE_WEIGHT, _FADE = 2.0, 2.0  # of lines beside power, and of what is then less likely


@dataclass(frozen=True, slots=True)
class Picture:
    """The rows of a picture: unit, value of row 0, and step from one row to the next."""

    name: str  # range, velocity, doppler or gait
    unit: str
    first: float
    step: float
    n_rows: int


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """New columns of the pictures; `t_s` is stream time of the middle of the last one's CPI.

    `valid`, shape (n,), is False where a lost frame touches a column; `values` are by picture,
    shape (n_rows, n). 255 is the strongest cell of the column, or the span (`SPANS_DB`) and 4 dB
    above the noise where nothing is as strong; 0 is the span below it.
    """

    t_s: float
    valid: NDArray[np.bool_]
    values: dict[str, Bytes]


class Unfolding:
    """Fade the aliases, `apart_mps` apart, in the velocity picture of one stream.

    Each velocity gets the energy of all straight lines of its slope in the last half second of the
    range picture; a band of the velocity picture, of even rows `velocity_mps`, fades by what
    speaks more for an alias. 1 m/s crosses `cells_per_mps` of the `n_ranges` rows of the range
    picture from column to column.
    """

    def __init__(
        self,
        velocity_mps: NDArray[np.float64],
        apart_mps: float,
        n_ranges: int,
        cells_per_mps: float,
    ) -> None:
        moved = velocity_mps[:, None] * np.array(_LAGS) * cells_per_mps
        at = np.rint(np.arange(n_ranges) + moved.T[:, :, None]).astype(np.intp)
        # What lies outside is the row of zeros behind the last.
        self._lines = np.where((at >= 0) & (at < n_ranges), at, n_ranges)
        rows = np.arange(len(velocity_mps))
        step = velocity_mps[1] - velocity_mps[0]
        n_folds = int((velocity_mps[-1] - velocity_mps[0]) / apart_mps)
        self._folds = [rows + k * apart_mps / step for k in range(-n_folds, n_folds + 1) if k]
        self._bytes_per_db = 255 / SPANS_DB["velocity"]
        self._trail = np.zeros((n_ranges + 1, _LAGS[-1]), np.float32)

    def unfold(self, velocities: Bytes, ranges: Bytes) -> Bytes:
        """Return new columns of the velocity picture, given those of the range picture."""
        n = velocities.shape[1]
        new = np.vstack([(ranges / np.float32(255)) ** _SHARPNESS, np.zeros((1, n), np.float32)])
        seen = np.hstack([self._trail, new.astype(np.float32)])
        self._trail = seen[:, -_LAGS[-1] :]
        lines = sum(
            seen[at, _LAGS[-1] - lag : _LAGS[-1] - lag + n]
            for at, lag in zip(self._lines, _LAGS, strict=True)
        )
        energy = np.einsum("vrn,vrn->vn", lines, lines)
        # As strong as its neighbours: who stands still has a notch at zero, not at its aliases.
        padded = np.pad(velocities, ((_NOTCH, _NOTCH), (0, 0)))
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NOTCH + 1, axis=0)
        likely_db = near.max(axis=2) / self._bytes_per_db + 10 * _LINE_WEIGHT * np.log10(
            np.maximum(energy, 1e-9)
        )
        best_db = likely_db.copy()
        rows = np.arange(len(velocities))
        for fold in self._folds:
            for k in range(n):
                other = np.interp(fold, rows, likely_db[:, k], left=-np.inf, right=-np.inf)
                np.maximum(best_db[:, k], other, out=best_db[:, k])
        faded = velocities - _FADE * self._bytes_per_db * (best_db - likely_db)
        return np.asarray(np.clip(faded, 0, 255), np.uint8)


class Spectrograms:
    """Make pictures of one stream of baseband frames.

    `pictures` are their axes, gait last; columns are `column_s` seconds apart, and `push` takes at
    most `longest_push` frames at once. Speeds `unambiguous_mps` apart, c fp / (2 f), look alike.
    Of more than 256 bins only every second, third and so on is used: the matched filter has made
    neighbours alike, and the pictures have fewer rows than that.
    """

    def __init__(self, axis: FastTimeAxis, frame_rate_hz: float) -> None:
        self._thin = -(-axis.n_range // _MAX_BINS)
        n_range = -(-axis.n_range // self._thin)
        bin_m = axis.bin_length_m * self._thin
        self._axis = replace(axis, n_range=n_range, bin_length_m=bin_m)
        self._rate_hz = frame_rate_hz
        self._stride = max(1, round(frame_rate_hz / COLUMN_RATE_HZ))
        self.column_s = self._stride / frame_rate_hz
        self._n_cpi = n_cpi = max(4, round(CPI_S * frame_rate_hz))
        length_m = n_range * bin_m
        usual_m = (c for c in _CELLS_M if length_m / c <= _MAX_ROWS)
        self._cell_m = next(usual_m, length_m / _MAX_ROWS)
        self._n_gait = round(GAIT_S / self.column_s)
        self.gait_step_hz = 1 / (self._n_gait * self.column_s)  # from column to column of gait
        self.longest_push = max(64, n_cpi)
        self._floors_db: dict[str, float] = {}  # noise of the pictures
        self.restart()
        step_mps = frame_rate_hz / n_cpi * (SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz))
        lowest_mps = -(n_cpi // 2) * step_mps
        r, v = self._ranges.range_m, self._velocity.velocity_mps
        self.pictures = (
            Picture("range", "m", float(r[0]), self._cell_m, len(r)),
            Picture("velocity", "m/s", float(v[0]), float(v[1] - v[0]), len(v)),
            Picture("doppler", "m/s", lowest_mps, step_mps, n_cpi),
            Picture("gait", "m/s", lowest_mps, step_mps, n_cpi),
        )

    def restart(self) -> None:
        """Forget the frames so far, as after a jump of the stream; the floors are kept."""
        axis, rate_hz, n_cpi, stride = self._axis, self._rate_hz, self._n_cpi, self._stride
        n_keep = 2 * self.longest_push
        self._ranges = RangeTimeMap(axis, n_cpi, cell_m=self._cell_m, n_keep=n_keep + stride)
        self._velocity = VelocityTransform(
            axis, rate_hz, column_rate_hz=COLUMN_RATE_HZ, n_keep=n_keep
        )
        self._doppler = StreamingDoppler(n_cpi, stride=stride, n_keep=max(self._n_gait, n_keep))
        self._shared = SharedSteps(self._ranges, self._velocity, self._doppler)
        self.unambiguous_mps = rate_hz * (SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz))
        n_ranges, cells_per_mps = len(self._ranges.range_m), self.column_s / self._cell_m
        v = self._velocity.velocity_mps
        self._unfolding = Unfolding(v, self.unambiguous_mps, n_ranges, cells_per_mps)
        self._n_seen = 0

    def push(
        self, frames: NDArray[np.complex64], valid: NDArray[np.bool_], t_s: float
    ) -> Columns | None:
        """Take (n, n_range) frames, `t_s` behind the last; return the columns they complete."""
        n = self._shared.push(frames[:, :: self._thin], valid)
        self._n_seen += len(frames)
        if n < 1:
            return None
        behind = (self._n_seen - self._n_cpi) % self._stride
        power = {
            "range": self._range_columns(n, behind),
            "velocity": self._velocity.columns(n),
            "doppler": self._doppler.columns(n),
        }
        values = {name: self._shown(name, p, n * self.column_s) for name, p in power.items()}
        values["velocity"] = self._unfolding.unfold(values["velocity"], values["range"])
        end_s = t_s - behind / self._rate_hz - self._n_cpi / 2 / self._rate_hz
        return Columns(end_s, self._velocity.columns_valid(n), values)

    def gait(self) -> Bytes | None:
        """Return the gait picture, shape (n_doppler, n_cadence), uint8; None before it is due."""
        if self._doppler.n_columns < self._n_gait:
            return None
        spectrogram = self._doppler.columns(self._n_gait).astype(np.float32)
        diagram = cadence_velocity_diagram(spectrogram)[:, : self._n_gait // 2]
        power = diagram.astype(np.float64) ** 2
        power[:, 0] = 0
        return self._shown("gait", power, GAIT_S / 2)

    def _range_columns(self, n: int, behind: int) -> Reals:
        """Return range columns at the same frames as the others: means over each stride."""
        have = self._ranges.n_columns
        columns = self._ranges.columns(min(have, (n - 1) * self._stride + behind + 1))
        ends = columns.shape[1] - behind - 1 - self._stride * np.arange(n)[::-1]
        # A column's own frame and those on the way to the one before it.
        starts = np.maximum(ends - self._stride + 1, 0)
        total = np.concatenate([np.zeros((len(columns), 1)), columns.cumsum(axis=1)], axis=1)
        return np.asarray((total[:, ends + 1] - total[:, starts]) / (ends + 1 - starts))

    def _shown(self, name: str, power: Reals, elapsed_s: float) -> Bytes:
        level_db = 10 * np.log10(np.maximum(power, _TINY))
        known = level_db[level_db > -2000]
        if not known.size:
            return np.zeros(power.shape, np.uint8)
        span_db = SPANS_DB[name]
        # The noise falls quickly and rises slowly, so no body becomes noise.
        quiet_db = float(np.quantile(known, _QUIET_SHARE))
        before_db = self._floors_db.get(name, quiet_db)
        low, high = -_FALL_DB_PER_S * elapsed_s, _RISE_DB_PER_S * elapsed_s
        floor_db = self._floors_db[name] = before_db + min(max(quiet_db - before_db, low), high)
        weakest_db = floor_db + span_db + _DIM_DB
        top_db = np.maximum(level_db.max(axis=0), weakest_db)
        share = 1 + (level_db - top_db) / span_db
        return np.asarray(np.clip(share * 255, 0, 255), np.uint8)
