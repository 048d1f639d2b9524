"""Sites: a radar, its room and its receiver, drawn for training and for judging.

One distribution serves all classes. The room of kind 'unseen' is built otherwise than those
of training: two walls and a ceiling, clutter that falls by a power law, a mount at the
ceiling that looks steeply down.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from x2radar.frame import FastTimeAxis, StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.place.antenna import Antenna, Surface, TailSettings
from x2radar.sim.place.room import RoomSettings
from x2radar.sim.signal.receiver import ReceiverEffects

SAMPLE_RATE_HZ = 41e9  # of the X2; it sets the level of the noise of all radars here
RoomKind = Literal["usual", "unseen"]
RadarKind = Literal["any", "x2", "x4m03"]


@dataclass(frozen=True, slots=True)
class Radar:
    """A radar behind its matched filter, most decimated in range, as the maps need it."""

    name: str
    # of the pulse; bandwidth at -10 dB
    carrier_hz: float
    bandwidth_hz: float
    bin_length_m: float  # as the frames come
    # swath
    near_m: float
    far_m: float
    frame_rate_hz: float

    def axis(self) -> FastTimeAxis:
        """Return the axis of its frames."""
        return FastTimeAxis(
            kind="baseband",
            n_range=round((self.far_m - self.near_m) / self.bin_length_m) + 1,
            bin_length_m=self.bin_length_m,
            range_offset_m=self.near_m,
            carrier_hz=self.carrier_hz,
            bandwidth_hz=self.bandwidth_hz,
            sample_rate_hz=SAMPLE_RATE_HZ,
        )

    def stream(self) -> StreamInfo:
        """Return what the daemon is told of its stream."""
        return StreamInfo(self.axis(), self.frame_rate_hz, self.name)


X2 = Radar("X2", 6.8e9, 2.3e9, 8 * 0.003656, 0.6, 3.4, 60.0)
X4M03 = Radar("X4M03", 7.29e9, 1.4e9, 0.0514, 0.4, 9.0, 60.0)
P4XX = Radar("P4xx", 4.0e9, 1.7e9, 3 * 0.009149, 0.5, 4.4, 30.5)
"""The three radars by their data sheets, the X2's bins eight and the P4xx's three together."""


_TABLE_B5 = RadarSettings(frame_rate_hz=60.0)
_AXIS = _TABLE_B5.axis
THESIS = Radar(
    name="X2 of the thesis",
    carrier_hz=_AXIS.carrier_hz,
    bandwidth_hz=_AXIS.bandwidth_hz,
    bin_length_m=_AXIS.bin_length_m,
    near_m=_AXIS.range_offset_m,
    far_m=_AXIS.range_offset_m + (_AXIS.n_range - 1) * _AXIS.bin_length_m,
    frame_rate_hz=_TABLE_B5.frame_rate_hz,
)
"""The X2 as table B.5 of the thesis has it, `X2` before the decimation: noise is the same."""
ONE_RADAR: Mapping[str, Radar] = {"thesis": THESIS, "x4m03": X4M03, "p4xx": P4XX}
"""Radars before which every suite can be played, by the name that `evaluate` takes."""
_X2_SHARE = 0.8  # the radar that the bundles are for
_CLOSE_M = 0.7  # an arm's length from a shelf or table
_HIGH_SHARE = 0.4  # of usual sites
_LOW = (0.4, 1.6), (-8.0, 8.0)  # metres and degrees of mounts on furniture and at switches
_HIGH = (1.9, 2.5), (10.0, 32.0)  # and over doors
_CLEAR_LEVEL_DB = (0.0, 40.0)  # from barely seen to far over the noise


def _draw_rate_hz(rng: np.random.Generator, least_hz: float = 30.0) -> float:
    """Return a frame rate: 60 or 200 Hz, the X2's usual ones, or one between, by its logarithm."""
    rate, usual = least_hz * (200 / least_hz) ** rng.random(), rng.random()
    if usual < 0.5:
        return 60.0
    return 200.0 if usual < 0.65 else float(round(rate, 1))


