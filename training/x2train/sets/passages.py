"""Passages: somebody goes through a site; what the radar sees, and the truth about it.

Frames are made at the axis of the site's radar, behind the matched filter and, for most, the
decimation too, so a passage costs what a scene requires and no more. Bodies of one family differ
in more than what the simulator draws (domain randomization): gains of the parts, trunks of one
bright spot or of several, constant cross sections, uneven clocks: the same way for every class, so
that a network finds nothing to learn there.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.body import Body
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.bodies.skins import SurfaceSkin
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.antenna import length_m
from x2radar.sim.place.room import Room
from x2radar.sim.points import Label, Mover, Points
from x2radar.sim.scene.cast import Actor
from x2radar.sim.scene.scene import Scene, SceneStep
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power
from x2radar.sim.signal.receiver import Receiver
from x2train.sets.families import RECORDED, Family
from x2train.sets.sites import Site

Array = NDArray[np.float64]
_COURSES = ("cross", "approach", "leave", "oblique", "wander")
_MADE = frozenset({"human", *SPECIES})  # whom a `BodyModel` concerns: with motions and skins
_WALL_M = 0.3  # nearest to the wall that the radar hangs on
_UNSEEN = 0.1  # of the noise's amplitude: echoes under it are not made
_BLOCK_S = 10.0  # played at once: some megabytes
_ERROR_DB = -50.0  # of echoes: far under clutter that jitter leaves
_LONGEST_LOOK_S = 40.0  # courses are shorter
_LOOK_STEP_S = 0.1  # a tenth of a step
_GOES_MPS = 0.15  # slower bodies stay
_MIN_WAY_S = 1.0  # half a dwell of going
_N_WAVES = 4  # uneven, but smooth
_CONTRAST = (0.35, 1.3)  # exponent on the parts' strengths, chosen: limbs are recorded stronger
_JOINED = 0.25  # of the strongest part: -6 dB
_JOIN_SHARE, _CONSTANT_SHARE, _LOOSE_SHARE = 0.25, 0.3, 0.4  # of bodies


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True range, velocity, speed and SNR, frame by frame."""

    range_m: Array
    velocity_mps: Array
    speed_mps: Array
    snr_db: Array


@dataclass(frozen=True, slots=True)
class BodyModel:
    """Which laws make the people, cats and dogs of a passage."""

    motion: str = "gait"  # of `MOTIONS`
    skin: str = "surface"  # of `SKINS`
    is_physical: bool = False  # cross sections follow from sizes, not from a draw
    is_slow: bool = False  # recorded bodies move slower than they did

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        motions: Sequence[str],
        skins: Sequence[str],
        physical_share: float,
    ) -> Self:
        """Draw the laws evenly; all bodies of a passage share them."""
        motion, skin = (names[int(rng.integers(len(names)))] for names in (motions, skins))
        return cls(motion, skin, bool(rng.random() < physical_share))

    @property
    def options(self) -> dict[str, Any]:
        """Options of the body as a scene file has them."""
        size = {"total_rcs_dbsm": "physical"} if self.is_physical else {}
        tempo = {"slow": True} if self.is_slow else {}
        return {"motion": self.motion, "skin": self.skin, **size, **tempo}


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """A piece of a stream, and its truth."""

    site: Site
    cast: tuple[Family, ...]
    frames: NDArray[np.complex64]  # (n_slow, n_range): baseband at the axis of the site's radar
    truth: Truth  # of every body of the cast
    body_model: BodyModel = BodyModel()
    is_plain: bool = False  # without domain randomization


def play(
    rng: np.random.Generator,
    site: Site,
    cast: tuple[Family, ...],
    *,
    duration_s: float,
    lead_s: tuple[float, float] = (0.2, 2.5),
    is_plain: bool = False,
    body_model: BodyModel = BodyModel(),
) -> Passage:
    """Simulate a passage of a cast through a site, for `duration_s`, all random from `rng`."""
    rate_hz = site.radar.frame_rate_hz
    given = {} if body_model == BodyModel() else body_model.options
    actors = tuple(actor(rng, site, f, lead_s, given, is_plain=is_plain) for f in cast)
    player = Player(rng, site, (SceneStep(actors, duration_s, duration_s),))
    n_slow = round(duration_s * rate_hz)
    made, points = player.next_block(n_slow)
    truth = player.truth(points) if cast else Truth(*np.zeros((4, n_slow, 0)))
    return Passage(site, cast, made, truth, body_model, is_plain)


