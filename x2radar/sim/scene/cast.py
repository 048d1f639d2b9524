"""Cast: the names by which scenes call bodies and things, and what each is made from.

An actor is checked when its scene is read, by making it once; then it is made with new draws
whenever its step begins.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, get_args

import numpy as np

from x2radar import plugins
from x2radar.errors import PluginError, SceneError
from x2radar.keys import Key, checked, place_of, unknown
from x2radar.sim.bodies.flyer import draw_bird, draw_moth
from x2radar.sim.bodies.motion.recorded import draw_recorded
from x2radar.sim.bodies.path.path import COURSES, FAR_M, NEAR_M, Waypoints, draw_course
from x2radar.sim.bodies.person import draw_person
from x2radar.sim.bodies.pet import draw_pet
from x2radar.sim.bodies.skeleton.species import SPECIES
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, draw_thesis_body
from x2radar.sim.points import Label, Mover
from x2radar.sim.things.kinds import THINGS, draw_thing


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
        make = self.plugged.make if self.plugged else BODIES[self.kind]
        return make(rng, self.options, self.where)


Make = Callable[[np.random.Generator, Mapping[str, Any], str], Mover]
"""Makes a body from a generator, the options of the scene file, and their path in it."""


@dataclass(frozen=True, slots=True)
class BodyKind:
    """One kind of body that a plug-in brings: a sentence for people, and how it is made."""

    sentence: str
    make: Make


_KEYS: Mapping[str, Key | None] = {
    **dict.fromkeys(("style", "species", "motion", "skin", "total_rcs_dbsm", "mass_kg")),
    **dict.fromkeys(("height_m", "waypoints_m", "home_m", "file", "place_m")),
    "course": Key(choices=tuple(COURSES)),
    "speed_mps": Key(0.02, 12.0, "m/s"),
    "near_m": Key(0.2, 20.0, "near end of the course, m"),
    "far_m": Key(0.5, 30.0, "far end of the course, m"),
    "start_s": Key(-600.0, 600.0, "when it begins to move, s"),
    "label": Key(choices=get_args(Label)),
    "up": Key(choices=("y", "z")),
    "scale": Key(1e-4, 10.0, "metres per unit of the file"),
    "turn_deg": Key(-360.0, 360.0, "turn to the left, degrees"),
}
"""What bodies may be told; None: the body judges it itself."""
_PLACES = {"home_m": "x, y and z", "place_m": "x and y"}
_ECHO = ("total_rcs_dbsm", "skin")
_COURSE = ("course", "waypoints_m", "speed_mps", "near_m", "far_m", "start_s")


def read_actor(raw: Any, where: str) -> Actor:
    """Return the actor that a scene file's body or thing describes, checked; or SceneError."""
    if not isinstance(raw, dict):
        raise SceneError(f"{where}: must be a mapping with the key body or thing")
    options = dict(raw)
    named = [key for key in ("body", "thing") if key in options]
    if len(named) != 1:
        for key in options.keys() - {"body", "thing", "probability"}:
            raise SceneError(unknown(key, ("body", "thing", "duration_s"), where))
        raise SceneError(f"{where}: must name one body or one thing")
    (what,) = named
    kind = str(options.pop(what))
    known: Mapping[str, Any] = BODIES if what == "body" else THINGS
    plugged = plugged_body(kind) if what == "body" and kind not in known else None
    if kind not in known and plugged is None:
        raise SceneError(f"{where}.{what}: no {what} '{kind}'; known are {', '.join(known)}")
    probability = options.pop("probability", 1.0)
    Key(0.0, 1.0).judge(probability, f"{where}.probability")
    actor = Actor(kind, options, where, float(probability), plugged)
    actor.make(np.random.default_rng(0))
    return actor


def plugged_body(name: str) -> BodyKind | None:
    """Return the `BodyKind` that an entry point of `x2radar.bodies` names; None if none does."""
    found = plugins.find_plugin(plugins.BODIES, name)
    if found is None:
        return None
    kind = found.made
    if not isinstance(kind, BodyKind):
        raise PluginError(f"{found.about}: must be a BodyKind, not {type(kind).__name__}")

    def make(rng: np.random.Generator, options: Mapping[str, Any], where: str) -> Mover:
        mover: Mover = found.guard(lambda: kind.make(rng, options, where))
        found.check(mover, ("label", "names", "at"))
        points = found.guard(lambda: mover.at(np.array([0.0, 1.0]), np.array([0.0, 0.0, 1.0])))
        found.check(points, ("position_m", "rcs_m2"))
        shape = (2, len(mover.names))
        if points.position_m.shape != (*shape, 3) or points.rcs_m2.shape != shape:
            raise PluginError(
                f"{found.about}: {len(mover.names)} points at two times have positions of shape "
                f"{points.position_m.shape} and cross sections of {points.rcs_m2.shape}"
            )
        if mover.label not in get_args(Label):
            msg = f"{found.about}: label '{mover.label}' is none of {', '.join(get_args(Label))}"
            raise PluginError(msg)
        return mover

    return BodyKind(kind.sentence, make)


def _body(draw_body: Callable[..., Mover], *keys: str) -> Make:
    """Return what makes a body by `draw_body`, of a generator and these options."""
    table = {name: _KEYS[name] for name in keys}

    def make(rng: np.random.Generator, raw: Mapping[str, Any], where: str) -> Mover:
        options = checked(raw, table, where)
        for key, names in _PLACES.items():
            if key in options:
                options[key] = place_of(options[key], f"{where}.{key}", names)
        if "course" in table:
            options["path"] = _waypoints(options, rng, where)
        try:
            return draw_body(rng, **options)
        except SceneError as err:
            # A body's own error, with the path of its key in front.
            raise SceneError(f"{where}.{err}") from err

    return make


def _waypoints(options: dict[str, Any], rng: np.random.Generator, where: str) -> Waypoints | None:
    """Take the keys that say where a body goes; return its waypoints, or None."""
    name, given = options.pop("course", None), options.pop("waypoints_m", None)
    near_m, far_m = options.pop("near_m", NEAR_M), options.pop("far_m", FAR_M)
    if given is not None:
        if not isinstance(given, list) or len(given) < 2:
            raise SceneError(f"{where}.waypoints_m: must be a list of two or more points [x, y]")
        places = (place_of(p, f"{where}.waypoints_m[{k}]") for k, p in enumerate(given))
        return [(x, y) for x, y in places]
    if far_m <= near_m + 0.5:
        raise SceneError(f"{where}.far_m: {far_m} is not half a metre above near_m = {near_m}")
    return None if name is None else draw_course(rng, name, near_m, far_m)


_LEGGED = (*_ECHO, "motion", *_COURSE)
_RECORDED = ("file", "label", "scale", "up", "place_m", "turn_deg", "start_s")
BODIES: Mapping[str, Make] = {
    "human": _body(draw_person, "style", "height_m", *_LEGGED),
    **{
        name: _body(partial(draw_pet, species=name), "style", "mass_kg", *_LEGGED)
        for name in SPECIES
    },
    "bird": _body(draw_bird, "species", "style", "home_m", "mass_kg", *_ECHO),
    "moth": _body(draw_moth, "home_m", *_ECHO),
    "motion": _body(draw_recorded, *_RECORDED, *_ECHO),
    **{name: _body(partial(draw_thesis_body, name=name)) for name in THESIS_BODIES},
}
"""Kinds of bodies by name, and what makes them."""
