"""Stage: a scene played for one radar, block after block: where its echoes come from.

Positions become rows of echoes here (range and root of the cross section): the direct ways,
those by floor and walls, and the tail behind a body. Making frames of them is the echo
tiers' business.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.place.antenna import DiffuseTail, EchoRows, image_rows, length_m
from x2radar.sim.points import Array, Mover, Points
from x2radar.sim.scene.cast import Actor
from x2radar.sim.scene.scene import Scene
from x2radar.sim.things.draws import draw_mount

_MAX_LOOK_S = 60.0  # how long `check_swath` follows a body: in a minute it has crossed any room
_BACKGROUND, _MOUNT, _TAIL, _STEP = 0xBAC0, 0x3071, 0x7A11, 0x57E9
"""Of generators, as in `module.stream`."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneBlock:
    """Consecutive frames of one step."""

    rows: EchoRows  # echoes; physical cross sections
    offset_m: Array | None  # (n_slow, 3): how far the mount has moved the antenna
    movers: tuple[Mover, ...]  # bodies and things of this step, then those of the background
    points: tuple[Points, ...]  # where they are

    @property
    def n_slow(self) -> int:
        return len(self.rows.range_m)


@dataclass(slots=True)
class _Playing:
    movers: tuple[Mover, ...]
    n: int
    begun: int


class Stage:
    """Walk through a scene frame by frame, for ever; all draws follow from the seed."""

    def __init__(self, scene: Scene, seed: int, frame_rate_hz: float) -> None:
        self._scene = scene
        self._seed = seed
        self._rate_hz = frame_rate_hz
        self._antenna_m = scene.antenna.position_m
        self._background = tuple(
            actor.make(np.random.default_rng([seed, _BACKGROUND, k]))
            for k, actor in enumerate(scene.background)
        )
        mount, tail = scene.mount, scene.tail
        rng, tail_rng = (np.random.default_rng([seed, kind]) for kind in (_MOUNT, _TAIL))
        self._mount = None if mount is None else draw_mount(rng, mount)
        self._tail = None if tail is None else DiffuseTail(tail_rng, tail, scene.antenna)
        self._steps = self._walk()
        self._now = _Playing((), 0, 0)
        self._at = 0

    def next_block(self, most: int, taken_s: Array | None = None) -> SceneBlock:
        """Return the next `most` frames or fewer, taken at `taken_s`, of one step."""
        now = self._now
        if self._at == now.begun + now.n:
            self._now = now = next(self._steps)
        first = self._at
        n = min(most, now.begun + now.n - first)
        self._at += n
        stream_s = np.arange(first, first + n) / self._rate_hz
        late_s = np.zeros(n) if taken_s is None else taken_s[:n] - stream_s
        # Not stream time minus the step's start, which would round.
        step_s = np.arange(first - now.begun, first - now.begun + n) / self._rate_hz + late_s
        stream_s += late_s
        offset_m = None if self._mount is None else self._mount(stream_s)
        movers = (*now.movers, *self._background)
        times_s = [step_s] * len(now.movers) + [stream_s] * len(self._background)
        points = tuple(m.at(t_s, self._antenna_m) for m, t_s in zip(movers, times_s, strict=True))
        rows = [r for p in points for r in self._rows(p, offset_m)]
        joined = EchoRows(
            np.concatenate([np.zeros((n, 0)), *(r.range_m for r in rows)], axis=1),
            np.concatenate([np.zeros((n, 0)), *(r.root_rcs_m for r in rows)], axis=1),
        )
        return SceneBlock(joined, offset_m, movers, points)

    def labels(self, duration_s: float) -> list[tuple[float, float, str]]:
        """Return who is there from when to when since the stream's start: (t0_s, t1_s, label).

        A step is a person's if there is one in it, else a pet's, else that of other things, those
        of the background among them; steps in which nothing moves have no label.
        """
        found: list[tuple[float, float, str]] = []
        for now in self._walk():
            t0_s, t1_s = now.begun / self._rate_hz, (now.begun + now.n) / self._rate_hz
            if t0_s >= duration_s:
                break
            here = {mover.label for mover in (*now.movers, *self._background)}
            labels = [label for label in ("human", "pet", "other") if label in here]
            found += [(t0_s, min(t1_s, duration_s), label) for label in labels[:1]]
        return found

    def _rows(self, points: Points, offset_m: Array | None) -> Iterator[EchoRows]:
        antenna = self._scene.antenna
        yield antenna.direct(points, offset_m)
        for surface in self._scene.surfaces:
            yield image_rows(points, antenna, surface)
        if self._tail is not None:
            yield self._tail.rows(points)

    def _walk(self) -> Iterator[_Playing]:
        number = begun = 0
        while True:
            for choice in self._scene.steps:
                step = choice[0]
                if len(choice) > 1:
                    rng = np.random.default_rng([self._seed, number, _STEP, 1])
                    weights = np.array([each.weight for each in choice])
                    step = choice[int(rng.choice(len(choice), p=weights / weights.sum()))]
                rng = np.random.default_rng([self._seed, number, _STEP])
                n = max(1, round(rng.uniform(step.least_s, step.most_s) * self._rate_hz))
                yield _Playing(tuple(self._cast(step.actors, number)), n, begun)
                number += 1
                begun += n

    def _cast(self, actors: tuple[Actor, ...], number: int) -> Iterator[Mover]:
        for k, actor in enumerate(actors):
            # A body alone in its step keeps its draws when others join it.
            rng = np.random.default_rng([self._seed, number, *([k] if k else [])])
            if actor.probability == 1.0 or rng.random() < actor.probability:
                yield actor.make(rng)


def check_swath(scene: Scene, near_m: float, far_m: float) -> None:
    """Raise SceneError if a thing that was put in a place never enters the swath."""
    listed = [(actor, _MAX_LOOK_S) for actor in scene.background]
    for step in (step for choice in scene.steps for step in choice):
        listed += [(actor, step.most_s) for actor in step.actors]
    for actor, seconds in listed:
        if not {"waypoints_m", "position_m", "home_m"} & actor.options.keys():
            continue
        t_s = np.arange(0.0, min(seconds, _MAX_LOOK_S) + 0.1, 0.1)
        points = actor.make(np.random.default_rng(0)).at(t_s, scene.antenna.position_m)
        range_m = length_m(points.position_m - scene.antenna.position_m)
        if not ((range_m >= near_m) & (range_m <= far_m)).any():
            raise SceneError(
                f"{actor.where}: the {actor.kind} never enters the swath, "
                f"{near_m:.2f} to {far_m:.2f} m"
            )
