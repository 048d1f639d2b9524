"""Skeletons from BVH files (Biovision hierarchy).

A file has a tree of joints with offsets and channels, then a row of numbers a frame. Each joint
but the root ends a segment that begins at its parent; an `End Site` ends one too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from x2radar.sim.points import Array

MAX_JOINTS, MAX_FRAMES = 200, 2_000_000  # two million frames are two hours at 240 Hz


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
    word = next(lines)[1].split()
    n_frames = int(word[-1])
    rate_hz = 1.0 / float(next(lines)[1].split()[-1])
    width = sum(len(j.channels) for j in joints)
    if not 1 <= n_frames <= MAX_FRAMES:
        raise ValueError(f"{n_frames} frames; 1 to {MAX_FRAMES} can be read")
    rows = [np.array(line.split(), np.float64) for _, line in lines if line.strip()]
    if len(rows) != n_frames or any(len(row) != width for row in rows):
        raise ValueError(f"{len(rows)} rows of motion for {n_frames} frames of {width} channels")
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
