"""Recorded motion: skeletons from BVH files, joint positions from NumPy archives.

A BVH file (Biovision hierarchy) has a tree of joints with offsets and channels, then a row of
numbers a frame. Each joint but the root ends a segment that begins at its parent; an `End Site`
ends one too. An archive has `position_m` (n_frames, n_joints, 3), `parent` (n_joints,) and
`frame_rate_hz`. Between frames positions are interpolated linearly; before the first and after
the last frame the body stands still.
"""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError

Array = NDArray[np.float64]

MOST_JOINTS, MOST_FRAMES = 200, 2_000_000
"""Limits of what is read: 2 million frames are two hours at 240 Hz."""
MOST_BYTES = 2**28
"""Largest file that is read, unpacked: two hours at 120 Hz as text."""
_AXES = {"X": 0, "Y": 1, "Z": 2}
_THICK_SHARE, _THICK_M = 0.18, (0.015, 0.12)
"""Half-widths of segments whose flesh is unknown: a share of their length, within limits; chosen
to give limbs their usual girth."""
_LEAST_SEGMENT_M = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """Segments of a recorded skeleton over time.

    Attributes
    ----------
    names : tuple of str
        Of the segments, by the joint at their end.
    half_m : ndarray, shape (n_segments, 3), float64
        Half-lengths of the segments, as `draw_skin` takes them.
    begin, end : ndarray, shape (n_segments,), int
        Joints.
    position_m : ndarray, shape (n_frames, n_joints, 3), float64
        Joints in room coordinates.
    frame_rate_hz : float
        Of the recording.
    """

    names: tuple[str, ...]
    half_m: Array
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    position_m: Array
    frame_rate_hz: float

    @classmethod
    def of(
        cls, names: Sequence[str], parent: Sequence[int], position_m: Array, frame_rate_hz: float
    ) -> Self:
        """Return the motion of joints whose parents are known (-1 for the root)."""
        rows = [
            (k, p)
            for k, p in enumerate(parent)
            if p >= 0 and np.linalg.norm(position_m[0, k] - position_m[0, p]) > _LEAST_SEGMENT_M
        ]
        if not rows:
            msg = f"no segment is longer than {100 * _LEAST_SEGMENT_M:g} cm: is the scale right?"
            raise SceneError(msg)
        end = np.array([k for k, _ in rows])
        begin = np.array([p for _, p in rows])
        length = np.linalg.norm(position_m[:, end] - position_m[:, begin], axis=-1).mean(axis=0)
        thick = np.clip(_THICK_SHARE * length, *_THICK_M)
        half = np.stack([length / 2, thick, thick], axis=1)
        return cls(
            tuple(names[k] for k, _ in rows), half, begin, end, position_m, float(frame_rate_hz)
        )

    def posture(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return middles, axes and side vectors of all segments at times of shape (n_slow,)."""
        last = len(self.position_m) - 1
        at = np.clip(t_s * self.frame_rate_hz, 0.0, last)
        k = np.minimum(at.astype(np.int64), max(last - 1, 0))
        share = (at - k)[:, None, None]
        now = (1 - share) * self.position_m[k] + share * self.position_m[np.minimum(k + 1, last)]
        way = now[:, self.end] - now[:, self.begin]
        axis = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        side = np.cross(axis, np.array([0.0, 0.0, 1.0]))
        size = np.linalg.norm(side, axis=-1, keepdims=True)
        side = np.where(size > 1e-3, side / np.maximum(size, 1e-9), np.array([1.0, 0.0, 0.0]))
        return 0.5 * (now[:, self.end] + now[:, self.begin]), axis, side

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return (len(self.position_m) - 1) / self.frame_rate_hz


def read_motion(file: str, *, scale: float = 1.0, up: str = "y") -> RecordedMotion:
    """Read a BVH file, or an archive of joint positions.

    Parameters
    ----------
    file : str
        Path; its suffix decides (.bvh or .npz).
    scale : float
        Metres per unit of the file: 0.01 for centimetres, which BVH files often have.
    up : {'y', 'z'}
        Which axis of the file points up.

    Raises
    ------
    SceneError
        If the file cannot be read or makes no sense; one line with the line's number.
    """
    path = FilePath(file)
    try:
        if _n_bytes(path) > MOST_BYTES:
            msg = f"{file}: more than {MOST_BYTES >> 20} MiB: cut it into parts"
            raise SceneError(msg)
        if path.suffix == ".npz":
            names, parent, position, rate_hz = _read_archive(path)
        else:
            text = path.read_text(encoding="utf-8", errors="strict")
            names, parent, position, rate_hz = _read_bvh(text)
    except OSError as err:
        msg = f"{file}: cannot read the motion ({err.strerror or err})"
        raise SceneError(msg) from err
    except (
        *(ValueError, LookupError, ArithmeticError, TypeError, StopIteration, RuntimeError),
        zipfile.BadZipFile,
    ) as err:
        msg = f"{file}: not a motion that can be read: {' '.join(str(err).split()) or 'cut short'}"
        raise SceneError(msg) from err
    if not np.isfinite(position).all() or not 1.0 <= rate_hz <= 1000.0:
        msg = f"{file}: positions must be finite and the frame rate 1 to 1000 Hz"
        raise SceneError(msg)
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
        msg = f"position_m has shape {position.shape} with {len(parent)} parents"
        raise ValueError(msg)
    if any(not -1 <= p < k for k, p in enumerate(parent)):
        msg = "each joint's parent must stand before it"
        raise ValueError(msg)
    return names or [f"joint {k}" for k in range(len(parent))], parent, position, rate_hz


@dataclass(slots=True)
class _Joint:
    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...] = ()


def _read_bvh(text: str) -> tuple[list[str], list[int], Array, float]:
    lines = iter(enumerate(text.splitlines(), 1))
    joints = _hierarchy(lines)
    word = next(lines)[1].split()
    n_frames = int(word[-1])
    rate_hz = 1.0 / float(next(lines)[1].split()[-1])
    width = sum(len(j.channels) for j in joints)
    if not 1 <= n_frames <= MOST_FRAMES:
        msg = f"{n_frames} frames; 1 to {MOST_FRAMES} can be read"
        raise ValueError(msg)
    rows = [np.array(line.split(), np.float64) for _, line in lines if line.strip()]
    if len(rows) != n_frames or any(len(row) != width for row in rows):
        msg = f"{len(rows)} rows of motion for {n_frames} frames of {width} channels"
        raise ValueError(msg)
    return [j.name for j in joints], [j.parent for j in joints], _forward(joints, rows), rate_hz


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
            if len(joints) == MOST_JOINTS:
                msg = f"more than {MOST_JOINTS} joints"
                raise ValueError(msg)
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
            msg = f"line {number}: '{word[0]}' is no word of a BVH hierarchy"
            raise ValueError(msg)
    msg = "no line MOTION"
    raise ValueError(msg)


def _forward(joints: Sequence[_Joint], rows: Sequence[Array]) -> Array:
    """Return joints' positions, shape (n_frames, n_joints, 3), in the file's units and axes."""
    values = np.stack(rows)
    n = len(values)
    place = np.zeros((n, len(joints), 3))
    turn = np.zeros((n, len(joints), 3, 3))
    at = 0
    for k, joint in enumerate(joints):
        moved = np.broadcast_to(joint.offset, (n, 3)).copy()
        local = np.broadcast_to(np.eye(3), (n, 3, 3))
        for channel in joint.channels:
            axis = _AXES[channel[0]]
            if channel.endswith("position"):
                # A root's position adds to its offset; that of other joints is the whole of it.
                first = joint.offset[axis] if joint.parent < 0 else 0.0
                moved[:, axis] = first + values[:, at]
            else:
                local = local @ _turned(axis, np.deg2rad(values[:, at]))
            at += 1
        if joint.parent < 0:
            place[:, k], turn[:, k] = moved, local
        else:
            up = turn[:, joint.parent]
            place[:, k] = place[:, joint.parent] + (up @ moved[..., None])[..., 0]
            turn[:, k] = up @ local
    return place


def _turned(axis: int, angle_rad: Array) -> Array:
    """Return rotations about one axis, shape (n_frames, 3, 3)."""
    made = np.zeros((len(angle_rad), 3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    made[:, axis, axis] = 1.0
    made[:, a, a], made[:, b, b] = cos, cos
    made[:, a, b], made[:, b, a] = -sin, sin
    return made