def level_db_of(site: Site) -> float:
    """Return what a square metre at 1 m on the axis shows, in dB over the receiver's noise."""
    one = np.ones(1)
    amplitude = float(LinkBudget().amplitude(one, one, site.radar.axis())[0]) * _gain(site)
    return float(20 * np.log10(amplitude / _noise_level(site)))


class Player:
    """Play steps in a site, block after block, for ever; everything random from `rng`."""

    def __init__(self, rng: np.random.Generator, site: Site, steps: tuple[SceneStep, ...]) -> None:
        axis, rate_hz = site.radar.axis(), site.radar.frame_rate_hz
        scene = Scene(
            name="passage",
            description="",
            steps=tuple((step,) for step in steps),
            room=site.room,
            antenna=site.antenna,
            surfaces=site.surfaces,
            tail=site.tail,
            receiver=site.receiver,
        )
        self._site, self._axis, self._rate_hz, self._at = site, axis, rate_hz, 0
        self._stage = Stage(scene, int(rng.integers(2**31)), rate_hz)
        self._budget = LinkBudget()
        self._noise = float(np.sqrt(baseband_noise_power(axis, self._budget.noise_sigma)))
        self._gain = _gain(site)
        self._room = None if site.room is None else Room(rng, site.room, axis)
        sweep = RadarSettings.for_frame_rate(max(1, round(rate_hz)))
        self._receiver = Receiver(
            sweep, axis, self._budget, rng, effects=site.receiver, seed=int(rng.integers(2**31))
        )

    def next_block(self, most: int) -> tuple[NDArray[np.complex64], tuple[Points, ...]]:
        """Return the next frames and where the bodies are; fewer than `most` where a step ends."""
        block = self._stage.next_block(most)
        frames = echo_frames(
            block.rows.range_m,
            block.rows.amplitude(self._budget, self._axis) * self._gain,
            self._axis,
            error_db=_ERROR_DB,
            floor=_UNSEEN * self._noise,
        )
        n = block.n_slow
        if self._room is not None:
            frames = frames + self._room.echo((self._at + np.arange(n)) / self._rate_hz)
        self._at += n
        return self._receiver.baseband(np.asarray(frames, np.complex64)), block.points

    def rows(self, n: int) -> Iterator[NDArray[np.complex64]]:
        """Yield `n` frames, of hours too, which no memory would hold at once."""
        while n:
            frames, _ = self.next_block(min(n, round(_BLOCK_S * self._rate_hz)))
            n -= len(frames)
            yield from frames

    def truth(self, points: tuple[Points, ...]) -> Truth:
        """Return the truth about bodies of a block."""
        radar, antenna, noise = self._site.radar, self._site.antenna, _noise_level(self._site)
        columns = []
        for p in points:
            middle = p.position_m.mean(axis=1)
            range_m = length_m(middle - antenna.position_m)
            velocity_mps = -np.gradient(range_m) * self._rate_hz
            speed_mps = np.linalg.norm(np.gradient(middle, axis=0), axis=1) * self._rate_hz
            amplitude = antenna.direct(p, None).amplitude(self._budget, self._axis) * self._gain
            away_m = length_m(p.position_m - antenna.position_m)
            seen = (away_m > radar.near_m) & (away_m < radar.far_m)
            power = np.where(seen, amplitude**2, 0.0).sum(axis=1) / noise**2
            with np.errstate(divide="ignore"):
                snr_db = 10 * np.log10(power)
            columns.append((range_m, velocity_mps, speed_mps, snr_db))
        return Truth(*(np.stack(column, axis=1) for column in zip(*columns, strict=True)))


def _gain(site: Site) -> float:
    return float(np.sqrt(SEED_GAIN) * 10 ** (site.level_db / 20))


def _noise_level(site: Site) -> float:
    """Return the amplitude of this receiver's noise, which is not the budget's."""
    noise = float(np.sqrt(baseband_noise_power(site.radar.axis(), LinkBudget().noise_sigma)))
    return noise * 10 ** ((site.receiver.noise_figure_db - 13) / 20)


