"""What a scene costs: milliseconds of CPU for a second of the stream, part by part.

A part costs what the stream costs with it, less what it costs without it: its echoes and their
ways by floor, walls and things included. Medians of some rounds; a part that costs less than they
scatter may come out below nothing.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.cast import Actor
from x2radar.sim.scene.scene import ERRORS_DB, Scene, SceneStep
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.receiver import ReceiverEffects
from x2radar.sim.things.kinds import THINGS

_BLOCK, _ROUNDS = 16, 5  # frames that a stream makes at a time; how often everything is timed
_USUAL_HZ, _FAST_HZ = 60, 200
_WHOLE, _NOISE = "the whole scene", "noise of the receiver"


@dataclass(frozen=True, slots=True)
class Cost:
    """A line of the bill."""

    part: str
    cpu_ms: float  # for a second of the stream
    error_db: float | None = None  # measured, of echoes made with a bound


def bill(scene: Scene, seed: int = 0) -> list[Cost]:
    """Return what a scene's parts cost, the whole at other settings, and echoes by their bound."""
    usual = RadarSettings.for_frame_rate(_USUAL_HZ, output="iq")
    fast = RadarSettings.for_frame_rate(_FAST_HZ, output="iq")
    nothing = Scene(scene.name, "", ((SceneStep((), 1.0, 1.0),),))
    without = {name: (left, usual) for name, left in parts(scene)}
    whole = {
        _WHOLE: (scene, usual),
        f"{_WHOLE} as RF": (scene, replace(usual, output="rf")),
        f"{_WHOLE} at {_FAST_HZ} Hz": (scene, fast),
    }
    streams = {_NOISE: (nothing, usual), **without, **whole}
    lines = []
    for name, (played, settings) in streams.items():
        rounds = []
        for _ in range(_ROUNDS):
            spent = cpu_ms(played, seed, settings)
            # Side by side, so that a busy computer slows both.
            rounds.append(cpu_ms(scene, seed, usual) - spent if name in without else spent)
        lines.append(Cost(name, float(np.median(rounds))))
    return [*lines, *echoes(scene, seed, usual)]


def parts(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """Return every part that a scene names, and the scene without it."""
    steps = [step for choice in scene.steps for step in choice]
    actors = [actor for step in steps for actor in step.actors] + list(scene.background)
    for name in dict.fromkeys(map(_name, actors)):
        yield name, _without(scene, name)
    without = {
        "clutter": replace(scene, clutter=()),
        "antenna's pattern": replace(scene, antenna=replace(scene.antenna, shape="isotropic")),
        "multipath: surfaces": replace(scene, surfaces=()),
        "room": replace(scene, room=None),
        "multipath: tail": replace(scene, tail=None),
        "mount": replace(scene, mount=None),
    }
    for effect in fields(ReceiverEffects):
        default: Any = effect.default
        off = replace(scene.receiver, **{effect.name: default})
        without[f"receiver: {effect.name}"] = replace(scene, receiver=off)
    yield from ((line, left) for line, left in without.items() if left != scene)


def echoes(scene: Scene, seed: int, settings: RadarSettings) -> Iterator[Cost]:
    """Return what echoes alone cost at every bound of their error, with the error measured."""
    rate_hz = settings.frame_rate_hz
    rows = Stage(scene, seed, rate_hz).next_block(round(rate_hz)).rows
    amplitude = rows.root_rcs_m / rows.range_m**2
    total = np.maximum(np.abs(amplitude).sum(axis=1, keepdims=True), np.finfo(np.float32).tiny)
    blocks = [slice(at, at + _BLOCK) for at in range(0, len(amplitude), _BLOCK)]

    def made(bound_db: float) -> NDArray[Any]:
        make = partial(echo_frames, axis=settings.axis, error_db=bound_db)
        return np.concatenate([make(rows.range_m[at], amplitude[at]) for at in blocks])

    exact = made(-130.0)
    for bound_db in ERRORS_DB if exact.any() else ():
        worst = (np.abs(made(bound_db) - exact) / total).max()
        spent_ms = min(_timed_ms(partial(made, bound_db)) for _ in range(_ROUNDS))
        scaled_ms = spent_ms * rate_hz / len(amplitude)
        yield Cost(f"echoes within {bound_db:g} dB", scaled_ms, float(20 * np.log10(worst)))


def _name(actor: Actor) -> str:
    """Return what an actor is on the bill: a body by its skin, or a thing."""
    if actor.kind in THINGS:
        return f"thing: {actor.kind}"
    is_thesis = actor.kind in THESIS_BODIES
    skin = "" if is_thesis else f", skin {actor.options.get('skin', 'surface')}"
    return f"body: {actor.kind}{skin}"


def _without(scene: Scene, name: str) -> Scene:
    """Return a scene without what has a name on the bill."""

    def left(actors: tuple[Actor, ...]) -> tuple[Actor, ...]:
        return tuple(actor for actor in actors if _name(actor) != name)

    less = replace(scene, background=left(scene.background))
    return _each_step(less, lambda step: replace(step, actors=left(step.actors)))


def _each_step(scene: Scene, change: Callable[[SceneStep], SceneStep]) -> Scene:
    return replace(scene, steps=tuple(tuple(map(change, choice)) for choice in scene.steps))


def cpu_ms(scene: Scene, seed: int, settings: RadarSettings) -> float:
    """Return the CPU time of a second of the stream, evenly over the scene's steps."""
    # Every step lasts a second.
    short = _each_step(scene, lambda step: replace(step, least_s=1.0, most_s=1.0))
    stream = EchoStream(short, seed, settings)
    n = _BLOCK * round(len(scene.steps) * settings.frame_rate_hz / _BLOCK)
    stream.next()  # what is made once, such as the echoes' grid
    spent_ms = _timed_ms(lambda: [stream.next() for _ in range(n)])
    return spent_ms * settings.frame_rate_hz / n


def _timed_ms(work: Callable[[], object]) -> float:
    begun_s = time.process_time()
    work()
    return 1000 * (time.process_time() - begun_s)
