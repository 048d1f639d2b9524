"""Files of motion of other programs: their joints over time, in the file's own units and axes.

BVH (Biovision), ASF with AMC (Acclaim), glTF 2.0 (by pygltflib) and NumPy archives. Whatever the
file holds, only the positions of its joints are kept.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from x2radar.errors import SceneError
from x2radar.sim.bodies.motion.recorded import read_bvh

Array = NDArray[np.float64]
SUFFIXES = (".bvh", ".amc", ".gltf", ".glb", ".npz")
_GLTF_RATE_HZ = 60.0  # animations of glTF are curves: they are sampled as often as the X2 looks
_COMPONENTS = {5126: "<f4", 5123: "<u2", 5122: "<i2", 5121: "<u1", 5120: "<i1"}  # of glTF
_MAX_FRAMES = 200_000  # nearly an hour at 60 Hz


@dataclass(frozen=True, slots=True, eq=False)
class RawMotion:
    """Joints of one animation of a file."""

    name: str
    joints: tuple[str, ...]
    position: Array  # (n_frames, n_joints, 3)
    frame_rate_hz: float


def read_motions(
    path: Path, *, asf: Path | None = None, rate_hz: float = 120.0
) -> list[RawMotion]:
    """Read all animations of a file of `SUFFIXES`, AMC with `asf` and `rate_hz`; or SceneError."""
    try:
        found = list(_read(path, asf, rate_hz))
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror or err})") from err
    except Exception as err:
        # A file cut short or spoilt makes parsers raise nearly anything.
        msg = f"{path}: no motion that can be read: {' '.join(str(err).split()) or 'cut short'}"
        raise SceneError(msg) from err
    for motion in found:
        if not np.isfinite(motion.position).all() or not 1.0 <= motion.frame_rate_hz <= 1000.0:
            raise SceneError(f"{path}: positions must be finite and the frame rate 1 to 1000 Hz")
    return found


def _read(path: Path, asf: Path | None, rate_hz: float) -> Iterator[RawMotion]:
    suffix = path.suffix.lower()
    if suffix == ".bvh":
        joints, _, position, own_hz = read_bvh(path.read_text("utf-8-sig"))
        yield RawMotion(path.stem, tuple(joints), position, own_hz)
    elif suffix == ".amc":
        same = asf or path.with_suffix(".asf")
        found = [same] if asf or same.exists() else sorted(path.parent.glob("*.asf"))
        if len(found) != 1:
            raise ValueError(f"{len(found)} files .asf beside it; name one with --asf")
        skeleton = _read_asf(found[0].read_text("latin-1"))
        yield _read_amc(path.read_text("latin-1"), skeleton, path.stem, rate_hz)
    elif suffix in {".gltf", ".glb"}:
        yield from _read_gltf(path)
    elif suffix == ".npz":
        with np.load(path, allow_pickle=False) as data:
            position, own_hz = np.asarray(data["positions"], float), float(data["frame_rate_hz"])
            names = tuple(str(name) for name in data["joints"])
        if position.ndim != 3 or position.shape[1:] != (len(names), 3):
            raise ValueError(f"positions of shape {position.shape} for {len(names)} joints")
        yield RawMotion(path.stem, names, position, own_hz)
    else:
        raise ValueError(f"known are {', '.join(SUFFIXES)}")


@dataclass(slots=True)
class _Bone:
    """A bone of an ASF file: its end is a joint."""

    parent: int
    offset: Array  # from its beginning to its end, in the room's axes
    axes: Rotation
    freedoms: tuple[str, ...]


def _turn(order: str, degrees: Array) -> Rotation:
    """Return a rotation about fixed axes, in their order."""
    return Rotation.from_euler(order.lower(), degrees, degrees=True)


def _read_asf(text: str) -> dict[str, _Bone]:
    """Return the bones of a skeleton by name, parents first; the first one is the root."""
    bones = {"root": _Bone(-1, np.zeros(3), Rotation.identity(), ())}
    made: dict[str, dict[str, list[str]]] = {}
    section, bone = "", dict[str, list[str]]()
    for line in text.splitlines():
        words = line.split("#")[0].replace("(", " ").replace(")", " ").split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":bonedata":
            if words[0] == "begin":
                bone = {}
            elif words[0] == "end":
                made[bone["name"][0]] = bone
            else:
                bone[words[0]] = words[1:]
        elif section == ":hierarchy" and words[0] not in {"begin", "end"}:
            for name in words[1:]:
                row = made[name]
                offset = np.array(row["direction"], float) * float(row["length"][0])
                *degrees, order = row["axis"]
                axes = _turn(order, np.array(degrees, float))
                parent = list(bones).index(words[0])
                bones[name] = _Bone(parent, offset, axes, tuple(row.get("dof", ())))
    return bones


def _read_amc(text: str, bones: dict[str, _Bone], name: str, rate_hz: float) -> RawMotion:
    """Return the joints of an AMC file: the root, and the end of every bone."""
    frames: list[dict[str, list[float]]] = []
    for line in text.splitlines():
        words = line.split()
        if not words or words[0][0] in "#:":
            continue
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
        else:
            frames[-1][words[0]] = [float(x) for x in words[1:]]
    n = len(frames)
    if not 1 <= n <= _MAX_FRAMES:
        raise ValueError(f"{n} frames; 1 to {_MAX_FRAMES} can be read")
    place = np.zeros((n, len(bones), 3))
    turns: list[Rotation] = []
    for k, (key, bone) in enumerate(bones.items()):
        if bone.parent < 0:
            values = np.array([frame[key] for frame in frames])
            place[:, k] = values[:, :3]
            turns.append(_turn("xyz", values[:, 3:6]))
            continue
        local = Rotation.identity(n)
        if bone.freedoms:
            values = np.array([frame.get(key, [0.0] * len(bone.freedoms)) for frame in frames])
            turning = {c: dof[1] for c, dof in enumerate(bone.freedoms) if dof[0] == "r"}
            if turning:
                local = _turn("".join(turning.values()), values[:, list(turning)])
        turn = turns[bone.parent] * (bone.axes * local * bone.axes.inv())
        turns.append(turn)
        place[:, k] = place[:, bone.parent] + turn.apply(bone.offset)
    return RawMotion(name, tuple(bones), place, rate_hz)


def _read_gltf(path: Path) -> Iterator[RawMotion]:
    import pygltflib  # noqa: PLC0415 - slow, and for these files alone

    gltf = pygltflib.GLTF2().load(str(path))
    nodes = gltf.nodes
    parents = {child: k for k, node in enumerate(nodes) for child in node.children or ()}

    def depth(k: int) -> int:
        return 1 + depth(parents[k]) if k in parents else 0

    skinned = sorted({joint for skin in gltf.skins or () for joint in skin.joints})
    joints = skinned or list(range(len(nodes)))
    # Parents first, whatever the order of the file.
    order = sorted(range(len(nodes)), key=depth)
    for number, animation in enumerate(gltf.animations or ()):
        curves = _curves(gltf, animation)
        end_s = max(float(times[-1]) for times, _ in curves.values())
        n = int(end_s * _GLTF_RATE_HZ) + 1
        if n > _MAX_FRAMES:
            raise ValueError(f"an animation of {end_s:.0f} s")
        t_s = np.arange(n) / _GLTF_RATE_HZ
        place: dict[int, Array] = {}
        turn: dict[int, Array] = {}
        for k in order:
            local_place, local_turn = _local(nodes[k], k, curves, t_s)
            if k in parents:
                up = turn[parents[k]]
                place[k] = place[parents[k]] + (up @ local_place[..., None])[..., 0]
                turn[k] = up @ local_turn
            else:
                place[k], turn[k] = local_place, local_turn
        joints.sort(key=order.index)
        yield RawMotion(
            f"{path.stem}_{animation.name or number}",
            tuple(nodes[k].name or f"node {k}" for k in joints),
            np.stack([place[k] for k in joints], axis=1),
            _GLTF_RATE_HZ,
        )


def _curves(gltf: Any, animation: Any) -> dict[tuple[int, str], tuple[Array, Array]]:
    """Return times and values of what an animation moves, by node and property."""
    curves = {}
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        times, values = (_accessor(gltf, k) for k in (sampler.input, sampler.output))
        if sampler.interpolation == "CUBICSPLINE":
            # Each key has a tangent, a value and a tangent.
            values = values[1::3]
        curves[channel.target.node, channel.target.path] = times.ravel(), values
    return curves


def _accessor(gltf: Any, k: int) -> Array:
    """Return the numbers of an accessor, shape (count, width)."""
    accessor = gltf.accessors[k]
    view = gltf.bufferViews[accessor.bufferView]
    uri = gltf.buffers[view.buffer].uri
    data = gltf.get_data_from_buffer_uri(uri) if uri else gltf.binary_blob()
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    kind = _COMPONENTS[accessor.componentType]
    size = np.dtype(kind).itemsize * width
    stride = view.byteStride or size
    begin = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    # Unlike as_strided it reads nothing beyond the end of a file that counts too much.
    rows = np.ndarray((accessor.count, size), np.uint8, data, begin, (stride, 1))
    values = np.ascontiguousarray(rows).view(kind).astype(np.float64)
    if kind != "<f4":
        values = np.maximum(values / np.iinfo(np.dtype(kind)).max, -1.0)
    return values.reshape(accessor.count, width)


def _local(
    node: Any, k: int, curves: Mapping[tuple[int, str], tuple[Array, Array]], t_s: Array
) -> tuple[Array, Array]:
    """Return a node's place and turn against its parent, over time; scales of joints are left."""
    n = len(t_s)
    scale = np.ones(3)
    if node.matrix:
        matrix = np.array(node.matrix).reshape(4, 4).T
        place, turn = matrix[:3, 3], matrix[:3, :3]
    else:
        place = np.array(node.translation or (0.0, 0.0, 0.0))
        scale = np.array(node.scale or (1.0, 1.0, 1.0))
        turn = Rotation.from_quat(node.rotation or (0.0, 0.0, 0.0, 1.0)).as_matrix() * scale
    places, turns = np.broadcast_to(place, (n, 3)), np.broadcast_to(turn, (n, 3, 3))
    if (k, "translation") in curves:
        times, values = curves[k, "translation"]
        places = np.stack([np.interp(t_s, times, column) for column in values.T], axis=1)
    if (k, "rotation") in curves:
        times, values = curves[k, "rotation"]
        if len(times) > 1:
            within = np.clip(t_s, times[0], times[-1])
            turns = Slerp(times, Rotation.from_quat(values))(within).as_matrix() * scale
        else:
            turns = np.broadcast_to(Rotation.from_quat(values[0]).as_matrix() * scale, (n, 3, 3))
    return places, turns