@dataclass(frozen=True, slots=True, eq=False)
class DomainRandomization:
    """A mover made less like the others of its kind; a `Mover` itself."""

    mover: Mover
    label: Label  # of the body inside, as the names of its parts
    names: tuple[str, ...]
    gain: Array
    contrast: float
    joins: bool
    is_constant: bool
    begin_s: float
    pace: float
    wave: Array

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return the body's points by an uneven clock, with gains of its own; see `Mover`."""
        size_s, rate_hz, phase = self.wave[:, None]
        uneven = (size_s * np.sin(2 * np.pi * rate_hz * t_s[:, None] + phase)).sum(axis=1)
        points = self.mover.at(self.begin_s + self.pace * t_s + uneven, antenna_m)
        rcs = points.rcs_m2 * self.gain
        mean = rcs.mean(axis=0)
        top = float(mean.max(initial=0.0))
        if top > 0:
            factor = (np.maximum(mean, 1e-6 * top) / top) ** (self.contrast - 1)
            # The whole is as strong as before.
            rcs *= factor * (mean.sum() / (mean * factor).sum())
        if self.is_constant:
            rcs = np.broadcast_to(rcs.mean(axis=0), rcs.shape)
        points = Points(points.position_m, rcs, points.nearer_m)
        return _joined(points) if self.joins and top > 0 else points


def _joined(points: Points) -> Points:
    """Return points whose strongest parts are one, in their middle, with their echoes' sum."""
    mean = points.rcs_m2.mean(axis=0)
    strong = np.flatnonzero(mean > _JOINED * mean.max())
    weight = mean[strong] / mean[strong].sum()
    first, rest = strong[0], strong[1:]
    position_m, rcs = points.position_m.copy(), points.rcs_m2.copy()
    position_m[:, first] = np.einsum("k,tkx->tx", weight, position_m[:, strong])
    rcs[:, first] = rcs[:, strong].sum(axis=1)
    rcs[:, rest] = 0.0
    nearer_m = points.nearer_m
    if nearer_m is not None:
        nearer_m = nearer_m.copy()
        nearer_m[:, first] = nearer_m[:, strong] @ weight
    return Points(position_m, rcs, nearer_m)


@dataclass(frozen=True, slots=True)
class RandomizedActor(Actor):
    """An actor who comes in a randomization."""

    antenna_m: tuple[float, float, float] = (0.0, 0.0, 1.0)  # where the antenna is
    swath_m: tuple[float, float] = (0.6, 3.4)  # near and far end of what the radar sees
    # it enters the swath so many seconds after time 0, drawn evenly
    lead_s: tuple[float, float] = (0.2, 2.5)
    # without randomization, but for its entry: bodies as their own files make them
    is_plain: bool = False

    def make(self, rng: np.random.Generator) -> Mover:
        """Return it with new draws; raises SceneError as `read_actor`."""
        # The zero-argument super() does not work in a slotted dataclass.
        mover = Actor.make(self, rng)
        n = len(mover.names)
        spread_db, share, z = rng.uniform(0, 5), rng.random(7), rng.standard_normal(n + 1)
        is_loose = share[6] < _LOOSE_SHARE and not self.is_plain
        if is_loose and isinstance(mover, Body) and isinstance(mover.skin, SurfaceSkin):
            mover.skin.n_trunk = 1  # it was drawn just now, for nobody else
        gain = 10 ** (spread_db * z[1:].clip(-2, 2) / 10)
        gain /= gain.mean()
        pace = float(np.exp(0.10 * z[0].clip(-2, 2)))
        rate_hz = 0.15 * 8 ** rng.random(_N_WAVES)
        # The clock never stops: the sum of the rates' swings stays under a third.
        size_s = share[0] * 0.08 / (2 * np.pi * rate_hz)
        contrast = _CONTRAST[0] + (_CONTRAST[1] - _CONTRAST[0]) * share[4]
        joins, constant = bool(share[5] < _JOIN_SHARE), bool(share[1] < _CONSTANT_SHARE)
        if self.is_plain:
            gain, pace, size_s = np.ones(n), 1.0, 0 * size_s
            contrast, joins, constant = 1.0, False, False
        wave = np.array([size_s, rate_hz, 2 * np.pi * rng.random(_N_WAVES)])
        begin_s = self._begin_s(mover, share[2], share[3]) if self.lead_s[1] >= 0 else 0.0
        inside = (mover, mover.label, mover.names)
        return DomainRandomization(*inside, gain, contrast, joins, constant, begin_s, pace, wave)

    def _begin_s(self, mover: Mover, where: float, lead: float) -> float:
        """Return when to begin, so that it comes into the swath soon or is in it."""
        t_s = np.arange(0.0, _LONGEST_LOOK_S, _LOOK_STEP_S)
        antenna_m = np.array(self.antenna_m)
        place_m = mover.at(t_s, antenna_m).position_m
        range_m = length_m(place_m - antenna_m)
        seen = ((range_m > self.swath_m[0]) & (range_m < self.swath_m[1])).mean(axis=1) > 0.3
        times = t_s[seen]
        if not len(times):
            return 0.0
        step_m = np.linalg.norm(np.diff(place_m.mean(axis=1), axis=0), axis=1)
        goes = step_m > _GOES_MPS * _LOOK_STEP_S
        if goes.any():
            # Who has arrived stands there for good: that is not on its way.
            on_the_way = times[times <= t_s[np.flatnonzero(goes)[-1]] - _MIN_WAY_S]
            times = on_the_way if len(on_the_way) else times[:1]
        # Half the time at its entry, else anywhere on its way.
        start = times[0] if where < 0.5 else times[int((2 * where - 1) * (len(times) - 1))]
        early, late = self.lead_s
        return float(start - early - (late - early) * lead)


