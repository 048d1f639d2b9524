"""Clips: recorded and animated motion, a folder of which is a source of bodies.

A clip is an archive (.npz) as `train-export motion import` writes it: `positions` (n_frames,
n_joints, 3) in metres, y up, the floor at 0; `joints` and `parents`; `frame_rate_hz`; and texts
that say of whom it is: `species`, `person` or `animal`, `action`, `source`, `licence`. Joints
bear the standard names of a skeleton (`x2radar.sim.bodies.skeleton`). Which joint of a file of
another program is which, a map says, a YAML file:

    kind: quadruped            # or person
    scale: 0.01                # metres per unit of the file; 1 without it
    up: y                      # or z; y without it
    joints: {pelvis: Hips, spine: Spine1, withers: Spine3, ...}
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from radard.config.json_file import parse_json
from x2radar.bounded_yaml import load_yaml
from x2radar.errors import SceneError
from x2radar.sim.points import Label
from x2train.motion.formats import RawMotion

Array = NDArray[np.float64]
RATE_HZ = 60.0  # of clips made here: that of an X2, twice what a person's movements need
_OTHER_SIDE = {"l": "r", "r": "l", "FL": "FR", "FR": "FL", "HL": "HR", "HR": "HL"}
_TEXTS = ("species", "person", "animal", "licence", "source")
_SMOOTH_S = 0.35  # the way of a body is its pelvis's, smoothed over a step of a small dog's
_GOES_MPS = 0.2  # of a clip's way: faster ones go somewhere, others stay in their place
_STEERS_MPS = 0.1  # below, the direction of the way is that of the moments before and after


@dataclass(frozen=True, eq=False)
class Clip:
    """One clip: where joints are, seen from a point that moves along the body's smoothed way.

    `joint_m`, shape (n_frames, n_joints, 3), is ahead, to the left and up, from the floor beneath
    that point; `step_m`, shape (n_frames,), how far it goes from each frame to the next. Clips of
    one `individual` can follow each other. `slip` is how far feet that stand slide, against how
    far the body goes; None where that is not said, as of a recording. Licence, source and hash are
    for a bundle's card.
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
    slip: float | None

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
        swapped = []
        for name in self.joints:
            # l_knee for r_knee, FR_paw for FL_paw.
            side, _, rest = name.partition("_")
            twin = f"{_OTHER_SIDE.get(side)}_{rest}"
            swapped.append(self.joints.index(twin if twin in self.joints else name))
        return replace(self, joint_m=self.joint_m[:, swapped] * np.array([1.0, -1.0, 1.0]))


