"""What tests ask of the simulator: axes, frames of its receiver, and a module without a port."""

import math
from dataclasses import replace

import numpy as np

from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.place.room import Room, RoomSettings
from x2radar.sim.scene.scene import load_scene
from x2radar.sim.signal.pulse import LinkBudget
from x2radar.sim.signal.receiver import MIDDLE, Receiver, ReceiverEffects
from x2radar.wire import framing
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.framing import PacketDecoder
from x2radar.wire.messages import Ack, ErrorReply, SetMode, SetSysInt
from x2radar.wire.wire_ids import ErrorCode, Mode, SysCfg

HUMAN, EMPTY = load_scene("human"), load_scene("empty")
MANUAL = SetMode(Mode.MANUAL)
REFUSED = ErrorReply(ErrorCode.COMMAND_FAILED)
UNKNOWN = ErrorReply(ErrorCode.NOT_RECOGNIZED)


def axis_of(kind, settings=None):
    """The axis of a module's frames with `settings`, or with the defaults."""
    return replace((settings or RadarSettings()).axis, kind=kind)


def axis_with(kind, n_range, *numbers, **others):
    """An axis of bins: their length, their offset, carrier, bandwidth, sampling, or the X2's."""
    names = ("bin_length_m", "range_offset_m", "carrier_hz", "bandwidth_hz", "sample_rate_hz")
    named = dict(zip(names, numbers, strict=False))
    return replace(axis_of(kind), n_range=n_range, **named, **others)


RF, BASEBAND = axis_of("rf"), axis_of("baseband")


def silence(n, axis=RF):
    return np.zeros((n, axis.n_range), np.float32 if axis.kind == "rf" else np.complex64)


def affected(axis=RF, *, n=400, seed=0, echo=None, sizes=None, **effects):
    """Frames about the idle line with some effects on, in blocks of the given sizes."""
    rng, known = np.random.default_rng(seed), ReceiverEffects(**effects)
    ours = Receiver(RadarSettings(), axis, LinkBudget(), rng, effects=known, seed=seed)
    echo = silence(n, axis) if echo is None else echo
    cut = np.cumsum(sizes or [len(echo)])
    parts = np.split(echo, cut)[: cut.size]
    out = np.concatenate([getattr(ours, axis.kind)(part) for part in parts])
    return out.astype(np.complex128) - (MIDDLE if axis.kind == "rf" else 0)


def room_echo(axis, level_db=57.0):
    settings = RoomSettings(objects_db=level_db, diffuse_db=level_db - 17)
    return np.array(Room(np.random.default_rng(3), settings, axis).echo(np.zeros(400)))


def module(scene=HUMAN, seed=0):
    return SimulatedModule(scene, seed)


def said(m):
    """What the module has said since it was last asked, as messages."""
    decoder = PacketDecoder()
    out = [decode_response(packet.data) for packet in decoder.feed(m.data_to_send())]
    assert decoder.n_buffered == 0
    return out


def ask(m, *commands):
    """Send commands; return everything that came back."""
    for command in commands:
        m.receive(framing.encode(encode(command)))
    return said(m)


def fps(rate_hz):
    return SetSysInt(SysCfg.FPS, rate_hz)


def frames(m, n):
    """Start the stream if it does not run, and return the next `n` frame messages."""
    if m.next_due_s == math.inf:
        assert ask(m, MANUAL) == [Ack()]
    out = []
    while len(out) < n:
        m.advance(m.next_due_s)
        out += said(m)
    return out[:n]