def actor(
    rng: np.random.Generator,
    site: Site,
    family: Family,
    lead_s: tuple[float, float],
    given: Mapping[str, Any],
    *,
    is_plain: bool,
) -> RandomizedActor:
    """Return a family's body in a site, its place and course drawn; `given` are options of all."""
    radar = site.radar
    near_m, far_m = radar.near_m, min(radar.far_m, radar.near_m + site.depth_m)
    options: dict[str, Any] = dict(family.options)
    if family.kind in _MADE:
        options = {**given, **options}
    bearing = rng.uniform(-0.7, 0.7)
    away_m = rng.uniform(near_m + 0.2, far_m - 0.2)
    x, y = float(away_m * np.sin(bearing)), float(away_m * np.cos(bearing))
    if family.kind == RECORDED:
        echo = {key: value for key, value in given.items() if key != "motion"}
        options = {**echo, "near_m": near_m, "far_m": far_m}
    elif family.plugged is not None:
        pass  # Only it knows which options it takes.
    elif family.label == "other" and family.kind != "moth":
        options["position_m"] = [x, y]
    elif family.kind == "bird":
        options["home_m"] = [x, y, float(rng.uniform(0.8, 1.8))]
    elif family.kind != "moth" and family.use != "thesis":
        drawn = _COURSES[int(rng.integers(len(_COURSES)))]
        if family.stays and site.depth_m < np.inf:
            options = {"waypoints_m": _close_place(rng, near_m, far_m)} | options
        else:
            course = "wander" if family.stays else drawn
            options = {"near_m": near_m, "far_m": far_m, "course": course} | options
    return RandomizedActor(
        family.kind,
        options,
        family.name,
        plugged=family.plugged,
        antenna_m=(0.0, 0.0, site.antenna.height_m),
        swath_m=(radar.near_m, radar.far_m),
        lead_s=lead_s,
        is_plain=is_plain,
    )


def _close_place(rng: np.random.Generator, near_m: float, far_m: float) -> list[list[float]]:
    """Return a point near the radar, and one half a metre from it in any direction."""
    away_m, bearing = rng.uniform(near_m, far_m), rng.uniform(-0.6, 0.6)
    turn = rng.uniform(0, 2 * np.pi)
    x, y = away_m * np.sin(bearing), max(_WALL_M, away_m * np.cos(bearing))
    ahead = 0.5 * np.sin(turn)
    ahead = ahead if y + ahead > _WALL_M else -ahead
    return [[float(x), float(y)], [float(x + 0.5 * np.cos(turn)), float(y + ahead)]]
