"""Scenes: what stands and moves before the radar, in order, from YAML.

A scene is a sequence of steps; each step shows one body, or none, for some seconds, and
after the last step the sequence starts again with new draws. Built-in scenes are the YAML
files beside this one. Everything random comes from the scene's seed and the step's number,
so one seed gives the same frames on any machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.motion import SEED_BODIES, Scatterer, draw, ranges

Array = NDArray[np.float64]
LONGEST_STEP_S = 86_400.0


@dataclass(frozen=True, slots=True)
class SceneStep:
    """One body, or None for an empty room, for `duration_s` seconds."""

    body: str | None
    duration_s: float


@dataclass(frozen=True, slots=True)
class StaticPoint:
    """A piece of static clutter: a wall, a cupboard, the antennas' own coupling."""

    range_m: float
    rcs_m2: float


@dataclass(frozen=True, slots=True)
class Scene:
    """What a scene file says.

    Attributes
    ----------
    name : str
        Built-in name or file name.
    description : str
        One sentence for people.
    steps : tuple of SceneStep
        Played in order, then again.
    clutter : tuple of StaticPoint
        What never moves.
    """

    name: str
    description: str
    steps: tuple[SceneStep, ...]
    clutter: tuple[StaticPoint, ...] = ()


def builtin_scenes() -> tuple[Scene, ...]:
    """Return every built-in scene, by name."""
    folder = resources.files("x2radar.sim") / "scenes"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".yaml")), key=lambda f: f.name)
    return tuple(_parse(f.read_text(), f.name.removesuffix(".yaml"), f.name) for f in files)


def load_scene(name: str) -> Scene:
    """Return a scene by built-in name, or from a YAML file.

    Parameters
    ----------
    name : str
        ``human``, or a path that ends in .yaml or .yml.

    Returns
    -------
    Scene
        The scene, checked.

    Raises
    ------
    SceneError
        If there is no such scene or file, or it says something impossible; the message
        names the key's path.
    """
    if name.endswith((".yaml", ".yml")):
        try:
            text = Path(name).read_text(encoding="utf-8")
        except (OSError, ValueError) as err:
            # ValueError: bytes that are no UTF-8, or a name that no file can have.
            msg = f"{name}: cannot read the scene file ({err})"
            raise SceneError(msg) from err
        return _parse(text, Path(name).stem, name)
    for scene in builtin_scenes():
        if scene.name == name:
            return scene
    known = ", ".join(scene.name for scene in builtin_scenes())
    msg = f"no scene '{name}'; built-in scenes are {known}; a file must end in .yaml"
    raise SceneError(msg)


def _parse(text: str, name: str, where: str) -> Scene:
    try:
        raw = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as err:
        # ValueError: a date that does not exist, or a number of thousands of digits.
        msg = f"{where}: not YAML: {' '.join(str(err).split())}"
        raise SceneError(msg) from err
    top = _mapping(raw, where, {"description", "steps", "clutter"})
    steps = top.get("steps")
    if not isinstance(steps, list) or not steps:
        msg = f"{where}: steps: must be a list with at least one step"
        raise SceneError(msg)
    parsed = tuple(_step(item, f"{where}: steps[{k}]") for k, item in enumerate(steps))
    clutter = [] if top.get("clutter") is None else top["clutter"]
    if not isinstance(clutter, list):
        msg = f"{where}: clutter: must be a list"
        raise SceneError(msg)
    points = tuple(_point(item, f"{where}: clutter[{k}]") for k, item in enumerate(clutter))
    description = "" if top.get("description") is None else top["description"]
    if not isinstance(description, str):
        msg = f"{where}: description: must be text"
        raise SceneError(msg)
    return Scene(name, " ".join(description.split()), parsed, points)


def _step(raw: Any, where: str) -> SceneStep:
    item = _mapping(raw, where, {"body", "duration_s"})
    body = item.get("body")
    if body is not None and (not isinstance(body, str) or body not in SEED_BODIES):
        msg = f"{where}.body: no body '{body}'; known are {', '.join(SEED_BODIES)}"
        raise SceneError(msg)
    return SceneStep(body, _number(item, "duration_s", where, 0.1, LONGEST_STEP_S))


def _point(raw: Any, where: str) -> StaticPoint:
    item = _mapping(raw, where, {"range_m", "rcs_m2"})
    return StaticPoint(
        _number(item, "range_m", where, 0.1, 1000), _number(item, "rcs_m2", where, 0, 1e9)
    )


def _mapping(raw: Any, where: str, known: set[str]) -> dict[str, Any]:
    if not isinstance(raw, dict):
        msg = f"{where}: must be a mapping with the keys {', '.join(sorted(known))}"
        raise SceneError(msg)
    for key in raw:
        if key not in known:
            msg = f"{where}.{key}: unknown key; known are {', '.join(sorted(known))}"
            raise SceneError(msg)
    return raw


def _number(item: dict[str, Any], key: str, where: str, low: float, high: float) -> float:
    value = item.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        # YAML takes 2.5e3 for text; with a sign, as in 2.5e+3, it is a number.
        msg = f"{where}.{key}: must be a number, not {value!r}"
        raise SceneError(msg)
    if not low <= value <= high:
        # Not :g, which a whole number beyond 1e308 does not take.
        msg = f"{where}.{key}: {value} is not in {low:g} to {high:g}"
        raise SceneError(msg)
    return float(value)


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive frames of one step: distances (n, n_scatterers) and their RCS."""

    range_m: Array
    rcs_m2: Array


class SceneClock:
    """Walk through a scene frame by frame, for ever.

    Parameters
    ----------
    scene : Scene
        What to play.
    seed : int
        Draws of all bodies follow from it.
    frame_rate_hz : float
        Frames per second.
    """

    def __init__(self, scene: Scene, seed: int, frame_rate_hz: float) -> None:
        self._scene = scene
        self._seed = seed
        self._rate_hz = frame_rate_hz
        self._steps = self._walk()
        self._body: tuple[Scatterer, ...] = ()
        self._at = 0
        self._n = 0

    def _walk(self) -> Iterator[tuple[tuple[Scatterer, ...], int]]:
        number = 0
        while True:
            for step in self._scene.steps:
                rng = np.random.default_rng([self._seed, number])
                body = draw(SEED_BODIES[step.body], rng) if step.body else ()
                yield body, max(1, round(step.duration_s * self._rate_hz))
                number += 1

    def next_block(self, most: int) -> Block:
        """Return the next frames, `most` of them or fewer where a step ends."""
        if self._at == self._n:
            self._body, self._n = next(self._steps)
            self._at = 0
        n = min(most, self._n - self._at)
        t_s = np.arange(self._at, self._at + n) / self._rate_hz
        self._at += n
        range_m, rcs_m2 = ranges(self._body, t_s)
        return Block(range_m, rcs_m2)
