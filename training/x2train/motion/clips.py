"""Clips: recorded and animated motion, a folder of which is a source of bodies.

A clip is an archive (.npz) as `train-export motion import` writes it: `positions` (n_frames,
n_joints, 3) in metres, y up, the floor at 0; `joints` and `parents`; `frame_rate_hz`; and texts
that say of whom it is: `species`, `person` or `animal`, `action`, `source`, `licence`. Joints
bear the standard names of a skeleton (`x2radar.sim.bodies.skeleton`).
"""

import hashlib
import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from x2radar.errors import SceneError
from x2radar.sim.points import Label

Array = NDArray[np.float64]

_SMOOTH_S = 0.35  # the way of a body is its pelvis's, smoothed over a step of a small dog's
_GOES_MPS = 0.2  # of a clip's way: faster ones go somewhere, others stay in their place
_STEERS_MPS = 0.1  # below, the direction of the way is that of the moments before and after


@dataclass(frozen=True, eq=False)
class Clip:
    """One clip: where joints are, seen from a point that moves along the body's smoothed way.

    `joint_m`, shape (n_frames, n_joints, 3), is ahead, to the left and up, from the floor beneath
    that point; `step_m`, shape (n_frames,), how far it goes from each frame to the next. Clips of
    one `individual` can follow each other. `slip` is how far feet that stand slide, against how
    far the body goes: 0 where it was recorded. Licence, source and hash are for a bundle's card.
    """

    name: str
    label: Label
    individual: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    frame_rate_hz: float
    joint_m: Array
    step_m: Array
    licence: str
    source: str
    sha256: str
    slip: float

    @property
    def goes(self) -> bool:
        """Whether the body travels, instead of moving in place."""
        return bool(self.step_m.mean() * self.frame_rate_hz > _GOES_MPS)

    @cached_property
    def size_m(self) -> float:
        """Height of the withers, or of the top of the head: of the body, stretched."""
        name = "head_top" if "head_top" in self.joints else "withers"
        return float(np.quantile(self.joint_m[:, self.joints.index(name), 2], 0.9))

    def mirrored(self) -> "Clip":
        """Return the clip seen in a mirror: left is right."""
        swapped = [self.joints.index(_other_side(name, self.joints)) for name in self.joints]
        joint_m = self.joint_m[:, swapped] * np.array([1.0, -1.0, 1.0])
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Clip(**{**fields, "joint_m": joint_m})


def _other_side(name: str, names: Sequence[str]) -> str:
    """Return the joint on the other side: l_knee for r_knee, FR_paw for FL_paw."""
    head, _, rest = name.partition("_")
    other = {"l": "r", "r": "l", "FL": "FR", "FR": "FL", "HL": "HR", "HR": "HL"}.get(head)
    twin = f"{other}_{rest}"
    return twin if other and twin in names else name


def read_clip(path: Path) -> Clip:
    """Read a clip; raises SceneError, one line with the file, if it is none."""
    try:
        data = path.read_bytes()
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            position = np.asarray(file["positions"], np.float64)
            joints = tuple(str(name) for name in file["joints"])
            parents = tuple(int(k) for k in file["parents"])
            rate_hz = float(file["frame_rate_hz"])
            text = {
                key: str(file[key])
                for key in ("species", "person", "animal", "licence", "source")
                if key in file
            }
            slip = float(file["slip_ratio"]) if "slip_ratio" in file else 0.0
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as err:
        raise SceneError(f"{path}: not a clip: {' '.join(str(err).split())}") from err
    fits = position.ndim == 3 and position.shape[1:] == (len(joints), 3) == (len(parents), 3)
    if not fits or len(position) < 3 or not np.isfinite(position).all() or not rate_hz > 0:
        raise SceneError(f"{path}: not a clip: {len(joints)} joints, positions {position.shape}")
    # From y up to z up, and to the right-handed axes of rooms.
    joint_m, step_m = _along_its_way(position[..., [0, 2, 1]] * [1.0, -1.0, 1.0], rate_hz)
    label: Label = "human" if text.get("species", "human") == "human" else "pet"
    who = text.get("person") or text.get("animal") or path.stem
    return Clip(
        name=path.stem,
        label=label,
        individual=who,
        joints=joints,
        parents=parents,
        frame_rate_hz=rate_hz,
        joint_m=joint_m,
        step_m=step_m,
        licence=text.get("licence", ""),
        source=text.get("source", ""),
        sha256=hashlib.sha256(data).hexdigest(),
        slip=slip,
    )


def read_clips(folder: Path) -> tuple[Clip, ...]:
    """Read all clips in and below a folder, by name; SceneError if there is none."""
    found = tuple(read_clip(path) for path in sorted(folder.rglob("*.npz")))
    if not found:
        raise SceneError(f"{folder}: no clips (.npz) in it; see train-export motion import")
    return found


def _along_its_way(position_m: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return joints from a point on the smoothed way, and that point's steps."""
    root = position_m[:, 0, :2]
    sigma = _SMOOTH_S * rate_hz
    n = min(len(root) - 1, round(4 * sigma))
    # Turned about its ends, so that a body that goes goes on beyond them.
    begin = 2 * root[0] - root[n:0:-1]
    end = 2 * root[-1] - root[-2 : -n - 2 : -1]
    whole = np.concatenate([begin, root, end])
    way = gaussian_filter1d(whole, sigma, axis=0)[n : n + len(root)]
    velocity = np.gradient(way, axis=0) * rate_hz
    speed = np.linalg.norm(velocity, axis=1)
    if speed.mean() <= _GOES_MPS:
        # It stays: its place is the middle of where it was.
        way = np.broadcast_to(way.mean(axis=0), way.shape)
        heading = np.zeros(len(root))
        step_m = np.zeros(len(root))
    else:
        steers = np.flatnonzero(speed > _STEERS_MPS)
        direction = np.unwrap(np.arctan2(velocity[steers, 1], velocity[steers, 0]))
        heading = np.interp(np.arange(len(root)), steers, direction)
        step_m = speed / rate_hz
    off = position_m.copy()
    off[..., :2] -= way[:, None]
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    ahead = cos * off[..., 0] + sin * off[..., 1]
    left = -sin * off[..., 0] + cos * off[..., 1]
    return np.stack([ahead, left, off[..., 2]], axis=-1), step_m
