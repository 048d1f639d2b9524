"""Cast: the names by which scenes call bodies and things, and what each is made from.

An actor is checked when its scene is read, by making it once; then it is made with new draws
whenever its step begins.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from x2radar import plugins
from x2radar.errors import PluginError, SceneError
from x2radar.keys import Key, checked, place_of, unknown
from x2radar.sim.bodies.flyer import draw_bird, draw_moth
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.path.courses import COURSES, FAR_M, NEAR_M, Waypoints, draw_course
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person import draw_person
from x2radar.sim.bodies.pet import PET_AGILITY, draw_pet
from x2radar.sim.bodies.recorded import draw_recorded
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.bodies.skins.draw import SKINS
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, Scatterer, draw, ranges_xyz
from x2radar.sim.points import Label, Mover, Points
from x2radar.sim.things import THINGS, draw_thing

Array = NDArray[np.float64]
SEED_GAIN = 1e4
"""The thesis' cross sections include 40 dB of the module's integration (its table 4.1)."""
Maker = Callable[[np.random.Generator, Mapping[str, Any], str], Mover]
"""Makes a mover from a generator, the options of the scene file, and their path in it."""


@dataclass(frozen=True, slots=True)
class Actor:
    """A body or thing as a scene names it."""

    kind: str  # name of a body or a thing
    options: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""  # its path in the scene file
    probability: float = 1.0  # that it is there at all
    plugged: "BodyKind | None" = None  # the kind itself, where a plug-in brings it

    def make(self, rng: np.random.Generator) -> Mover:
        """Return it with new draws; raises SceneError as `read_actor`."""
        if self.kind in THINGS:
            options = dict(self.options)
            place = options.pop("position_m", None)
            return draw_thing(rng, self.kind, place, options, self.where)
        return (self.plugged or BODIES[self.kind]).make(rng, self.options, self.where)


@dataclass(frozen=True, slots=True)
class BodyKind:
    """One kind of body: a sentence for people, and how it is made."""

    sentence: str
    make: Maker


_KEYS: Mapping[str, Key | None] = {
    "style": None,
    "species": None,
    "motion": Key(choices=tuple(MOTIONS)),
    "skin": Key(choices=tuple(SKINS)),
    "total_rcs_dbsm": Key(
        -60.0, 30.0, "mean total cross section, dBsm", is_optional=True, choices=("physical",)
    ),
    "mass_kg": Key(0.001, 200.0, "kg"),
    "height_m": Key(0.3, 2.6, "stature, m"),
    "course": Key(choices=tuple(COURSES)),
    "waypoints_m": None,
    "speed_mps": Key(0.02, 12.0, "m/s"),
    "near_m": Key(0.2, 20.0, "near end of the course, m"),
    "far_m": Key(0.5, 30.0, "far end of the course, m"),
    "start_s": Key(-600.0, 600.0, "when it begins to move, s"),
    "home_m": None,
    "file": None,
    "label": Key(choices=get_args(Label)),
    "up": Key(choices=("y", "z")),
    "scale": Key(1e-4, 10.0, "metres per unit of the file"),
    "place_m": None,
    "turn_deg": Key(-360.0, 360.0, "turn to the left, degrees"),
}
"""What bodies may be told; None: the body judges it itself."""
_ECHO = ("total_rcs_dbsm", "skin")
_COURSE = ("course", "waypoints_m", "speed_mps", "near_m", "far_m", "start_s")


class ThesisBody:
    """One of the thesis' bodies: sums of sinusoids on a straight line towards the radar."""

    def __init__(self, label: Label, scatterers: tuple[Scatterer, ...]) -> None:
        self.label: Label = label
        self.names = tuple(f"scatterer {k + 1}" for k in range(len(scatterers)))
        self._scatterers = scatterers

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points. The thesis' origin is the antenna."""
        position_m, rcs_m2 = ranges_xyz(self._scatterers, t_s)
        level = np.broadcast_to(rcs_m2 / SEED_GAIN, position_m.shape[:2])
        return Points(position_m + antenna_m, level)


def read_actor(raw: Any, where: str) -> Actor:
    """Return the actor that a scene file describes, checked: it can be made.

    `raw` has ``body: NAME`` or ``thing: NAME``, its options, and perhaps its probability. Raises
    SceneError if it names nothing known, or an option is unknown or impossible; one line with
    the path of the key.
    """
    if not isinstance(raw, dict):
        msg = f"{where}: must be a mapping with the key body or thing"
        raise SceneError(msg)
    options = dict(raw)
    named = [key for key in ("body", "thing") if key in options]
    if len(named) != 1:
        for key in options.keys() - {"body", "thing", "probability"}:
            raise SceneError(unknown(key, ("body", "thing", "duration_s"), where))
        msg = f"{where}: must name one body or one thing"
        raise SceneError(msg)
    kind = options.pop(named[0])
    known: Mapping[str, Any] = BODIES if named[0] == "body" else THINGS
    plugged: BodyKind | None = None
    if not isinstance(kind, str) or kind not in known:
        plugged = plugged_body(kind) if named[0] == "body" and isinstance(kind, str) else None
        if plugged is None:
            msg = f"{where}.{named[0]}: no {named[0]} '{kind}'; known are {', '.join(known)}"
            raise SceneError(msg)
    probability = options.pop("probability", 1.0)
    Key(0.0, 1.0).judge(probability, f"{where}.probability")
    actor = Actor(kind, MappingProxyType(options), where, float(probability), plugged)
    actor.make(np.random.default_rng(0))
    return actor


