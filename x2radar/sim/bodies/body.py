"""A body: a motion that says where its parts are, a skin that says how they echo, and breath."""

from dataclasses import dataclass

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.skins import SKINS, THEORY, EchoGain, Skin, TotalRcs, sized
from x2radar.sim.points import Array, Label, Motion, Points, Pose

_CHEST = 1  # what is carried goes with this part
_NEAREST_M = 0.05  # an antenna within a chest sees it swell no faster than from here


@dataclass(frozen=True, slots=True)
class Breath:
    """Breathing and heartbeat at the trunk."""

    size_m: float  # how far the chest's surface moves either way
    rate_hz: float
    phase_rad: float  # at time 0
    beat_m: float = 0.0
    beat_hz: float = 1.2
    shares: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of trunk, chest, and hips or rump

    def at(self, t_s: Array) -> Array:
        """Return how far the chest wall has come out, in metres, at times of shape (n_slow,)."""
        turn = 2 * np.pi * self.rate_hz * t_s + self.phase_rad
        # The heart beats a little faster while somebody breathes in.
        beat = 2 * np.pi * self.beat_hz * t_s + 0.3 * np.sin(turn)
        # Breathing in is quicker than breathing out.
        breath_m = self.size_m * np.sin(turn + 0.35 * np.sin(turn))
        return np.asarray(breath_m + self.beat_m * np.sin(beat))


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A person, an animal, or a recording of one; see `Mover`."""

    label: Label  # what an alarm should take it for
    names: tuple[str, ...]  # of its points
    motion: Motion
    skin: Skin
    breath: Breath | None = None

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        pose = self.motion(t_s)
        if self.breath:
            # Breathing moves the surface of the trunk towards the antenna.
            trunk = pose.centre_m[:, : len(self.breath.shares)]
            towards = antenna_m - trunk
            distance = np.sqrt((towards**2).sum(axis=-1, keepdims=True))
            swell = self.breath.at(t_s)[:, None, None] * np.array(self.breath.shares)[:, None]
            trunk += towards * (swell / np.maximum(distance, _NEAREST_M))
        return self.skin.points(pose, antenna_m)


def carrying(motion: Motion, burden_m: Array) -> Motion:
    """Return a motion with one more part in its arms, (3,): ahead of, left of, over the chest."""

    def pose(t_s: Array) -> Pose:
        pose = motion(t_s)
        left, up = pose.side[:, 0], pose.axis[:, _CHEST]
        ahead, side = np.cross(left, up), pose.side
        place = pose.centre_m[:, _CHEST]
        place = place + burden_m[0] * ahead + burden_m[1] * left + burden_m[2] * up
        # What is carried has the trunk's side.
        side = side if side.shape[1] == 1 else np.concatenate([side, side[:, :1]], axis=1)
        centre_m = np.concatenate([pose.centre_m, place[:, None]], axis=1)
        return Pose(centre_m, np.concatenate([pose.axis, left[:, None]], axis=1), side)

    return pose


@dataclass(frozen=True, slots=True, eq=False)
class BodyPlan:
    """What a body is made from, before its skin is drawn."""

    label: Label
    parts: tuple[str, ...]  # names of the segments
    half_m: Array  # (n_parts, 3): half-lengths along, to the side, across
    motion: Motion
    n_trunk: int = 1
    gain: EchoGain = THEORY

    def dressed(
        self, rng: np.random.Generator, skin: str, total_rcs_dbsm: TotalRcs, looks_s: Array
    ) -> Body:
        """Return the body in a skin of `SKINS`; its mean total is over the times `looks_s`.

        Raises SceneError if skin or total is none that there may be.
        """
        Key(choices=tuple(SKINS)).judge(skin, "skin")
        drawn = SKINS[skin](rng, self.half_m, self.n_trunk, self.gain)
        drawn = sized(drawn, rng, total_rcs_dbsm, self.motion(looks_s))
        return Body(self.label, drawn.names(self.parts), self.motion, drawn)
