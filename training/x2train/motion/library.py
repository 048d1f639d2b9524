"""A folder of clips as a source of bodies: who, which skin, how large, how quick, where.

Each individual is a way of moving of its own: those clips in which it goes, and those in which it
stays. People keep nearly their own size; animals are drawn from 0.2 to 0.7 m at the withers, and
the smaller the quicker, as pendulums are.

Passages are longer than clips. Where a clip ends, one of the same individual goes on from a like
pose, and the two are faded into each other; the speed along the course is the clip's own, so feet
slide no more than they do in the clip, but for what corners ask of them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.motion.recorded import RecordedMotion
from x2radar.sim.bodies.path.path import COURSES, bends, draw_course
from x2radar.sim.points import Label
from x2train.motion.clips import Clip, read_clips

Array = NDArray[np.float64]
_DURATION_S = 60.0  # of a performance: passages last 20 s, and look up to 40 s for an entry
_SIZE_M: Mapping[Label, tuple[float, float]] = {"human": (0.9, 2.0), "pet": (0.2, 0.7)}
"""That sizes are drawn between: statures, withers."""
_TEMPO = {"human": (0.75, 1.15), "pet": (0.6, 1.3)}
"""How much quicker than recorded, before the size makes it quicker still. Slow ones count: of a
recorded dog's passages those at less than 0.3 m/s alarmed most
(docs/research/evaluation-tried.md)."""
_SLOW = (0.25, 0.75)  # where a passage is to be slow: of both, so that it tells nobody apart
_SPREAD = {"human": 0.08, "pet": 0.35}  # of sizes, in parts: adults' statures by a twelfth
_CHILD_SHARE = 0.15  # of people, who are drawn from 0.9 m on
_ENOUGH_S = 120.0  # more of one individual does not make it come more often
_RECORDED_TRUST = 4.0  # one recorded dog is a third of the animals, beside twenty by hand
_NOT_AT_HOME = re.compile(r"death|attack|bite|fall|jump", re.IGNORECASE)
"""Clips of animals that nobody sees in a room."""
_GIRTH, _N_LOOKS, _RADII_M = 0.12, 16, (0.3, 0.8)
_FADE_S = 0.25  # a quarter of a second: shorter than a person's step, longer than a twitch
_FROM_SHARE, _TO_SHARE = 0.5, 0.6  # a clip is left in its second half, entered in the first
_EVERY = 3  # poses are compared every so many frames
_MOVING_S = 0.1  # a pose is like another if it also moves alike so much later


@dataclass(frozen=True, slots=True, eq=False)
class Individual:
    """Clips of one individual that can follow each other: in all it goes, or in all it stays."""

    name: str
    label: Label
    clips: tuple[Clip, ...]
    goes: bool

    @property
    def weight(self) -> float:
        """How often it is drawn: by how much there is of it, and how real that is."""
        seconds = sum(len(clip.joint_m) / clip.frame_rate_hz for clip in self.clips)
        # Animated clips say how far their feet slide, none of those that stay in their place.
        slips = [clip.slip for clip in self.clips if clip.slip is not None]
        trust = 1 / (1 + 5 * float(np.mean(slips))) if slips else 1.0
        if self.label == "pet" and not slips:
            trust = _RECORDED_TRUST
        return float(np.sqrt(min(seconds, _ENOUGH_S))) * trust


@cache
def read_library(folder: Path, known: frozenset[str] = frozenset()) -> tuple[Individual, ...]:
    """Return the individuals of a folder of clips, by name; raises SceneError as `read_clips`.

    Clips whose SHA-256 is `known` are left out, and individuals who have no others.
    """
    rows: dict[tuple[str, bool], list[Clip]] = {}
    for clip in read_clips(folder):
        if clip.sha256 in known or (clip.label == "pet" and _NOT_AT_HOME.search(clip.name)):
            continue
        rows.setdefault((clip.individual, clip.goes), []).append(clip)
    return tuple(
        Individual(f"{name} {'goes' if goes else 'stays'}", clips[0].label, tuple(clips), goes)
        for (name, goes), clips in sorted(rows.items())
    )


def draw_recorded_body(
    individual: Individual, rng: np.random.Generator, options: Mapping[str, Any], where: str
) -> Body:
    """Draw a body that moves as an individual did: clips, size, tempo, mirror, course, skin."""
    label = individual.label
    clips = _mirrored(individual) if rng.random() < 0.5 else individual.clips
    size_m = _draw_size_m(rng, individual)
    scale = size_m / float(np.median([clip.size_m for clip in clips]))
    low, high = _SLOW if options.get("slow") else _TEMPO[label]
    tempo = float(rng.uniform(low, high)) / np.sqrt(scale)
    near_m, far_m = options.get("near_m", 0.6), options.get("far_m", 3.4)
    drawn = options.get("course") or list(COURSES)[int(rng.integers(len(COURSES)))]
    course = draw_course(rng, drawn if individual.goes else "wander", near_m, far_m)
    played = perform(rng, clips, duration_s=_DURATION_S, scale=scale, tempo=tempo)
    begin_m = 0.0 if individual.goes else float(rng.uniform(0.0, 2.0))
    position_m = played.along(course, float(rng.uniform(*_RADII_M)), begin_m)
    clip = clips[0]
    motion = RecordedMotion.of(clip.joints, clip.parents, position_m, played.frame_rate_hz)
    kind = motion.skeleton
    girth = float(np.exp(_GIRTH * np.clip(rng.standard_normal(), -2.5, 2.5)))
    half_m = motion.half_m * np.array([1.0, girth, girth])
    plan = BodyPlan(label, kind.names, half_m, motion, kind.n_trunk, kind.gain)
    looks_s = np.linspace(0.0, _DURATION_S / 2, _N_LOOKS)
    try:
        return plan.dressed(
            rng, options.get("skin", "surface"), options.get("total_rcs_dbsm"), looks_s
        )
    except SceneError as err:
        raise SceneError(f"{where}: {err}") from err


@cache
def _mirrored(individual: Individual) -> tuple[Clip, ...]:
    return tuple(clip.mirrored() for clip in individual.clips)


def _draw_size_m(rng: np.random.Generator, individual: Individual) -> float:
    label = individual.label
    low, high = _SIZE_M[label]
    own_m = float(np.median([clip.size_m for clip in individual.clips]))
    if label == "human" and rng.random() < _CHILD_SHARE:
        return float(rng.uniform(low, 1.5))
    spread = _SPREAD[label] * np.clip(rng.standard_normal(), -2.0, 2.0)
    return float(np.clip(own_m * np.exp(spread), low, high))


def cards_of(individuals: Sequence[Individual]) -> list[dict[str, str]]:
    """Return name, individual, source, licence and hash of every clip, for manifests and cards."""
    return [
        {
            "clip": clip.name,
            "individual": each.name,
            "source": clip.source,
            "licence": clip.licence,
            "sha256": clip.sha256,
        }
        for each in individuals
        for clip in each.clips
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Performance:
    """Joints in their own place, and the way gone, frame by frame."""

    joint_m: Array  # (n_frames, n_joints, 3): ahead, to the left, up
    way_m: Array  # (n_frames,)
    frame_rate_hz: float

    def along(
        self, waypoints_m: Sequence[tuple[float, float]], radius_m: float, begin_m: float = 0.0
    ) -> Array:
        """Return joints in the room, (n_frames, n_joints, 3), on a course, from `begin_m` on."""
        begin, parts = bends(waypoints_m, radius_m)
        at, done_m, way_m = begin, 0.0, begin_m + self.way_m
        x, y, direction = (np.empty_like(way_m) for _ in range(3))
        left = np.ones(len(way_m), np.bool_)
        for k, part in enumerate(parts):
            here = left & ((way_m < done_m + part.length_m) | (k == len(parts) - 1))
            way = way_m[here] - done_m
            inside = np.clip(way, 0.0, part.length_m)
            half = 0.5 * part.curvature_per_m * inside
            chord = inside * np.sinc(half / np.pi)
            turn = at[2] + 2 * half
            # Beyond an end it goes straight on.
            over = way - inside
            x[here] = at[0] + chord * np.cos(at[2] + half) + over * np.cos(turn)
            y[here] = at[1] + chord * np.sin(at[2] + half) + over * np.sin(turn)
            direction[here] = turn
            left &= ~here
            at, done_m = part.end(at, part.length_m), done_m + part.length_m
        cos, sin = np.cos(direction)[:, None], np.sin(direction)[:, None]
        ahead, side, up = np.moveaxis(self.joint_m, -1, 0)
        return np.stack(
            [x[:, None] + cos * ahead - sin * side, y[:, None] + sin * ahead + cos * side, up],
            axis=-1,
        )


def perform(
    rng: np.random.Generator,
    clips: Sequence[Clip],
    *,
    duration_s: float,
    scale: float = 1.0,
    tempo: float = 1.0,
) -> Performance:
    """Play clips of one individual one after the other, for `duration_s` at least."""
    rate_hz = clips[0].frame_rate_hz
    n_wanted = int(np.ceil(duration_s * rate_hz * tempo)) + 2
    weights = np.array([len(clip.joint_m) for clip in clips], float)
    clip = clips[int(rng.choice(len(clips), p=weights / weights.sum()))]
    at = int(rng.integers(max(1, round(_TO_SHARE * len(clip.joint_m)))))
    joint_m, step_m = clip.joint_m[at:at], clip.step_m[at:at]
    while len(joint_m) < n_wanted:
        n, n_fade = len(clip.joint_m), _fade(clip.frame_rate_hz)
        earliest = max(at + 2 * n_fade + 1, round(_FROM_SHARE * n))
        left = n if earliest >= n else int(rng.integers(earliest, n + 1))
        joint_m, step_m = _faded(joint_m, step_m, clip.joint_m[at:left], clip.step_m[at:left])
        if len(joint_m) < n_wanted:
            clip, at = _goes_on_with(rng, clip, left, clips)
    return Performance(
        scale * joint_m[:n_wanted],
        scale * (np.cumsum(step_m[:n_wanted]) - step_m[0]),
        rate_hz * tempo,
    )


def _fade(rate_hz: float) -> int:
    return max(2, round(_FADE_S * rate_hz))


def _goes_on_with(
    rng: np.random.Generator, clip: Clip, left: int, clips: Sequence[Clip]
) -> tuple[Clip, int]:
    """Return a clip and its frame that are like the end of another one: one of the three best."""
    first = max(0, left - _fade(clip.frame_rate_hz))
    here = _poses(clip, np.array([first]))[0]
    best: list[tuple[float, int, int]] = []
    for k, other in enumerate(clips):
        starts, poses, square = _entries(other)
        off = square - 2 * (poses @ here)  # but for `here`'s own square, which is that of all
        nearest = int(np.argmin(off))
        best.append((float(off[nearest]), k, int(starts[nearest])))
    _, k, start = sorted(best)[int(rng.integers(min(3, len(best))))]
    return clips[k], start


@cache
def _entries(clip: Clip) -> tuple[NDArray[np.int64], Array, Array]:
    """Return where a clip may be entered, its poses there, and their squares."""
    n_frames, n_fade = len(clip.joint_m), _fade(clip.frame_rate_hz)
    n = max(1, min(round(_TO_SHARE * n_frames), n_frames - 2 * n_fade - 1))
    starts = np.arange(0, n, _EVERY)
    poses = _poses(clip, starts)
    return starts, poses, (poses**2).sum(axis=1)


def _poses(clip: Clip, frames: NDArray[np.int64]) -> Array:
    """Return where joints are and where they are so much later, shape (n_frames, 6 n_joints)."""
    later = max(1, round(_MOVING_S * clip.frame_rate_hz))
    ends = np.minimum(frames + later, len(clip.joint_m) - 1)
    both = np.concatenate([clip.joint_m[frames], clip.joint_m[ends]], axis=1)
    return both.reshape(len(frames), -1)


def _faded(joint_m: Array, step_m: Array, more_m: Array, more_step: Array) -> tuple[Array, Array]:
    """Return two pieces as one; the end of the first fades into the beginning of the second."""
    if not len(joint_m):
        return more_m, more_step
    n = min(len(joint_m), len(more_m), _fade(60.0))
    share = (np.arange(1, n + 1) / (n + 1))[:, None, None]
    # Smooth at both ends: joints do not jump, nor do their speeds.
    share = share * share * (3 - 2 * share)
    both = (1 - share) * joint_m[-n:] + share * more_m[:n]
    steps = (1 - share[:, 0, 0]) * step_m[-n:] + share[:, 0, 0] * more_step[:n]
    return (
        np.concatenate([joint_m[:-n], both, more_m[n:]]),
        np.concatenate([step_m[:-n], steps, more_step[n:]]),
    )
