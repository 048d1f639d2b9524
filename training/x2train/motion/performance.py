"""Performances: clips of one individual, one after the other, along a course.

Passages are longer than clips. Where a clip ends, one of the same individual goes on from a like
pose, and the two are faded into each other; the speed along the course is the clip's own, so feet
slide no more than they do in the clip, but for what corners ask of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.path.path import bends
from x2train.motion.clips import Clip

Array = NDArray[np.float64]

_FADE_S = 0.25  # a quarter of a second: shorter than a person's step, longer than a twitch
_FROM_SHARE, _TO_SHARE = 0.5, 0.6  # a clip is left in its second half, entered in the first
_EVERY = 3  # poses are compared every so many frames
_MOVING_S = 0.1  # a pose is like another if it also moves alike so much later


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
        x, y, direction = _on_course(waypoints_m, radius_m, begin_m + self.way_m)
        cos, sin = np.cos(direction)[:, None], np.sin(direction)[:, None]
        ahead, left, up = np.moveaxis(self.joint_m, -1, 0)
        return np.stack(
            [x[:, None] + cos * ahead - sin * left, y[:, None] + sin * ahead + cos * left, up],
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
        left = _leaves_at(rng, clip, at)
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


def _leaves_at(rng: np.random.Generator, clip: Clip, begin: int) -> int:
    """Return the frame behind the last one of a clip that is played."""
    n, n_fade = len(clip.joint_m), _fade(clip.frame_rate_hz)
    earliest = max(begin + 2 * n_fade + 1, round(_FROM_SHARE * n))
    return n if earliest >= n else int(rng.integers(earliest, n + 1))


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


def _on_course(
    waypoints_m: Sequence[tuple[float, float]], radius_m: float, way_m: Array
) -> tuple[Array, Array, Array]:
    """Return x, y and direction at distances along a course, also before and beyond it."""
    begin, parts = bends(waypoints_m, radius_m)
    at, done_m = begin, 0.0
    x, y, direction = (np.empty_like(way_m) for _ in range(3))
    left = np.ones(len(way_m), np.bool_)
    for k, part in enumerate(parts):
        is_last = k == len(parts) - 1
        here = left & ((way_m < done_m + part.length_m) | is_last)
        way = way_m[here] - done_m
        half = 0.5 * part.curvature_per_m * np.clip(way, 0.0, part.length_m)
        inside = np.clip(way, 0.0, part.length_m)
        chord = inside * np.sinc(half / np.pi)
        turn = at[2] + 2 * half
        # Beyond an end it goes straight on.
        over = way - inside
        x[here] = at[0] + chord * np.cos(at[2] + half) + over * np.cos(turn)
        y[here] = at[1] + chord * np.sin(at[2] + half) + over * np.sin(turn)
        direction[here] = turn
        left &= ~here
        at, done_m = part.end(at, part.length_m), done_m + part.length_m
    return x, y, direction
