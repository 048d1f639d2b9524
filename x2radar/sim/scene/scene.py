"""Scenes: what stands and moves before the radar, in order, from YAML.

A scene is a sequence of steps; after the last one it starts again with new draws. Everything
random comes from the scene's seed and the step's number.
"""

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from x2radar.bounded_yaml import YamlError, load_yaml, read_document
from x2radar.errors import SceneError
from x2radar.keys import Key, checked, settings_from
from x2radar.sim.place.antenna import Antenna, Surface, TailSettings
from x2radar.sim.place.room import RoomSettings
from x2radar.sim.scene.cast import Actor, read_actor
from x2radar.sim.signal.receiver import ReceiverEffects
from x2radar.sim.things.draws import draw_mount

_T = TypeVar("_T")
ERRORS_DB = (-40.0, -60.0, -80.0, -100.0)  # of the echoes' error, 20 dB apart
_USUAL_ERROR_DB = -60.0  # 20 dB under the noise beside a body at 1 m
_ERROR = Key(ERRORS_DB[-1], ERRORS_DB[0], "largest error of a bin over the echoes' sum, dB")
_SCENES = resources.files("x2radar.sim") / "scenes"
_DURATION = Key(0.1, 86_400.0, "s")
_WEIGHT = Key(0.0, 1e6, "weight")
_POINT = {"range_m": Key(0.1, 1000, "m"), "rcs_m2": Key(0, 1e9, "m2, processing gain included")}
_STEP_KEYS = dict.fromkeys(("duration_s", "actors", "weight"))


@dataclass(frozen=True, slots=True)
class SceneStep:
    """Some seconds with some moving things."""

    actors: tuple[Actor, ...]  # bodies and things; empty for an empty room
    least_s: float  # the duration is drawn evenly from here
    most_s: float  # to here
    weight: float = 1.0  # how often this step is taken against others in its place


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene file, read and checked."""

    name: str  # built-in name or file name
    description: str  # one sentence for people
    # Played in order, then again; one of each tuple, drawn by weight each time.
    steps: tuple[tuple[SceneStep, ...], ...]
    background: tuple[Actor, ...] = ()  # what moves all the time
    # Single static echoes: range in m, cross section in m2 with the module's 40 dB of gain.
    clutter: tuple[tuple[float, float], ...] = ()
    room: RoomSettings | None = None  # static objects, distributed clutter, leakage
    antenna: Antenna = field(default_factory=lambda: Antenna(shape="isotropic"))
    surfaces: tuple[Surface, ...] = ()  # floor and walls that mirror
    tail: TailSettings | None = None  # the moving clutter behind bodies
    mount: Mapping[str, float] | None = None  # vibration of the antenna's mount
    receiver: ReceiverEffects = field(default_factory=ReceiverEffects)
    error_db: float = _USUAL_ERROR_DB  # bound of the echoes' error, see `x2radar.sim.echo`


def scene_names() -> tuple[str, ...]:
    """Return the names of the built-in scenes."""
    names = (file.name for file in _SCENES.iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml")))


def builtin_scenes() -> tuple[Scene, ...]:
    """Return every built-in scene, by name."""
    return tuple(load_scene(name) for name in scene_names())


def load_scene(name: str) -> Scene:
    """Return a scene by built-in name, or from a .yaml or .yml file; or SceneError."""
    if name.endswith((".yaml", ".yml")):
        try:
            text = read_document(Path(name))
        except (OSError, ValueError) as err:
            # ValueError: bytes that are no UTF-8, or a name that no file can have.
            raise SceneError(f"{name}: cannot read the scene file ({err})") from err
        return parse_scene(text, Path(name).stem, name)
    if name in scene_names():
        return parse_scene(_builtin_text(name), name, f"{name}.yaml")
    near = difflib.get_close_matches(name, scene_names(), n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    msg = f"no scene '{name}'; {hint}'x2radar scenes' lists them; a file must end in .yaml"
    raise SceneError(msg)


def parse_scene(text: str, name: str, where: str) -> Scene:
    """Return the scene that a YAML text says; raises as `load_scene`."""
    try:
        raw = load_yaml(text)
        top = _inherited(checked({} if raw == {} else raw or [], _SCENE_KEYS, where), where)
        said = {
            key: read(top[key], f"{where}: {key}") for key, read in _READERS.items() if key in top
        }
    except YamlError as err:
        raise SceneError(f"{where}: not YAML: {err}") from err
    except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError) as err:
        # Values of kinds that no key takes: lists and mappings for numbers and words.
        raise SceneError(f"{where}: a value makes no sense ({err})") from err
    if not said.get("steps"):
        raise SceneError(f"{where}: steps: must be a list with at least one step")
    return Scene(**{"name": name, "description": "", **said})


def _inherited(top: dict[str, Any], where: str) -> dict[str, Any]:
    """Return a scene's keys with those of the built-in scene that it is `like`."""
    name = top.get("like")
    if name is None:
        return top
    if name not in scene_names():
        raise SceneError(f"{where}: like: no built-in scene '{name}'")
    base = load_yaml(_builtin_text(name))
    if "like" in base:
        raise SceneError(f"{where}: like: '{name}' is itself like another scene; name that one")
    return {**base, **top}


