"""Passages: somebody goes through a site; what the radar sees, and the truth about it.

Frames are made at the axis of the site's radar, behind the matched filter and, for most, the
decimation too, so a passage costs what a scene requires and no more.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.antenna import length_m
from x2radar.sim.place.room import Room
from x2radar.sim.points import Points
from x2radar.sim.scene.scene import Scene, SceneStep
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power
from x2radar.sim.signal.receiver import Receiver
from x2train.sets.domain_randomization import RandomizedActor
from x2train.sets.families import RECORDED, Family
from x2train.sets.sites import Site

Array = NDArray[np.float64]
_COURSES = ("cross", "approach", "leave", "oblique", "wander")
_MADE = frozenset({"human", *SPECIES})  # whom a `BodyModel` concerns: with motions and skins
_WALL_M = 0.3  # nearest to the wall that the radar hangs on
_UNSEEN = 0.1  # of the noise's amplitude: echoes under it are not made
_BLOCK_S = 10.0  # played at once: some megabytes
_ERROR_DB = -50.0  # of echoes: far under clutter that jitter leaves


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
