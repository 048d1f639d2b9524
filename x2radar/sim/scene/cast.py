"""Cast: the names by which scenes call bodies and things, and what each is made from.

An actor is checked when its scene is read, by making it once; then it is made with new draws
whenever its step begins.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from x2radar import plugins
from x2radar.errors import PluginError, SceneError
from x2radar.sim.bodies.flyer.flyer import draw_bird, draw_moth
from x2radar.sim.bodies.motion.curves import MOTIONS
from x2radar.sim.bodies.path.courses import COURSES, FAR_M, NEAR_M, Waypoints, draw_course
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.person.person import draw_person
from x2radar.sim.bodies.quadruped.pet import PET_AGILITY, draw_pet
from x2radar.sim.bodies.quadruped.species import SPECIES, Species
from x2radar.sim.bodies.recorded import draw_recorded
from x2radar.sim.bodies.skin.draw import SKINS
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, Scatterer, draw, ranges_xyz
from x2radar.sim.keys import Key, unknown
from x2radar.sim.points import Label, Mover, Points
from x2radar.sim.things import THINGS, draw_thing
from x2radar.sim.things.draws import floor_position

Array = NDArray[np.float64]
SEED_GAIN = 1e4
"""The thesis' cross sections include 40 dB of the module's integration (its table 4.1)."""
_PROBABILITY = Key(0.0, 1.0, "probability")

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


_RCS = Key(-60.0, 30.0, "mean total cross section, dBsm", is_optional=True)
_CHOICES: Mapping[str, Collection[str]] = {
    "course": COURSES,
    "motion": MOTIONS,
    "skin": SKINS,
    "label": get_args(Label),
    "up": ("y", "z"),
}
_NUMBERS = {
    "mass_kg": Key(0.001, 200.0, "kg"),
    "height_m": Key(0.3, 2.6, "stature, m"),
    "speed_mps": Key(0.02, 12.0, "m/s"),
    "near_m": Key(0.2, 20.0, "near end of the course, m"),
    "far_m": Key(0.5, 30.0, "far end of the course, m"),
    "start_s": Key(-600.0, 600.0, "when it begins to move, s"),
    "scale": Key(1e-4, 10.0, "metres per unit of the file"),
    "turn_deg": Key(-360.0, 360.0, "turn to the left, degrees"),
}
_ECHO_KEYS = ("total_rcs_dbsm", "skin")
_WHERE_KEYS = ("course", "waypoints_m", "speed_mps", "near_m", "far_m", "start_s")


class ThesisBody:
    """One of the thesis' bodies: sums of sinusoids on a straight line towards the radar."""

    def __init__(self, label: Label, scatterers: tuple[Scatterer, ...]) -> None:
        self.label: Label = label
        self.names = tuple(f"scatterer {k + 1}" for k in range(len(scatterers)))
        self._scatterers = scatterers

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`. The thesis' origin is the antenna."""
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
        for key in options:
            if key not in {"body", "thing", "probability"}:
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
    if fault := _PROBABILITY.fault(probability):
        msg = f"{where}.probability: {fault}"
        raise SceneError(msg)
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


def _seed_maker(name: str, label: Label) -> Maker:
    def make(rng: np.random.Generator, options: Mapping[str, Any], where: str) -> Mover:
        for key in options:
            raise SceneError(unknown(key, ("body", "duration_s"), where))
        return ThesisBody(label, draw(THESIS_BODIES[name], rng))

    return make


def _options(raw: Mapping[str, Any], known: tuple[str, ...], where: str) -> dict[str, Any]:
    """Return a body's options once every key and value has been judged."""
    for name, value in raw.items():
        if name not in known:
            raise SceneError(unknown(name, known, where))
        fault = ""
        if name in _NUMBERS:
            fault = _NUMBERS[name].fault(value)
        elif name == "total_rcs_dbsm" and value != "physical":
            fault = _RCS.fault(value)
        elif name in _CHOICES and value not in _CHOICES[name]:
            fault = f"must be one of {', '.join(_CHOICES[name])}, not {value!r}"
        elif name == "file" and not isinstance(value, str):
            fault = f"must be the path of a file, not {value!r}"
        if fault:
            msg = f"{where}.{name}: {fault}"
            raise SceneError(msg)
    return dict(raw)


def _waypoints(options: dict[str, Any], rng: np.random.Generator, where: str) -> Waypoints | None:
    """Take the keys that say where a body goes; return its waypoints, or None."""
    name, given = options.pop("course", None), options.pop("waypoints_m", None)
    near_m, far_m = options.pop("near_m", NEAR_M), options.pop("far_m", FAR_M)
    if given is not None:
        if not isinstance(given, list) or len(given) < 2:
            msg = f"{where}.waypoints_m: must be a list of two or more points [x, y]"
            raise SceneError(msg)
        points = [floor_position(p, f"{where}.waypoints_m[{k}]") for k, p in enumerate(given)]
        return [(float(x), float(y)) for x, y in points]
    if far_m <= near_m + 0.5:
        msg = f"{where}.far_m: {far_m} is not half a metre above near_m = {near_m}"
        raise SceneError(msg)
    return None if name is None else draw_course(rng, name, near_m, far_m)


def _at(error: SceneError, where: str) -> SceneError:
    """Return a body's own error with the path of its key in front."""
    return SceneError(f"{where}.{error}")


def _pet_maker(species: Species) -> Maker:
    keys = ("style", "mass_kg", *_ECHO_KEYS, "motion", *_WHERE_KEYS)

    def make(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
        options = _options(raw, keys, where)
        points = _waypoints(options, rng, where)
        speed, start_s = options.pop("speed_mps", None), options.pop("start_s", 0.0)
        try:
            path: Path | Waypoints | None = points
            if speed is not None:
                course = points or draw_course(rng, "wander")
                path = Path.through(course, speed, agility=PET_AGILITY, start_s=start_s)
            return draw_pet(rng, species=species.name, path=path, **options)
        except SceneError as err:
            raise _at(err, where) from err

    return make


def _human_maker() -> Maker:
    keys = ("style", "height_m", *_ECHO_KEYS, "motion", *_WHERE_KEYS)

    def make(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
        options = _options(raw, keys, where)
        points = _waypoints(options, rng, where)
        try:
            return draw_person(rng, path=points, **options)
        except SceneError as err:
            raise _at(err, where) from err

    return make


def _flyer_maker(draw_flyer: Callable[..., Mover], keys: tuple[str, ...]) -> Maker:
    def make(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
        options = _options(raw, keys, where)
        home = options.get("home_m")
        if home is not None:
            if not isinstance(home, list) or len(home) != 3:
                msg = f"{where}.home_m: must be three numbers [x, y, z] in metres, not {home!r}"
                raise SceneError(msg)
            place = floor_position(home[:2], f"{where}.home_m")
            floor_position([home[2], 0.0], f"{where}.home_m")
            options["home_m"] = (float(place[0]), float(place[1]), float(home[2]))
        try:
            return draw_flyer(rng, **options)
        except SceneError as err:
            raise _at(err, where) from err

    return make


_RECORDED_KEYS = ("file", "label", "scale", "up", "place_m", "turn_deg", "start_s", *_ECHO_KEYS)


def _recorded(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
    options = _options(raw, _RECORDED_KEYS, where)
    if "file" not in options:
        msg = f"{where}.file: is missing: a BVH file or an archive of joint positions"
        raise SceneError(msg)
    if "place_m" in options:
        x, y = floor_position(options["place_m"], f"{where}.place_m")
        options["place_m"] = (float(x), float(y))
    try:
        return draw_recorded(rng, **options)
    except SceneError as err:
        raise _at(err, where) from err


BODIES: Mapping[str, BodyKind] = MappingProxyType(
    {
        "human": BodyKind("A person of any age.", _human_maker()),
        **{s.name: BodyKind(s.sentence, _pet_maker(s)) for s in SPECIES.values()},
        "bird": BodyKind(
            "A bird: budgerigar, cockatiel or pigeon.",
            _flyer_maker(draw_bird, ("species", "style", "home_m", "mass_kg", *_ECHO_KEYS)),
        ),
        "moth": BodyKind(
            "A large moth near the antenna.",
            _flyer_maker(draw_moth, ("home_m", *_ECHO_KEYS)),
        ),
        "motion": BodyKind("A recorded skeleton: a BVH file or joint positions.", _recorded),
        "thesis_human": BodyKind(
            "The thesis' person: five sinusoids.", _seed_maker("thesis_human", "human")
        ),
        "thesis_dog": BodyKind(
            "The thesis' dog: five sinusoids.", _seed_maker("thesis_dog", "pet")
        ),
        "thesis_cat": BodyKind(
            "The thesis' cat: five sinusoids.", _seed_maker("thesis_cat", "pet")
        ),
    }
)
"""Kinds of bodies by name."""
