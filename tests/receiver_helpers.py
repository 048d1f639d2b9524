"""Frames of the simulated receiver with some effects on, for the tests of it."""

import numpy as np

from tests.sim_helpers import axis_of
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.place.room import Room, RoomSettings
from x2radar.sim.signal.effects import ReceiverEffects
from x2radar.sim.signal.pulse import LinkBudget
from x2radar.sim.signal.receiver import MIDDLE, Receiver

RF, BASEBAND = axis_of("rf"), axis_of("baseband")


def silence(n, axis=RF):
    return np.zeros((n, axis.n_range), np.float32 if axis.kind == "rf" else np.complex64)


def affected(axis=RF, *, n=400, seed=0, echo=None, sizes=None, **effects):
    """Frames about the idle line with some effects on, in blocks of the given sizes."""
    ours = Receiver(
        RadarSettings(),
        axis,
        LinkBudget(),
        np.random.default_rng(seed),
        effects=ReceiverEffects(**effects),
        seed=seed,
    )
    echo = silence(n, axis) if echo is None else echo
    cut = np.cumsum(sizes or [len(echo)])
    parts = np.split(echo, cut)[: cut.size]
    out = np.concatenate([getattr(ours, axis.kind)(part) for part in parts])
    return out.astype(np.complex128) - (MIDDLE if axis.kind == "rf" else 0)


def room_echo(axis, level_db=57.0):
    settings = RoomSettings(objects_db=level_db, diffuse_db=level_db - 17)
    room = Room(np.random.default_rng(3), settings, axis, LinkBudget())
    return np.array(room.echo(np.zeros(400)))
