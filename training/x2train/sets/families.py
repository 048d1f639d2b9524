"""Families: the ways in which bodies and things move, for training and for judging.

All else is drawn from the same distributions for all of them, so that nothing but the movement
tells them apart. Held out families are never in the training of a judged bundle.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from x2radar import plugins
from x2radar.errors import SettingsError
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.points import Label
from x2radar.sim.scene.cast import BodyKind, plugged_body
from x2train.motion.library import draw_recorded_body, read_library

CLIPS = "clips:"  # begins a use that names a folder of clips: bodies of recorded motion
RECORDED = "recorded"  # kind of such bodies
Use = Literal["train", "staying", "things", "held out", "thesis", "all"]
USES: tuple[Use, ...] = get_args(Use)
_STAYING = {"stand", "busy", "exercise", "sit", "lie", "pant", "groom", "scratch", "play", "jump"}
_MAX_DRAWS = 10_000  # until somebody goes
LABELS: tuple[Label, ...] = ("human", "pet", "other")


@dataclass(frozen=True, slots=True)
class Family:
    """A way in which a kind of body or thing moves, with its label and its use."""

    name: str
    label: Label
    kind: str  # body or thing
    options: Mapping[str, Any] = field(default_factory=dict)
    # held out: kept from training where transfer is measured
    use: Use = "train"
    weight: float = 1.0  # share within its label
    # the body itself, where a plug-in brings it; it draws its own place and way
    plugged: BodyKind | None = None
    is_still: bool = False  # of recorded motion that goes nowhere
    individual: int = -1  # of recorded motion: its place in the library

    @property
    def stays(self) -> bool:
        """Whether the body moves in its place."""
        return self.is_still or self.label == "other" or self.options.get("style") in _STAYING


_PEOPLE: Mapping[Use, Mapping[str, float]] = {
    "train": {
        "walk": 4.0,
        "stroll": 2.5,
        "crouch": 1.0,
        "jog": 1.0,
        "run": 1.2,
        "limp": 1.0,
        "carry": 1.0,
        "stop_and_go": 1.5,
        "stand": 0.6,
        "child": 1.5,
        "child_run": 0.8,
        "busy": 1.2,
        "search": 1.0,
        "sit": 1.0,
        "exercise": 0.8,
    },
    "held out": {"stealth": 1.5, "crawl": 1.5, "toddler": 1.0, "carry_pet": 0.5},
}
"""Styles of movement of people by their share: what a home sees most the more often."""
PAIRS: Mapping[tuple[Label, Label], float] = {
    ("human", "pet"): 0.18,
    ("human", "other"): 0.10,
    ("pet", "pet"): 0.08,
    ("pet", "other"): 0.07,
}
"""How often somebody has company of each label, by (who, company)."""
_THINGS = ("curtain", "fan", "robot_vacuum", "washing_machine", "door", "plant", "rain", "moth")
_TAUGHT = sorted(SPECIES.values(), key=lambda s: -sum(s.taught.values()))
"""The animals that are taught most come first: draws are by order and weight."""
FAMILIES: tuple[Family, ...] = (
    *(
        Family(f"human {s}", "human", "human", {"style": s}, use, w)
        for use, styles in _PEOPLE.items()
        for s, w in styles.items()
    ),
    *(
        Family(f"{animal.name} {s}", animal.label, animal.name, {"style": s}, weight=w)
        for animal in _TAUGHT
        for s, w in animal.taught.items()
    ),
    Family("largest dogs", "pet", "dog", {"style": "roam", "mass_kg": 55}, "held out", 1.5),
    Family("cat bound", "pet", "cat", {"style": "bound"}, "held out", 1.0),
    Family("bird", "pet", "bird", weight=0.8),
    *(Family(kind.replace("_", " "), "other", kind) for kind in _THINGS),
    Family("thesis human", "human", "thesis_human", use="thesis"),
    Family("thesis dog", "pet", "thesis_dog", use="thesis"),
    Family("thesis cat", "pet", "thesis_cat", use="thesis"),
)
"""Every family; the largest dogs are mastiffs."""


def families(label: Label, use: Use = "all") -> tuple[Family, ...]:
    """Return the families of a label: of one use, some of training's, or all but the thesis'."""
    if use == "things":
        return tuple(f for f in families(label, "train") if f.label == "other")
    if use == "staying":
        return tuple(f for f in families(label, "train") if f.stays)
    return tuple(
        f
        for f in FAMILIES
        if f.label == label and (f.use == use or (use == "all" and f.use != "thesis"))
    )


def family(name: str) -> Family:
    """Return a family by name; raise KeyError if there is none."""
    return {f.name: f for f in FAMILIES}[name]


@cache
def plugged_family(name: str) -> Family:
    """Return the family of a plug-in's body; SettingsError or PluginError if it is none."""
    kind = plugged_body(name)
    if kind is None:
        known = ", ".join((*USES, *plugins.plugin_names(plugins.BODIES)))
        msg = f"families '{name}': neither a use nor a plug-in body; known are {known}"
        raise SettingsError(msg)
    label = kind.make(np.random.default_rng(0), {}, name).label
    return Family(name, label, name, plugged=kind)