def _builtin_text(name: str) -> str:
    return (_SCENES / f"{name}.yaml").read_text(encoding="utf-8")


def _choice(raw: Any, where: str) -> tuple[SceneStep, ...]:
    if not (isinstance(raw, dict) and "one_of" in raw):
        return (_step(raw, where),)
    steps = _list(_step)(checked(raw, {"one_of": None}, where)["one_of"], f"{where}.one_of")
    if not any(step.weight > 0 for step in steps):
        msg = f"{where}.one_of: must be a list with at least one step of weight above 0"
        raise SceneError(msg)
    return steps


def _step(raw: Any, where: str) -> SceneStep:
    if not isinstance(raw, dict) or not {"body", "thing"} & raw.keys():
        raw = checked(raw or [], _STEP_KEYS, where)
    raw = dict(raw)
    least_s, most_s = _duration(raw.pop("duration_s", None), f"{where}.duration_s")
    weight = _number(_WEIGHT, raw.pop("weight", 1.0), f"{where}.weight")
    if "actors" in raw:
        actors = checked(raw, {"actors": None}, where)["actors"]
        return SceneStep(_list(read_actor)(actors, f"{where}.actors"), least_s, most_s, weight)
    # A single body or thing needs no list.
    is_empty = raw.get("body") is None and set(raw) <= {"body"}
    return SceneStep(() if is_empty else (read_actor(raw, where),), least_s, most_s, weight)


def _duration(raw: Any, where: str) -> tuple[float, float]:
    least_s, most_s = raw if isinstance(raw, list) and len(raw) == 2 else (raw, raw)
    least_s, most_s = _number(_DURATION, least_s, where), _number(_DURATION, most_s, where)
    if least_s > most_s:
        raise SceneError(f"{where}: {least_s:g} is above {most_s:g}")
    return least_s, most_s


def _number(key: Key, raw: Any, where: str) -> float:
    key.judge(raw, where)
    return float(raw)


def _point(raw: Any, where: str) -> tuple[float, ...]:
    item = checked(raw, _POINT, where)
    return tuple(_number(key, item.get(n), f"{where}.{n}") for n, key in _POINT.items())


def _mount(raw: Any, where: str) -> Mapping[str, float]:
    draw_mount(np.random.default_rng(0), raw, where)
    return dict(raw or {})


def _text(raw: Any, where: str) -> str:
    if not isinstance(raw, str | None):
        raise SceneError(f"{where}: must be text")
    return " ".join((raw or "").split())


def _list(read: Callable[[Any, str], _T]) -> Callable[[Any, str], tuple[_T, ...]]:
    """Return a reader of lists, of which `read` reads an item; None is an empty one."""

    def read_all(raw: Any, where: str) -> tuple[_T, ...]:
        if not isinstance(raw, list | None):
            raise SceneError(f"{where}: must be a list")
        return tuple(read(item, f"{where}[{k}]") for k, item in enumerate(raw or []))

    return read_all


_READERS: Mapping[str, Callable[[Any, str], Any]] = {
    "description": _text,
    "steps": _list(_choice),
    "background": _list(read_actor),
    "clutter": _list(_point),
    "surfaces": _list(partial(settings_from, Surface)),
    "mount": _mount,
    "room": partial(settings_from, RoomSettings),
    "antenna": partial(settings_from, Antenna),
    "tail": partial(settings_from, TailSettings),
    "receiver": partial(settings_from, ReceiverEffects),
    "error_db": partial(_number, _ERROR),
}
"""What a scene may say, and who judges it."""
_SCENE_KEYS = dict.fromkeys(("description", "like", *list(_READERS)[1:]))
