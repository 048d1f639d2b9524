"""Recorded motion: joints of a BVH file or a NumPy archive over time, as a body with any skin.

A BVH file (Biovision hierarchy) has a tree of joints with offsets and channels, then a row of
numbers a frame. Each joint but the root ends a segment that begins at its parent; an `End Site`
ends one too.

An archive has `position_m` (n_frames, n_joints, 3), `parent` (n_joints,), `frame_rate_hz` and
perhaps `names`. Joints with the standard names of a skeleton (`Part.joints`) move its parts; of
other trees each joint ends a segment that begins at its parent.
"""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path as FilePath
from typing import Self

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.skeleton.skeleton import PERSON, QUADRUPED, Part, Skeleton
from x2radar.sim.bodies.skins import TotalRcs
from x2radar.sim.points import UP, Array, Label, Pose

MAX_BYTES = 2**28  # largest file that is read, unpacked: two hours at 120 Hz as text
MAX_JOINTS = 200
_THICK_SHARE, _THICK_M = 0.18, (0.015, 0.12)  # half-widths where only the length is known: a share
_MIN_SEGMENT_M, _MIN_HALF_M, _MAX_HALF_M = 0.02, 0.005, 1.0  # shorter segments do not count
_N_LOOKS = 16  # over which the mean cross section is taken, as for people
_HIGH_QUANTILE = 0.9  # of a joint's height over time, for one that stands upright most of it


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """Parts of a recorded skeleton over time; a `Motion`."""

    skeleton: Skeleton
    half_m: Array  # (n_parts, 3): half-lengths of the parts, as `SKINS` take them
    joints: dict[str, int]  # numbers of the joints, by name
    position_m: Array  # (n_frames, n_joints, 3): joints in room coordinates
    velocity: Array  # the same by frame
    frame_rate_hz: float
    start_s: float = 0.0  # before, the body stands in its first posture

    @classmethod
    def of(
        cls, names: Sequence[str], parent: Sequence[int], position_m: Array, frame_rate_hz: float
    ) -> Self:
        """Return the motion of joints with parents (-1: root); SceneError if no body's."""
        at = {name: k for k, name in enumerate(names)}
        for skeleton, top in ((PERSON, "head_top"), (QUADRUPED, "HL_hip")):
            if all(name in at for part in skeleton.parts for name in part.joints):
                size_m = float(np.quantile(position_m[:, at[top], 2], _HIGH_QUANTILE))
                # Some rigs have one joint upon another.
                length = np.maximum(_lengths_m(skeleton, at, position_m), 2 * _MIN_HALF_M)
                half = skeleton.half_m(length, size_m)
                break
        else:
            at = {f"{k}": k for k in range(len(names))}
            rows = [(k, p) for k, p in enumerate(parent) if p >= 0]
            whole = Skeleton(tuple(Part(names[k], (f"{p}", f"{k}"), (0.0, 0.0)) for k, p in rows))
            long = _lengths_m(whole, at, position_m[:1]) > _MIN_SEGMENT_M
            skeleton = Skeleton(tuple(compress(whole.parts, long)))
            length = _lengths_m(skeleton, at, position_m)
            thick = np.clip(_THICK_SHARE * length, *_THICK_M)
            half = np.stack([length / 2, thick, thick], axis=1)
        if not len(half) or not 0.0 < half.min() <= half.max() <= _MAX_HALF_M:
            raise SceneError(
                f"segments must be longer than {100 * _MIN_SEGMENT_M:g} cm and shorter than "
                f"{2 * _MAX_HALF_M:g} m: is the scale right?"
            )
        velocity = np.gradient(position_m, axis=0) if len(position_m) > 1 else 0 * position_m
        return cls(skeleton, half, at, position_m, velocity, float(frame_rate_hz))

    def __call__(self, t_s: Array) -> Pose:
        last = len(self.position_m) - 1
        at = np.clip((t_s - self.start_s) * self.frame_rate_hz, 0.0, last)
        k = np.minimum(at.astype(np.int64), max(last - 1, 0))
        u, ends = (at - k)[:, None, None], [k, np.minimum(k + 1, last)]
        (begin, end), (leaves, arrives) = self.position_m[ends], self.velocity[ends]
        step, ease = end - begin, u * (1 - u)
        # A cubic with the positions and velocities of both frames.
        now = begin + u * step + ease * ((1 - u) * (leaves - step) - u * (arrives - step))
        joints = {name: now[:, j] for name, j in self.joints.items()}
        pose = Pose.between(self.skeleton.ends(joints), now[:, :1])
        if self.skeleton.left is None:
            side = np.cross(pose.axis, UP)
        else:
            right, left = (joints[name] for name in self.skeleton.left)
            way = (left - right)[:, None]
            side = way - (way * pose.axis).sum(axis=-1, keepdims=True) * pose.axis
        size = np.linalg.norm(side, axis=-1, keepdims=True)
        side = np.where(size > 1e-3, side / np.maximum(size, 1e-9), np.array([1.0, 0.0, 0.0]))
        return replace(pose, side=side)


