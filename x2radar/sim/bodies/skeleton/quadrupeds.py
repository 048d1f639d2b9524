"""Sizes of four-legged animals: their parts, and how they are drawn.

The hip is ``0.155 M^0.35`` m high, times what animals differ by.
"""

import numpy as np

from x2radar.keys import Key
from x2radar.sim.bodies.skeleton.skeleton import Part, Skeleton
from x2radar.sim.bodies.skeleton.species import Species
from x2radar.sim.bodies.skins.base import EchoGain

LEGS = ("left hind", "left fore", "right hind", "right fore")
ENDS = np.array([-1.0, 1.0, -1.0, 1.0])
"""At which end of the trunk each of `LEGS` is: 1 at the shoulder."""
SIDES = np.array([1.0, 1.0, -1.0, -1.0])  # on which side: 1 on the left
_JOINTS = {
    "left hind": ("HL_hip", "HL_knee", "HL_hock", "HL_paw"),
    "left fore": ("FL_shoulder", "FL_elbow", "FL_carpus", "FL_paw"),
    "right hind": ("HR_hip", "HR_knee", "HR_hock", "HR_paw"),
    "right fore": ("FR_shoulder", "FR_elbow", "FR_carpus", "FR_paw"),
}
_LEG_GIRTHS = {"upper leg": 0.068, "lower leg": 0.032, "paw": 0.046}
QUADRUPED = Skeleton(
    parts=(
        Part("trunk", ("pelvis", "withers"), (0.21, 0.25), 0.63),
        Part("chest", ("spine", "withers"), (0.20, 0.25), 0.24),
        Part("rump", ("pelvis", "spine"), (0.19, 0.21), 0.20),
        Part("neck", ("withers", "head"), (0.115, 0.115)),
        Part("head", ("head", "nose"), (0.147, 0.147)),
        Part("tail base", ("pelvis", "tail1"), (0.025, 0.025)),
        Part("tail middle", ("tail1", "tail2"), (0.025, 0.025)),
        Part("tail tip", ("tail2", "tail3"), (0.025, 0.025)),
        *(
            Part(f"{leg} {name}", (joints[k], joints[k + 1]), (girth, girth))
            for leg, joints in _JOINTS.items()
            for k, (name, girth) in enumerate(_LEG_GIRTHS.items())
        ),
    ),
    left=("HR_hip", "HL_hip"),
    n_trunk=3,
    # Legs are slender, and a recorded dog shows less of its tail, shanks and paws than of its
    # thighs.
    gain=EchoGain(
        max_power=0.0, losses=(((0, 1, 2), 5.0), ((5, 6, 7, 9, 10, 12, 13, 15, 16, 18, 19), 10.0))
    ),
)
"""Parts of four-legged animals; sizes in heights of the hip, those of a medium dog."""


class QuadrupedBuild:
    """Sizes of an animal, in metres but for its mass; SceneError if `mass_kg` is impossible."""

    def __init__(
        self, rng: np.random.Generator, species: Species, mass_kg: float | None = None
    ) -> None:
        drawn = species.mass_kg(rng)
        self.mass_kg = kg = drawn if mass_kg is None else mass_kg
        Key(*species.possible_kg).judge(kg, "mass_kg")
        self.hip_m = hip = 0.155 * kg**0.35 * species.tall(rng)  # height of the hip, standing
        self.back_m = hip * rng.uniform(*species.back)  # from hip to shoulder
        depth_over_width = rng.uniform(1.1, 1.3)
        # Volume of an ellipsoid; its first half-length is the trunk's of `half_lengths`.
        section = species.trunk_share * kg / 1000.0 / (4.0 / 3.0 * np.pi * 0.58 * self.back_m)
        self.half_width_m = float(np.sqrt(section / depth_over_width))  # of the trunk
        self.half_depth_m = depth_over_width * self.half_width_m
        leg = hip * species.leg
        # Links of a leg; both together are longer than `hip_m`.
        self.upper_m = leg * rng.uniform(0.46, 0.50)
        self.lower_m = leg - self.upper_m
        self.neck_m = hip * rng.uniform(*species.neck)
        self.head_m = hip * rng.uniform(*species.head)
        self.tail_m = hip * rng.uniform(*species.tail)
        # Length of a paw; its middle is half its height over the sole.
        self.paw_m = hip * rng.uniform(*species.paw)
        # Half the distance between left and right feet.
        self.half_track_m = self.half_width_m * rng.uniform(0.6, 0.9)

    def half_lengths(self) -> list[tuple[float, float, float]]:
        """Return half-lengths of the parts of `QUADRUPED`: along, to the side, across."""
        w, d = self.half_width_m, self.half_depth_m
        thick = 0.045 * self.hip_m
        tail = (self.tail_m / 6, 0.025 * self.hip_m, 0.025 * self.hip_m)
        leg = [
            (0.5 * self.upper_m, 1.5 * thick, 1.5 * thick),
            (0.5 * self.lower_m, 0.7 * thick, 0.7 * thick),
            (0.5 * self.paw_m, 0.3 * self.paw_m, 0.3 * self.paw_m),
        ]
        return [
            (0.58 * self.back_m, w, d),
            (0.95 * d, 0.95 * w, d),
            (0.8 * d, 0.9 * w, 0.85 * d),
            (0.55 * self.neck_m, 0.55 * w, 0.55 * w),
            (0.5 * self.head_m, 0.3 * self.head_m, 0.3 * self.head_m),
            *(tail,) * 3,
            *leg * 4,
        ]
