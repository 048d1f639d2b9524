"""A folder of clips as a source of bodies: who, which skin, how large, how quick, where.

Each individual is a way of moving of its own: those clips in which it goes, and those in which it
stays. People keep nearly their own size; animals are drawn from 0.2 to 0.7 m at the withers, and
the smaller the quicker, as pendulums are.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.bodies.body import Body, BodyPlan
from x2radar.sim.bodies.motion.recorded import RecordedMotion
from x2radar.sim.bodies.path.path import COURSES, draw_course
from x2radar.sim.points import Label
from x2train.motion.clips import Clip, read_clips
from x2train.motion.performance import perform

_DURATION_S = 60.0  # of a performance: passages last 20 s, and look up to 40 s for an entry
_SIZE_M: Mapping[Label, tuple[float, float]] = {"human": (0.9, 2.0), "pet": (0.2, 0.7)}
"""That sizes are drawn between: statures, withers."""
_TEMPO = {"human": (0.75, 1.15), "pet": (0.6, 1.3)}
"""How much quicker than recorded, before the size makes it quicker still. Slow ones count: of a
recorded dog's passages those at less than 0.3 m/s alarmed most
(docs/research/evaluation-tried.md)."""
_SLOW = (0.25, 0.75)  # where a passage is to be slow: of both, so that it tells nobody apart
_SPREAD = {"human": 0.08, "pet": 0.35}  # of sizes, in parts: adults' statures by a twelfth
_CHILD_SHARE = 0.15  # of people, who are drawn from 0.9 m on
_ENOUGH_S = 120.0  # more of one individual does not make it come more often
_RECORDED_TRUST = 4.0  # one recorded dog is a third of the animals, beside twenty by hand
_NOT_AT_HOME = re.compile(r"death|attack|bite|fall", re.IGNORECASE)
"""Clips of animals that nobody sees in a room."""
_GIRTH = 0.12
_N_LOOKS = 16
_RADII_M = (0.3, 0.8)


@dataclass(frozen=True, slots=True, eq=False)
class Individual:
    """Clips of one individual that can follow each other: in all it goes, or in all it stays."""

    name: str
    label: Label
    clips: tuple[Clip, ...]
    goes: bool

    @property
    def weight(self) -> float:
        """How often it is drawn: by how much there is of it, and how real that is."""
        seconds = sum(len(clip.joint_m) / clip.frame_rate_hz for clip in self.clips)
        slip = float(np.mean([clip.slip for clip in self.clips]))
        trust = _RECORDED_TRUST if self.label == "pet" and slip == 0 else 1 / (1 + 5 * slip)
        return float(np.sqrt(min(seconds, _ENOUGH_S))) * trust


@cache
def read_library(folder: Path, known: frozenset[str] = frozenset()) -> tuple[Individual, ...]:
    """Return the individuals of a folder of clips, by name; raises SceneError as `read_clips`.

    Clips whose SHA-256 is `known` are left out, and individuals who have no others.
    """
    rows: dict[tuple[str, bool], list[Clip]] = {}
    for clip in read_clips(folder):
        if clip.sha256 in known or (clip.label == "pet" and _NOT_AT_HOME.search(clip.name)):
            continue
        rows.setdefault((clip.individual, clip.goes), []).append(clip)
    return tuple(
        Individual(f"{name} {'goes' if goes else 'stays'}", clips[0].label, tuple(clips), goes)
        for (name, goes), clips in sorted(rows.items())
    )


def draw_recorded_body(
    individual: Individual, rng: np.random.Generator, options: Mapping[str, Any], where: str
) -> Body:
    """Draw a body that moves as an individual did: clips, size, tempo, mirror, course, skin."""
    label = individual.label
    clips = individual.clips
    if rng.random() < 0.5:
        clips = _mirrored(individual)
    size_m = _draw_size_m(rng, individual)
    scale = size_m / float(np.median([clip.size_m for clip in clips]))
    low, high = _SLOW if options.get("slow") else _TEMPO[label]
    tempo = float(rng.uniform(low, high)) / np.sqrt(scale)
    near_m, far_m = options.get("near_m", 0.6), options.get("far_m", 3.4)
    name = options.get("course") or list(COURSES)[int(rng.integers(len(COURSES)))]
    if not individual.goes:
        name = "wander"
    course = draw_course(rng, name, near_m, far_m)
    played = perform(rng, clips, duration_s=_DURATION_S, scale=scale, tempo=tempo)
    begin_m = 0.0 if individual.goes else float(rng.uniform(0.0, 2.0))
    position_m = played.along(course, float(rng.uniform(*_RADII_M)), begin_m)
    clip = clips[0]
    motion = RecordedMotion.of(clip.joints, clip.parents, position_m, played.frame_rate_hz)
    kind = motion.skeleton
    girth = float(np.exp(_GIRTH * np.clip(rng.standard_normal(), -2.5, 2.5)))
    half_m = motion.half_m * np.array([1.0, girth, girth])
    plan = BodyPlan(label, kind.names, half_m, motion, kind.n_trunk, kind.gain)
    looks_s = np.linspace(0.0, _DURATION_S / 2, _N_LOOKS)
    try:
        return plan.dressed(
            rng, options.get("skin", "surface"), options.get("total_rcs_dbsm"), looks_s
        )
    except SceneError as err:
        raise SceneError(f"{where}: {err}") from err


@cache
def _mirrored(individual: Individual) -> tuple[Clip, ...]:
    return tuple(clip.mirrored() for clip in individual.clips)


def _draw_size_m(rng: np.random.Generator, individual: Individual) -> float:
    label = individual.label
    low, high = _SIZE_M[label]
    own_m = float(np.median([clip.size_m for clip in individual.clips]))
    if label == "human" and rng.random() < _CHILD_SHARE:
        return float(rng.uniform(low, 1.5))
    spread = _SPREAD[label] * np.clip(rng.standard_normal(), -2.0, 2.0)
    return float(np.clip(own_m * np.exp(spread), low, high))


def cards_of(individuals: Sequence[Individual]) -> list[dict[str, str]]:
    """Return name, individual, source, licence and hash of every clip, for manifests and cards."""
    return [
        {
            "clip": clip.name,
            "individual": each.name,
            "source": clip.source,
            "licence": clip.licence,
            "sha256": clip.sha256,
        }
        for each in individuals
        for clip in each.clips
    ]
