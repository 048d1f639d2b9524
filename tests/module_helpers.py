"""A simulated module, asked and listened to without a port."""

from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire import framing
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.framing import PacketDecoder
from x2radar.wire.messages import Ack, ErrorReply, SetMode, SetSysInt
from x2radar.wire.wire_ids import ErrorCode, Mode, SysCfg

HUMAN, EMPTY = load_scene("human"), load_scene("empty")
MANUAL = SetMode(Mode.MANUAL)
REFUSED = ErrorReply(ErrorCode.COMMAND_FAILED)
UNKNOWN = ErrorReply(ErrorCode.NOT_RECOGNIZED)


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
    if not m.is_streaming:
        assert ask(m, MANUAL) == [Ack()]
    out = []
    while len(out) < n:
        m.advance(m.next_due_s)
        out += said(m)
    return out[:n]