def _lengths_m(skeleton: Skeleton, at: dict[str, int], position_m: Array) -> Array:
    ends = skeleton.ends({name: position_m[:, k] for name, k in at.items()})
    return np.array([np.linalg.norm(b - a, axis=-1).mean() for a, b in ends])


def read_motion(file: str | None, *, scale: float = 1.0, up: str = "y") -> RecordedMotion:
    """Read a .bvh file or .npz of joints, `scale` metres a unit, axis `up`; or SceneError."""
    if not isinstance(file, str):
        msg = f"file: must be the path of a BVH file or an archive of joint positions, not {file}"
        raise SceneError(msg)
    path = FilePath(file)
    try:
        if _n_bytes(path) > MAX_BYTES:
            raise SceneError(f"{file}: more than {MAX_BYTES >> 20} MiB: cut it into parts")
        if path.suffix == ".npz":
            names, parent, position, rate_hz = _read_archive(path)
        else:
            names, parent, position, rate_hz = read_bvh(path.read_text(encoding="utf-8-sig"))
    except OSError as err:
        raise SceneError(f"{file}: cannot read the motion ({err.strerror or err})") from err
    except (
        *(ValueError, LookupError, ArithmeticError, TypeError, StopIteration, RuntimeError),
        zipfile.BadZipFile,
    ) as err:
        msg = f"{file}: not a motion that can be read: {' '.join(str(err).split()) or 'cut short'}"
        raise SceneError(msg) from err
    if not np.isfinite(position).all() or not 1.0 <= rate_hz <= 1000.0:
        raise SceneError(f"{file}: positions must be finite and the frame rate 1 to 1000 Hz")
    metres = scale * position
    if up == "y":
        metres = metres[..., [0, 2, 1]] * np.array([1.0, -1.0, 1.0])
    return RecordedMotion.of(names, parent, np.ascontiguousarray(metres), rate_hz)


def _n_bytes(path: FilePath) -> int:
    """Return a file's size, an archive's unpacked."""
    if path.suffix != ".npz":
        return path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        return sum(entry.file_size for entry in archive.infolist())


def _read_archive(path: FilePath) -> tuple[list[str], list[int], Array, float]:
    with np.load(path, allow_pickle=False) as data:
        position = np.asarray(data["position_m"], np.float64)
        parent = [int(p) for p in data["parent"]]
        rate_hz = float(data["frame_rate_hz"])
        names = [str(n) for n in data["names"]] if "names" in data else []
    if position.ndim != 3 or position.shape[1:] != (len(parent), 3):
        raise ValueError(f"position_m has shape {position.shape} with {len(parent)} parents")
    if any(not -1 <= p < k for k, p in enumerate(parent)):
        raise ValueError("each joint's parent must stand before it")
    return names or [f"joint {k}" for k in range(len(parent))], parent, position, rate_hz


