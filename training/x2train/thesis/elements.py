"""Elements of the thesis' data sets: 2 s of spectrogram columns of one body, as it draws them.

Every element begins at t = 0 with new draws (table B.4) and lasts I + M - 1 frames: RF at 41 GS/s,
white noise of (2.13), down-conversion and matched filter (2.18, 2.19), then the daemon's own
features. The noise is the same at every frame rate, as in the thesis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.dsp.doppler import micro_doppler
from radard.dsp.downconvert import DownConverter
from radard.dsp.range_time import time_cells
from radard.errors import UsageError
from radard.judge.features import FeatureSettings, extract
from radard.judge.velocity_map import shown
from radard.stream.ring import Dwell, DwellShape
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, draw, ranges
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.signal.pulse import ROOM_K, LinkBudget

PROFILE = 392
BODIES = ("human", "dog", "cat")
CLUTTER = ((0.75, 3e4), (1.90, 6e4), (3.10, 4e5))  # range in metres, cross section (`clutter`)
_ERROR_DB = -120.0  # of echoes: float32's rounding
_LNA_GAIN = 10.0  # of (2.14)
_MU_DEPTH_DB = 30.0  # as the bundles' long maps have it
_AXIS = RadarSettings().axis
_CONVERTER = DownConverter(_AXIS)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementSpec:
    """What elements are drawn from."""

    frame_rate_hz: int = 60
    seed: int = 0  # every draw follows from it
    clutter: bool = False  # whether static echoes are added
    # 'input', 'printed': noise figure referred to the input, Te = TA + TRx; or the thesis' own
    # (2.12-2.14), whose receiver noise is divided by the gain that its signal is multiplied with
    noise: str = "input"
    # M and I alpha
    n_cpi: int = 28
    n_cadence: int = 28
    dwell_s: float = 2.0  # T

    def __post_init__(self) -> None:
        """Validate the settings."""
        if not 1 <= self.frame_rate_hz <= 1000:
            raise UsageError(f"frame rate {self.frame_rate_hz}: must be 1 to 1000 a second")
        columns = round(self.dwell_s * self.frame_rate_hz)
        if not 2 <= self.n_cpi <= columns:
            msg = f"M = {self.n_cpi}: must be 2 to {columns}, the columns of the record"
            raise UsageError(msg)
        if not 1 <= self.n_cadence <= columns // 2:
            msg = f"I alpha = {self.n_cadence}: must be 1 to {columns // 2}, half the columns"
            raise UsageError(msg)

    @property
    def shape(self) -> DwellShape:
        """Of the frames that make its columns."""
        return self.features.dwell_shape(1.0, self.frame_rate_hz)

    @property
    def features(self) -> FeatureSettings:
        """Settings of the daemon's features; the range-time map fits the swath."""
        return FeatureSettings(
            dwell_s=self.dwell_s,
            n_cpi=self.n_cpi,
            n_cadence=self.n_cadence,
            n_profile=PROFILE,
            near_m=0.6,
            far_m=3.4,
            cell_m=0.05,
        )

    @property
    def budget(self) -> LinkBudget:
        """Signal-to-noise ratio of table B.5."""
        if self.noise == "input":
            return LinkBudget()
        receiver_k = (LinkBudget().noise_figure - 1) * ROOM_K
        figure = (ROOM_K + receiver_k / _LNA_GAIN) / ROOM_K
        return LinkBudget(noise_figure=figure / _LNA_GAIN)


def scatterers(
    spec: ElementSpec, body: str, number: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], np.random.Generator]:
    """Return ranges, (n_slow, n_points), the torso first, and cross sections of an element."""
    rng = np.random.default_rng([spec.seed, BODIES.index(body), number])
    points = draw(THESIS_BODIES[f"thesis_{body}"], rng)
    return *ranges(points, np.arange(spec.shape.n_slow) / spec.frame_rate_hz), rng


def dwell(spec: ElementSpec, body: str, number: int) -> tuple[Dwell, float]:
    """Return one element's frames, and the share of them with its torso in the swath."""
    axis, budget, rate_hz = _AXIS, spec.budget, spec.frame_rate_hz
    range_m, rcs_m2, rng = scatterers(spec, body, number)
    n_slow = len(range_m)
    level = budget.amplitude(range_m, rcs_m2, axis)
    echo = echo_frames(range_m, level, axis, error_db=_ERROR_DB)
    if spec.clutter:
        still_m, rcs = np.array(CLUTTER).T
        level = budget.amplitude(still_m[None], rcs, axis)
        echo += echo_frames(still_m[None], level, axis, error_db=_ERROR_DB)
    noise = rng.standard_normal(echo.shape, np.float32)
    noise *= np.float32(budget.noise_sigma)
    frames = _CONVERTER.convert(echo + noise)
    low_m, high_m = axis.range_m[[0, -1]]
    in_view = (range_m[:, 0] > low_m) & (range_m[:, 0] < high_m)
    valid, t_s = np.ones(n_slow, np.bool_), n_slow / rate_hz
    return Dwell(frames, valid, _CONVERTER.axis, rate_hz, t_s), float(in_view.mean())


def element(spec: ElementSpec, body: str, number: int) -> dict[str, NDArray[np.float32]]:
    """Return one example of a set, see `dwell`: the thesis' vector, and maps of the same seconds.

    `vector` (Q2,) is type 2; type 1 is what follows on the first 392. `mu` (n_cpi, n_cells) is the
    spectrogram in decibels (`radard.judge.velocity_map.shown`) by time cells of 50 ms, and
    `range_time` (n_range_cells, n_cells) likewise the power of what moves by cells of 50 mm;
    `in_view` is the share of the time with the torso in the swath.
    """
    made, in_view = dwell(spec, body, number)
    settings, mu = spec.features, micro_doppler(made.frames, spec.n_cpi)
    features = extract(made, settings, ("thesis_type2", "range_time"))
    all_valid = np.ones(mu.shape[1], np.bool_)
    power, valid = time_cells(
        mu, all_valid, spec.frame_rate_hz, cell_s=settings.cell_s, n_cells=settings.n_cells
    )
    return {
        "vector": features["thesis_type2"],
        "mu": shown(power, valid, _MU_DEPTH_DB),
        "range_time": features["range_time"],
        "in_view": np.array(in_view, np.float32),
    }