@cache
def recorded_families(folder: str, known: frozenset[str] = frozenset()) -> tuple[Family, ...]:
    """Return a family for each individual of `read_library`; SceneError if it is no folder."""
    made = []
    for k, each in enumerate(read_library(Path(folder), known)):
        body = BodyKind("Somebody whose motion was recorded.", partial(draw_recorded_body, each))
        who = Family(each.name, each.label, RECORDED, weight=each.weight, plugged=body)
        made.append(replace(who, is_still=not each.goes, individual=k))
    return tuple(made)


def draw_family(rng: np.random.Generator, label: Label, use: Use) -> Family:
    """Return a family of a label, drawn by weight."""
    return _drawn(rng, families(label, use))


def _drawn(rng: np.random.Generator, rows: Sequence[Family]) -> Family:
    weights = np.array([f.weight for f in rows])
    return rows[int(rng.choice(len(rows), p=weights / weights.sum()))]


def draw_goer(rng: np.random.Generator, label: Label, use: Use | str) -> Family:
    """Return a family as `draw_cast` gives it first; people and pets do not stay in place.

    Raises SettingsError if there is nobody who goes: clips may be of some who stay alone.
    """
    for _ in range(_MAX_DRAWS):
        first = draw_cast(rng, label, use)[0]
        if label == "other" or use == "staying" or not first.stays:
            return first
    raise SettingsError(f"families '{use}': no {label} goes anywhere in them, as --clear needs")


def draw_cast(rng: np.random.Generator, label: Label, use: Use | str) -> tuple[Family, ...]:
    """Return one or two families for a scene of a label; the first one gives the label."""
    if use.startswith(CLIPS):
        if label == "other":
            return (draw_family(rng, label, "train"),)
        rows = [f for f in recorded_families(use.removeprefix(CLIPS)) if f.label == label]
        return (_drawn(rng, rows),)
    if use not in USES:
        return (plugged_family(use),)
    if use == "thesis":
        return (draw_family(rng, label, use),)
    company = [(other, p) for (who, other), p in PAIRS.items() if who == label]
    if use == "held out":
        company = [(other, p) for other, p in company if (label, other) == ("human", "pet")]
    if use in {"train", "staying"}:
        company = [(other, p) for other, p in company if (label, other) != ("human", "pet")]
    point = rng.random()
    # Held out is then their company, not how they move.
    of_use: Use = "train" if use == "held out" else use
    for other, share in company:
        if point < share:
            return draw_family(rng, label, of_use), draw_family(rng, other, of_use)
        point -= share
    return (draw_family(rng, label, "all" if label == "other" else use),)
