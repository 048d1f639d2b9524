"""Clips that are made here: a person who strides, a dog that stands."""

import numpy as np

from x2train.motion.clips import KINDS

RATE_HZ = 60.0
_PERSON = {
    "pelvis": (0, 0, 0.95), "spine": (0, 0, 1.1), "chest": (0, 0, 1.35), "neck": (0, 0, 1.5),
    "head": (0.02, 0, 1.6), "head_top": (0.02, 0, 1.8), "hip": (0, 0.1, 0.92),
    "knee": (0.02, 0.1, 0.5), "ankle": (0, 0.1, 0.08), "ball": (0.14, 0.1, 0.03),
    "toe": (0.2, 0.1, 0.03), "shoulder": (0, 0.2, 1.42), "elbow": (0, 0.22, 1.12),
    "wrist": (0.05, 0.22, 0.88), "hand": (0.08, 0.22, 0.8),
}  # fmt: skip
_DOG = {
    "pelvis": (-0.25, 0, 0.5), "spine": (0, 0, 0.52), "withers": (0.25, 0, 0.54),
    "neck": (0.35, 0, 0.6), "head": (0.45, 0, 0.68), "nose": (0.58, 0, 0.64),
    "tail1": (-0.32, 0, 0.48), "tail2": (-0.4, 0, 0.42), "tail3": (-0.46, 0, 0.36),
    "shoulder": (0.25, 0.08, 0.42), "elbow": (0.22, 0.08, 0.28), "carpus": (0.26, 0.08, 0.12),
    "paw": (0.28, 0.08, 0.02), "hip": (-0.25, 0.07, 0.45), "knee": (-0.2, 0.07, 0.3),
    "hock": (-0.3, 0.07, 0.15),
}  # fmt: skip


def _rest(kind):
    """Return standard joints at rest, shape (n_joints, 3): ahead, left, up."""
    table, rows = (_PERSON if kind == "person" else _DOG), []
    for name in KINDS[kind]:
        side, _, plain = name.partition("_")
        place = np.array(table[plain if plain and name not in table else name], float)
        if plain and name not in table:
            place[1] *= -1 if side in {"r", "FR", "HR"} else 1
            place[0] -= 0.5 if plain == "paw" and side[0] == "H" else 0.0
        rows.append(place)
    return np.array(rows)


def walker(*, seconds=4.0, speed_mps=1.2, stride_s=1.1):
    """Return joints of a person who walks straight ahead, each foot still while it stands."""
    t_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    joint_m = np.repeat(_rest("person")[None], len(t_s), axis=0)
    joint_m[:, :, 0] += speed_mps * t_s[:, None]
    for k, name in enumerate(KINDS["person"]):
        if name[2:] in {"ankle", "ball", "toe"}:
            phase = t_s / stride_s + (0.5 if name[0] == "r" else 0.0)
            share = np.clip(2 * (phase % 1.0), 0.0, 1.0)
            # Stands for half a stride, then swings by two steps.
            ease = share * share * (3 - 2 * share)
            way = (np.floor(phase) + ease) * speed_mps * stride_s
            joint_m[:, k, 0] = _rest("person")[k, 0] + way
    return joint_m


def stander(seconds=3.0):
    """Return joints of a dog that stands and moves its head."""
    t_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    joint_m = np.repeat(_rest("quadruped")[None], len(t_s), axis=0)
    for name in ("head", "nose"):
        joint_m[:, list(KINDS["quadruped"]).index(name), 2] += 0.05 * np.sin(2 * np.pi * t_s)
    return joint_m


def write_clip(path, joint_m, kind, who, **text):
    """Write joints (ahead, left, up) as a clip, y up."""
    names = list(KINDS[kind])
    np.savez(
        path,
        positions=(joint_m[..., [0, 2, 1]] * [1, 1, -1]).astype(np.float32),
        joints=np.array(names),
        parents=np.array([names.index(p) if p else -1 for p in KINDS[kind].values()]),
        frame_rate_hz=np.float32(RATE_HZ),
        species="human" if kind == "person" else "dog",
        **{"person" if kind == "person" else "animal": who, **text},
    )
    return path
