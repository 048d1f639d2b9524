"""Clips from files of other programs: joints by their standard names, metres, 60 Hz.

A map is a YAML file that says which joint of a file is which of the standard ones:

    kind: quadruped            # or person
    scale: 0.01                # metres per unit of the file; 1 without it
    up: y                      # or z; y without it
    joints: {pelvis: Hips, spine: Spine1, withers: Spine3, ...}
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from scipy.interpolate import CubicSpline

from radard.config.json_file import parse_json
from x2radar.bounded_yaml import load_yaml
from x2radar.errors import SceneError
from x2train.motion.formats import RawMotion

Array = NDArray[np.float64]
RATE_HZ = 60.0  # of clips: that of an X2, twice what a person's movements need


def _tree(*chains: str) -> Mapping[str, str]:
    """Return joints and their parents, from chains that each begin at a joint that is there."""
    parents: dict[str, str] = {}
    for chain in chains:
        names = chain.split()
        parents.setdefault(names[0], "")
        parents |= dict(zip(names[1:], names, strict=False))
    return MappingProxyType(parents)


_PERSON = _tree(
    "pelvis spine chest neck head head_top",
    *(f"pelvis {s}_hip {s}_knee {s}_ankle {s}_ball {s}_toe" for s in "lr"),
    *(f"chest {s}_shoulder {s}_elbow {s}_wrist {s}_hand" for s in "lr"),
)
_QUADRUPED = _tree(
    "pelvis spine withers neck head nose",
    "pelvis tail1 tail2 tail3",
    *(f"withers F{s}_shoulder F{s}_elbow F{s}_carpus F{s}_paw" for s in "LR"),
    *(f"pelvis H{s}_hip H{s}_knee H{s}_hock H{s}_paw" for s in "LR"),
)
KINDS: Mapping[str, Mapping[str, str]] = {"person": _PERSON, "quadruped": _QUADRUPED}
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