def draw_radar(rng: np.random.Generator, kind: RadarKind = "any") -> Radar:
    """Return a radar like those that the bundles are made for.

    Of any kind, eight in ten are an X2 with its chips' spread, the others have any carrier,
    bandwidth and bin length between those of the P4xx and the X4M03, and go down to 15 Hz.
    """
    share = rng.random(6)
    is_x2 = kind == "x2" or (kind == "any" and share[1] < _X2_SHARE)
    rate_hz = _draw_rate_hz(rng, 15.0 if kind == "any" and not is_x2 else 30.0)
    near = 0.25 + 0.55 * share[0]
    if kind == "x4m03":
        return replace(
            X4M03,
            # The two centre frequencies of the chip's ETSI and KCC pulses.
            carrier_hz=X4M03.carrier_hz if share[2] < 0.8 else 8.748e9,
            bandwidth_hz=X4M03.bandwidth_hz * (0.94 + 0.12 * share[3]),
            near_m=near,
            far_m=near + 2.2 * 4 ** share[5],
            frame_rate_hz=max(40.0, rate_hz),
        )
    if is_x2:
        bin_m = X2.bin_length_m * (0.98 + 0.10 * share[2])
        return replace(
            X2,
            carrier_hz=X2.carrier_hz * (0.97 + 0.06 * share[3]),
            bandwidth_hz=X2.bandwidth_hz * (0.94 + 0.12 * share[4]),
            bin_length_m=bin_m,
            near_m=near,
            far_m=near + 95 * bin_m,
            frame_rate_hz=rate_hz,
        )
    return Radar(
        name="other",
        carrier_hz=3.9e9 + 4.0e9 * share[2],
        bandwidth_hz=1.35e9 + 0.6e9 * share[3],
        bin_length_m=0.025 + 0.028 * share[4],
        near_m=near,
        far_m=near + 2.2 * 3 ** share[5],
        frame_rate_hz=rate_hz,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Radar, mount, room and receiver of one passage."""

    radar: Radar
    antenna: Antenna
    room: RoomSettings | None  # what stands still
    surfaces: tuple[Surface, ...]
    tail: TailSettings | None  # moving clutter behind bodies
    receiver: ReceiverEffects
    level_db: float  # strength of all echoes against the radar equation
    depth_m: float = np.inf  # how far behind the near end of the swath bodies go


def draw_close(rng: np.random.Generator, radar: Radar) -> Site:
    """Return a random usual site with a radar on a shelf or a table, and bodies close to it."""
    site = draw_site(rng, radar)
    height_m, tilt_deg = float(rng.uniform(0.2, 1.7)), float(rng.uniform(-15, 15))
    antenna = replace(site.antenna, height_m=height_m, tilt_deg=tilt_deg)
    return replace(site, antenna=antenna, depth_m=_CLOSE_M)


def clear_site(rng: np.random.Generator, site: Site) -> Site:
    """Return a site in which bodies are seen by themselves: without multipath, weak to strong."""
    return replace(site, surfaces=(), tail=None, level_db=float(rng.uniform(*_CLEAR_LEVEL_DB)))


def draw_site(rng: np.random.Generator, radar: Radar, kind: RoomKind = "usual") -> Site:
    """Return a random site for a radar."""
    share = rng.random(12)
    room_rng = rng.spawn(1)[0]
    if kind == "unseen":
        return _unseen(room_rng, radar)
    heights_m, tilts_deg = _HIGH if share[11] < _HIGH_SHARE else _LOW
    antenna = Antenna(
        height_m=float(rng.uniform(*heights_m)),
        tilt_deg=float(rng.uniform(*tilts_deg)),
        shape="gaussian" if share[0] < 0.75 else "isotropic",
        azimuth_width_deg=float(rng.uniform(55, 110)),
        elevation_width_deg=float(rng.uniform(55, 110)),
    )
    room = RoomSettings(
        objects_db=float(rng.uniform(30, 57)),
        diffuse_db=float(rng.uniform(10, 38)),
        leakage_db=float(rng.uniform(35, 60)),
        drift_m=float(rng.uniform(0, 1e-4)),
    )
    wall = Surface(axis="y", at_m=float(rng.uniform(radar.far_m, radar.far_m + 3.0)))
    floor = Surface(axis="z", smoothness=float(rng.uniform(0.3, 1.0)))
    ceiling = Surface(axis="z", at_m=2.4 + 0.8 * float(share[7]))
    likely = ((floor, share[1] < 0.55), (wall, share[2] < 0.35), (ceiling, share[8] < 0.2))
    surfaces = tuple(surface for surface, is_there in likely if is_there)
    tail = TailSettings(
        energy_db=float(rng.uniform(-16, -4)), reach_m=max(2.0, radar.far_m - radar.near_m)
    )
    # A jitter that loses against the noise in one radar stands out in the next.
    has_jitter = share[5] < 0.7
    receiver = ReceiverEffects(
        noise_figure_db=float(rng.uniform(9, 19)),
        jitter_s=float(rng.uniform(0, 2.3e-13)) if has_jitter else 0.0,
        gain_noise=float(rng.uniform(0, 1.2e-3)) if has_jitter else 0.0,
    )
    return Site(
        radar=radar,
        antenna=antenna,
        room=room if share[3] < 0.85 else None,
        surfaces=surfaces,
        tail=tail if share[4] < 0.45 else None,
        receiver=receiver,
        level_db=float(rng.uniform(-6, 28) if share[6] < 0.85 else rng.uniform(20, 40)),
    )


def _unseen(rng: np.random.Generator, radar: Radar) -> Site:
    far_m = radar.far_m
    side = float(rng.uniform(1.2, 2.5)) * (1 if rng.random() < 0.5 else -1)
    return Site(
        radar=radar,
        antenna=Antenna(
            height_m=float(rng.uniform(2.6, 3.0)),
            tilt_deg=float(rng.uniform(35, 50)),
            azimuth_width_deg=float(rng.uniform(50, 75)),
            elevation_width_deg=float(rng.uniform(50, 75)),
        ),
        room=RoomSettings(
            objects_db=float(rng.uniform(45, 57)),
            n_objects=25,
            diffuse_db=float(rng.uniform(28, 40)),
            profile="power",
            exponent=float(rng.uniform(1.5, 3)),
            leakage_db=float(rng.uniform(45, 65)),
            drift_m=1e-4,
        ),
        surfaces=(
            Surface(axis="z", permittivity=5.3),
            Surface(axis="z", at_m=float(rng.uniform(2.6, 3.0)), permittivity=2.9),
            Surface(axis="x", at_m=side, permittivity=5.3),
            Surface(axis="y", at_m=float(rng.uniform(far_m - 0.3, far_m + 1.0))),
        ),
        tail=TailSettings(energy_db=float(rng.uniform(-8, -2)), reach_m=max(2.5, far_m)),
        receiver=ReceiverEffects(
            noise_figure_db=float(rng.uniform(11, 17)), jitter_s=2e-13, gain_noise=1e-3
        ),
        level_db=float(rng.uniform(-5, 10)),
    )