def read_clip(path: Path) -> Clip:
    """Read a clip; raises SceneError, one line with the file, if it is none."""
    try:
        data = path.read_bytes()
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            position = np.asarray(file["positions"], np.float64)
            joints = tuple(str(name) for name in file["joints"])
            parents = tuple(int(k) for k in file["parents"])
            rate_hz = float(file["frame_rate_hz"])
            text = {key: str(file[key]) for key in _TEXTS if key in file}
            slip = float(file["slip_ratio"]) if "slip_ratio" in file else None
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as err:
        raise SceneError(f"{path}: not a clip: {' '.join(str(err).split())}") from err
    fits = position.ndim == 3 and position.shape[1:] == (len(joints), 3) == (len(parents), 3)
    if not fits or len(position) < 3 or not np.isfinite(position).all() or not rate_hz > 0:
        raise SceneError(f"{path}: not a clip: {len(joints)} joints, positions {position.shape}")
    # From y up to z up, and to the right-handed axes of rooms.
    joint_m, step_m = _along_its_way(position[..., [0, 2, 1]] * [1.0, -1.0, 1.0], rate_hz)
    label: Label = "human" if text.get("species", "human") == "human" else "pet"
    return Clip(
        name=path.stem,
        label=label,
        individual=text.get("person") or text.get("animal") or path.stem,
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
    x, y = np.moveaxis(position_m[..., :2] - way[:, None], -1, 0)
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    seen = np.stack([cos * x + sin * y, -sin * x + cos * y, position_m[..., 2]], axis=-1)
    return seen, step_m


def _tree(*chains: str) -> Mapping[str, str]:
    """Return joints and their parents, from chains that each begin at a joint that is there."""
    parents: dict[str, str] = {}
    for chain in chains:
        names = chain.split()
        parents.setdefault(names[0], "")
        parents |= dict(zip(names[1:], names, strict=False))
    return parents


KINDS: Mapping[str, Mapping[str, str]] = {
    "person": _tree(
        "pelvis spine chest neck head head_top",
        *(f"pelvis {s}_hip {s}_knee {s}_ankle {s}_ball {s}_toe" for s in "lr"),
        *(f"chest {s}_shoulder {s}_elbow {s}_wrist {s}_hand" for s in "lr"),
    ),
    "quadruped": _tree(
        "pelvis spine withers neck head nose",
        "pelvis tail1 tail2 tail3",
        *(f"withers F{s}_shoulder F{s}_elbow F{s}_carpus F{s}_paw" for s in "LR"),
        *(f"pelvis H{s}_hip H{s}_knee H{s}_hock H{s}_paw" for s in "LR"),
    ),
}
"""Standard joints of a kind, and the parent of each; the root's is empty."""


@dataclass(frozen=True, slots=True)
class JointMap:
    """Which joint of a file is which of the standard ones."""

    __pydantic_config__ = ConfigDict(extra="forbid", coerce_numbers_to_str=True)

    kind: Literal["person", "quadruped"]
    joints: dict[str, str]
    scale: Annotated[float, Field(gt=0)] = 1.0
    up: Literal["y", "z"] = "y"


def read_map(path: Path) -> JointMap:
    """Read a map; SceneError if it cannot be read, or its joints are not all there are."""
    try:
        raw = load_yaml(path.read_text("utf-8-sig"))
        made = parse_json(JointMap, json.dumps(raw, default=str))
    except (OSError, ValueError) as err:
        why = err.strerror if isinstance(err, OSError) else err
        raise SceneError(f"{path}: no map that can be read: {why}") from err
    standard = KINDS[made.kind]
    for word, names in (
        ("no standard joint", set(made.joints) - set(standard)),
        ("not given", set(standard) - set(made.joints)),
    ):
        if names:
            raise SceneError(f"{path}: joints: {word}: {', '.join(sorted(names))}")
    return made


def standard_clip(motion: RawMotion, joint_map: JointMap, where: str) -> dict[str, Any]:
    """Return the arrays of a clip: standard joints, y up, the floor at 0, at `RATE_HZ`."""
    at = {name: k for k, name in enumerate(motion.joints)}
    standard = KINDS[joint_map.kind]
    missing = sorted({name for name in joint_map.joints.values() if name not in at})
    if missing:
        msg = f"{where}: no joint {', '.join(missing)}; it has {', '.join(motion.joints[:40])}"
        raise SceneError(msg)
    position = joint_map.scale * motion.position[:, [at[joint_map.joints[n]] for n in standard]]
    if joint_map.up == "z":
        position = position[..., [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
    position[..., 1] -= np.quantile(position[..., 1].min(axis=1), 0.02)
    if len(position) > 3 and motion.frame_rate_hz != RATE_HZ:
        t_s = np.arange(len(position)) / motion.frame_rate_hz
        n = int(t_s[-1] * RATE_HZ) + 1
        position = CubicSpline(t_s, position)(np.arange(n) / RATE_HZ)
    names = list(standard)
    parents = [names.index(parent) if parent else -1 for parent in standard.values()]
    return {
        "positions": position.astype(np.float32),
        "joints": np.array(names),
        "parents": np.array(parents, np.int16),
        "frame_rate_hz": np.float32(RATE_HZ),
    }
