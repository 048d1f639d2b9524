"""Recorded motion as a body: a file's skeleton, put into the room, with any skin."""

from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.motion.recorded import RecordedMotion, read_motion
from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.skins.draw import TotalRcs
from x2radar.sim.points import Array, Label

_N_LOOKS = 16
"""Over which the mean cross section is taken, as for people."""


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """A recording somewhere in the room; a `Motion`."""

    motion: RecordedMotion
    place_m: Array  # (3,): where the file's origin lies in the room
    turn_rad: float  # about the vertical, to the left
    start_s: float

    def pose(self, t_s: Array) -> Pose:
        """Return the pose in the room; see `Motion`."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        pose = self.motion.pose(t_s - self.start_s)
        return Pose(pose.centre_m @ turn + self.place_m, pose.axis @ turn, pose.side @ turn)


def draw_recorded(
    rng: np.random.Generator,
    *,
    file: str,
    label: Label = "human",
    scale: float = 1.0,
    up: str = "y",
    place_m: tuple[float, float] = (0.0, 0.0),
    turn_deg: float = 0.0,
    start_s: float = 0.0,
    total_rcs_dbsm: TotalRcs = None,
    skin: str = "surface",
) -> Body:
    """Draw the skin of a recorded skeleton; raises SceneError as `read_motion`.

    The file is read as `read_motion` does; `label` is what an alarm should take it for. Its origin
    lies at `place_m`, turned to the left by `turn_deg`; before `start_s` the body stands in its
    first posture. `total_rcs_dbsm` and `skin` are as in `draw_person`.
    """
    motion = read_motion(file, scale=scale, up=up)
    placed = _Placed(motion, np.array([*place_m, 0.0]), float(np.deg2rad(turn_deg)), start_s)
    kind = motion.skeleton
    plan = BodyPlan(label, kind.names, motion.half_m, placed, kind.n_trunk, kind.gain)
    looks_s = start_s + np.linspace(0.0, motion.duration_s, _N_LOOKS)
    return plan.dressed(rng, skin, total_rcs_dbsm, looks_s)