def plugged_body(name: str) -> BodyKind | None:
    """Return the body that an entry point of `x2radar.bodies` brings; None if none does.

    The entry point names a `BodyKind`. What it makes is tried at two times when it is made.
    """
    found = plugins.find_plugin(plugins.BODIES, name)
    if found is None:
        return None
    kind = found.made
    if not isinstance(kind, BodyKind):
        msg = f"{found.about}: must be a BodyKind, not {type(kind).__name__}"
        raise PluginError(msg)

    def make(rng: np.random.Generator, options: Mapping[str, Any], where: str) -> Mover:
        mover: Mover = found.guard(lambda: kind.make(rng, options, where))
        found.check(mover, ("label", "names", "at"))
        points = found.guard(lambda: mover.at(np.array([0.0, 1.0]), np.array([0.0, 0.0, 1.0])))
        found.check(points, ("position_m", "rcs_m2"))
        shape = (2, len(mover.names))
        if points.position_m.shape != (*shape, 3) or points.rcs_m2.shape != shape:
            msg = (
                f"{found.about}: {len(mover.names)} points at two times have positions of shape "
                f"{points.position_m.shape} and cross sections of {points.rcs_m2.shape}"
            )
            raise PluginError(msg)
        if mover.label not in get_args(Label):
            msg = f"{found.about}: label '{mover.label}' is none of {', '.join(get_args(Label))}"
            raise PluginError(msg)
        return mover

    return BodyKind(kind.sentence, make)


def _body(sentence: str, draw_body: Callable[..., Mover], keys: tuple[str, ...]) -> BodyKind:
    """Return a kind of body that `draw_body` makes of a generator and these options."""
    table = {name: _KEYS[name] for name in keys}

    def make(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
        options = checked(raw, table, where)
        if options.get("home_m") is not None:
            options["home_m"] = place_of(options["home_m"], f"{where}.home_m", "x, y and z")
        if "place_m" in options:
            options["place_m"] = place_of(options["place_m"], f"{where}.place_m")
        if "course" in table:
            options["path"] = _waypoints(options, rng, where)
        try:
            return draw_body(rng, **options)
        except SceneError as err:
            # A body's own error, with the path of its key in front.
            msg = f"{where}.{err}"
            raise SceneError(msg) from err

    return BodyKind(sentence, make)


def _waypoints(options: dict[str, Any], rng: np.random.Generator, where: str) -> Waypoints | None:
    """Take the keys that say where a body goes; return its waypoints, or None."""
    name, given = options.pop("course", None), options.pop("waypoints_m", None)
    near_m, far_m = options.pop("near_m", NEAR_M), options.pop("far_m", FAR_M)
    if given is not None:
        if not isinstance(given, list) or len(given) < 2:
            msg = f"{where}.waypoints_m: must be a list of two or more points [x, y]"
            raise SceneError(msg)
        places = (place_of(p, f"{where}.waypoints_m[{k}]") for k, p in enumerate(given))
        return [(x, y) for x, y in places]
    if far_m <= near_m + 0.5:
        msg = f"{where}.far_m: {far_m} is not half a metre above near_m = {near_m}"
        raise SceneError(msg)
    return None if name is None else draw_course(rng, name, near_m, far_m)


def _pet(species: str) -> Callable[..., Mover]:
    def draw_one(
        rng: np.random.Generator,
        *,
        path: Waypoints | None,
        speed_mps: float | None = None,
        start_s: float = 0.0,
        **options: Any,
    ) -> Mover:
        way: Path | Waypoints | None = path
        if speed_mps is not None:
            course = path or draw_course(rng, "wander")
            way = Path.through(course, speed_mps, agility=PET_AGILITY, start_s=start_s)
        return draw_pet(rng, species=species, path=way, **options)

    return draw_one


def _recorded(rng: np.random.Generator, *, file: Any = None, **options: Any) -> Mover:
    if not isinstance(file, str):
        said = "is missing" if file is None else f"must be a path, not {file!r}"
        msg = f"file: {said}: a BVH file or an archive of joint positions"
        raise SceneError(msg)
    return draw_recorded(rng, file=file, **options)


def _thesis(kind: str, label: Label) -> BodyKind:
    def draw_one(rng: np.random.Generator) -> Mover:
        return ThesisBody(label, draw(THESIS_BODIES[f"thesis_{kind}"], rng))

    what = "person" if kind == "human" else kind
    return _body(f"The thesis' {what}: five sinusoids.", draw_one, ())


BODIES: Mapping[str, BodyKind] = MappingProxyType(
    {
        "human": _body(
            "A person of any age.",
            draw_person,
            ("style", "height_m", *_ECHO, "motion", *_COURSE),
        ),
        **{
            s.name: _body(
                s.sentence, _pet(s.name), ("style", "mass_kg", *_ECHO, "motion", *_COURSE)
            )
            for s in SPECIES.values()
        },
        "bird": _body(
            "A bird: budgerigar, cockatiel or pigeon.",
            draw_bird,
            ("species", "style", "home_m", "mass_kg", *_ECHO),
        ),
        "moth": _body("A large moth near the antenna.", draw_moth, ("home_m", *_ECHO)),
        "motion": _body(
            "A recorded skeleton: a BVH file or joint positions.",
            _recorded,
            ("file", "label", "scale", "up", "place_m", "turn_deg", "start_s", *_ECHO),
        ),
        "thesis_human": _thesis("human", "human"),
        "thesis_dog": _thesis("dog", "pet"),
        "thesis_cat": _thesis("cat", "pet"),
    }
)
"""Kinds of bodies by name."""