def draw_recorded(
    rng: np.random.Generator,
    *,
    file: str | None = None,
    label: Label = "human",
    scale: float = 1.0,
    up: str = "y",
    place_m: tuple[float, float] = (0.0, 0.0),
    turn_deg: float = 0.0,
    start_s: float = 0.0,
    total_rcs_dbsm: TotalRcs = None,
    skin: str = "surface",
) -> Body:
    """Draw the skin of a recorded skeleton; raises SceneError as `read_motion`."""
    motion = read_motion(file, scale=scale, up=up)
    cos, sin = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    motion = replace(
        motion,
        position_m=motion.position_m @ turn + np.array([*place_m, 0.0]),
        velocity=motion.velocity @ turn,
        start_s=start_s,
    )
    kind = motion.skeleton
    plan = BodyPlan(label, kind.names, motion.half_m, motion, kind.n_trunk, kind.gain)
    duration_s = (len(motion.position_m) - 1) / motion.frame_rate_hz
    looks_s = start_s + np.linspace(0.0, duration_s, _N_LOOKS)
    return plan.dressed(rng, skin, total_rcs_dbsm, looks_s)


@dataclass(slots=True)
class _Joint:
    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()


def read_bvh(text: str) -> tuple[list[str], list[int], Array, float]:
    """Return names, parents (-1: root), positions (n_frames, n_joints, 3) and frame rate."""
    lines = iter(enumerate(text.splitlines(), 1))
    joints = _hierarchy(lines)
    n_frames, step_s = (next(lines)[1].split()[-1] for _ in range(2))
    width = sum(len(j.channels) for j in joints)
    rows = [np.array(line.split(), np.float64) for _, line in lines if line.strip()]
    if not rows or len(rows) != int(n_frames) or any(len(row) != width for row in rows):
        raise ValueError(f"{len(rows)} rows of motion for {n_frames} frames of {width} channels")
    names, parent = [j.name for j in joints], [j.parent for j in joints]
    return names, parent, _forward(joints, rows), 1.0 / float(step_s)


def _hierarchy(lines: Iterator[tuple[int, str]]) -> list[_Joint]:
    """Read the tree; stop behind the line MOTION."""
    joints: list[_Joint] = []
    open_: list[int] = []
    for number, line in lines:
        word = line.split()
        if not word or word[0] in {"HIERARCHY", "{"}:
            continue
        if word[0] == "MOTION":
            return joints
        if word[0] in {"ROOT", "JOINT", "End"}:
            if len(joints) == MAX_JOINTS:
                raise ValueError(f"more than {MAX_JOINTS} joints")
            parent = open_[-1] if open_ else -1
            name = f"{joints[parent].name} end" if word[0] == "End" else " ".join(word[1:])
            joints.append(_Joint(name, parent, np.zeros(3)))
            open_.append(len(joints) - 1)
        elif word[0] == "OFFSET":
            x, y, z = (float(text) for text in word[1:4])
            joints[open_[-1]].offset = np.array([x, y, z])
        elif word[0] == "CHANNELS":
            joints[open_[-1]].channels = tuple(word[2 : 2 + int(word[1])])
        elif word[0] == "}":
            open_.pop()
        else:
            raise ValueError(f"line {number}: '{word[0]}' is no word of a BVH hierarchy")
    raise ValueError("no line MOTION")


def _forward(joints: Sequence[_Joint], rows: Sequence[Array]) -> Array:
    """Return joints' positions, shape (n_frames, n_joints, 3), in the file's units and axes."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow, for files alone

    values = np.stack(rows)
    n = len(values)
    place = np.zeros((n, len(joints), 3))
    turn = np.zeros((n, len(joints), 3, 3))
    at = 0
    for k, joint in enumerate(joints):
        moved = np.broadcast_to(joint.offset, (n, 3)).copy()
        local = np.broadcast_to(np.eye(3), (n, 3, 3))
        for channel in joint.channels:
            if channel.endswith("position"):
                axis = "XYZ".index(channel[0])
                # A root's position adds to its offset; that of other joints is the whole of it.
                first = joint.offset[axis] if joint.parent < 0 else 0.0
                moved[:, axis] = first + values[:, at]
            else:
                turn_by = Rotation.from_euler(channel[0], values[:, at, None], degrees=True)
                local = local @ turn_by.as_matrix()
            at += 1
        if joint.parent < 0:
            place[:, k], turn[:, k] = moved, local
        else:
            up = turn[:, joint.parent]
            place[:, k] = place[:, joint.parent] + (up @ moved[..., None])[..., 0]
            turn[:, k] = up @ local
    return place
