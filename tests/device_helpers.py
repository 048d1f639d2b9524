"""A radar's far ends: simulated modules, and such whose every answer a test decides."""

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from x2radar.device.device import X2Radar
from x2radar.device.link import Deadlines
from x2radar.device.transport import PtyTransport, Transport, memory_pair
from x2radar.errors import TransportClosed
from x2radar.frame import Frame
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.faults import parse_faults
from x2radar.sim.module.host import connect, serve
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire import framing
from x2radar.wire.codec import decode_command, encode
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.messages import Ack, Data, Message, Ping, Pong, Reset, SystemMessage
from x2radar.wire.wire_ids import PongCode, SystemCode

SETTINGS = RadarSettings(frame_stitch=1)
_AGAIN = {"usb_gone_s": 0.01, "restart_s": 0.01, "again_s": 0.01}
SHORT = Deadlines(reply_s=5.0, ready_s=5.0, ping_every_s=0.03, stall_s=0.1, **_AGAIN)
HASTY = replace(SHORT, reply_s=0.15, ping_every_s=0.1)
READY = SystemMessage(SystemCode.READY)


def wire(*messages: Message) -> bytes:
    return b"".join(framing.encode(encode(m)) for m in messages)


def module() -> SimulatedModule:
    return SimulatedModule(load_scene("human"), seed=3)


def in_thread(work: Callable[..., object], *args: object, **kwargs: object) -> threading.Thread:
    thread = threading.Thread(target=work, args=args, kwargs=kwargs, daemon=True)
    thread.start()
    return thread


@contextmanager
def served(far: Transport, module: SimulatedModule, speed: float | None = None) -> Iterator[None]:
    """Have a simulated module at this end of a line for a while."""
    thread = in_thread(serve, module, far, speed=speed)
    try:
        yield
    finally:
        far.close()
        thread.join(60)
        assert not thread.is_alive()


@contextmanager
def plugged(module: SimulatedModule | None = None, speed=None) -> Iterator[PtyTransport]:
    """A pseudo-terminal with a simulated module at its far end: of an empty room, if not named."""
    far = PtyTransport()
    with served(far, module or SimulatedModule(load_scene("empty")), speed):
        yield far


def faulty(faults: str = "", speed: float | None = None, **options: Any) -> X2Radar:
    """A radar whose module is simulated, with faults as a port names them."""
    plan = parse_faults(faults) if faults else None
    scene = load_scene("human")
    return X2Radar(lambda: connect(lambda: SimulatedModule(scene, 0, plan), speed), **options)


class FarEnd:
    """A module whose every answer the test decides.

    Parameters
    ----------
    answer : callable
        Takes a command, returns the messages to send.
    """

    def __init__(self, answer: Callable[[Message], list[Message]]) -> None:
        self.near, self._far = memory_pair()
        self._answer = answer
        self.commands: list[Message] = []
        self._thread = in_thread(self._run)

    def _run(self) -> None:
        decoder = PacketDecoder()
        try:
            while True:
                for item in decoder.feed(self._far.read(1.0)):
                    assert isinstance(item, Packet)
                    self.commands.append(decode_command(item.data))
                    self._far.write(wire(*self._answer(self.commands[-1])))
        except TransportClosed:
            return

    def send(self, data: bytes) -> None:
        self._far.write(data)

    def join(self) -> None:
        """Wait until everything is read that came before the near end closed."""
        self._thread.join(60)
        assert not self._thread.is_alive()

    def close(self) -> None:
        self._far.close()
        self.join()


def obey(command: Message) -> list[Message]:
    """Answer as a module that takes everything."""
    match command:
        case Reset():
            return [Ack(), SystemMessage(SystemCode.BOOTING), READY]
        case Ping():
            return [Pong(PongCode.READY)]
    return [Ack()]


def obey_but(kind: type[Message], *answers: Message) -> Callable[[Message], list[Message]]:
    return lambda command: list(answers) if isinstance(command, kind) else obey(command)


@contextmanager
def scripted(
    answer: Callable[[Message], list[Message]] = obey, deadlines: Deadlines = SHORT
) -> Iterator[tuple[X2Radar, FarEnd]]:
    far = FarEnd(answer)
    radar = X2Radar(lambda: far.near, SETTINGS, deadlines=deadlines)
    yield radar, far
    radar.close()
    far.close()


class OnUsb:
    """A transport that says that it sits on USB."""

    is_usb = True

    def __init__(self, inner: Transport) -> None:
        self.read, self.write, self.close = inner.read, inner.write, inner.close


class Clock:
    """Time that passes only in sleeps and where a test says so."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.slept_s.append(duration_s)
        self.now_s += duration_s


def raw(counter: int) -> bytes:
    return wire(Data(0, counter, np.full(256, counter, np.float32)))


def take(radar: X2Radar, n: int) -> list[Frame]:
    return list(itertools.islice(radar.frames(), n))
