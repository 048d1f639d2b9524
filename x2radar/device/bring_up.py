"""BringUp: one opening of a module, from the port to the start of its stream.

Reset, wait for READY, ping until ready when it was missed, configure, start. A port on USB
vanishes meanwhile and is opened again; a module that restarts by itself is told its settings
again.
"""

import contextlib
import time
from collections import deque
from collections.abc import Callable

from x2radar.device.assemble import FrameAssembler
from x2radar.device.link import READ_S, RETRIES, Link, Listener
from x2radar.errors import DeviceError, PortError, RestartRequired, SafeModeError, TransportClosed
from x2radar.frame import CounterTracker, Frame
from x2radar.modules.base import ModuleSettings
from x2radar.wire import framing
from x2radar.wire.codec import encode
from x2radar.wire.messages import Ack, Message, Ping, Pong, Reset, SystemMessage
from x2radar.wire.wire_ids import PongCode, SystemCode

_REOPEN_EVERY_S = 0.1  # well under the half second that a module takes to restart


class BringUp:
    """A module whose port is open, or on its way to be; the link's `halt` ends every wait.

    Frames of its stream wait in `waiting`, until they are taken; their numbers go on from those
    of `count`, and the first one is marked as a restart unless it is frame 0.
    """

    def __init__(
        self, connect: Callable[[Listener], Link], settings: ModuleSettings, count: CounterTracker
    ) -> None:
        self.has_restarted = False
        self.waiting: deque[Frame] = deque()
        self._count = count
        self._connect = connect
        self._commands = settings.startup_commands()
        self._is_ready = self._is_ours = self._is_streaming = False
        self.link = connect(self._on_message)
        self._assembler = FrameAssembler(settings, self.link.counts, count)

    def close(self) -> None:
        """Tell a started module to stop, as far as it still listens; close the port."""
        # The first command of every start-up is the one that stops. What was never started
        # here goes on.
        self.link.close(framing.encode(encode(self._commands[0])) if self._is_ours else b"")

    def _attach_again(self, after_s: float) -> None:
        """Close the port, and open it `after_s` seconds later, as soon as it is back."""
        self.link.close()
        give_up_s = time.monotonic() + after_s + self.link.deadlines.ready_s
        self.link.halt.wait(after_s)
        while True:
            try:
                self.link = self._connect(self._on_message)
                break
            except PortError:
                if self.link.halt.is_set() or time.monotonic() > give_up_s:
                    raise
                self.link.halt.wait(_REOPEN_EVERY_S)
        if self.link.halt.is_set():
            # Who set it meanwhile may have closed the port before this one.
            self.link.close()

    def start(self) -> None:
        """Reset, unless it has just restarted by itself, configure and start; say why if not.

        Raises DeviceError, PortError or TransportClosed.
        """
        self._is_ours = True
        try:
            try:
                if self.has_restarted:
                    self._wait_ready()
                else:
                    self._reset()
                self._configure()
            except RestartRequired:
                # It restarts by itself now. Then everything is told again, once.
                self.link.counts["retries"] += 1
                if self.link.is_usb:
                    self._attach_again(self.link.deadlines.restart_s)
                else:
                    self.link.listen(self.link.deadlines.restart_s)
                self._reset()
                self._configure()
        except DeviceError as err:
            with contextlib.suppress(TransportClosed):
                self._check_safe_mode(self.link.ask(Ping(), self.link.deadlines.ping_every_s), err)
            raise

    def _reset(self) -> None:
        self._is_streaming = False
        is_usb = self.link.is_usb
        self._is_ready = self.has_restarted = False
        try:
            self.link.command(Reset(), resends=RETRIES, is_done=lambda: self.has_restarted)
        except TransportClosed:
            # On USB that is what a reset looks like whose answer was lost.
            if not is_usb or self.link.halt.is_set():
                raise
        if not is_usb:
            return self._wait_ready(self.link.deadlines.usb_gone_s)
        give_up_s = time.monotonic() + self.link.deadlines.usb_gone_s + self.link.deadlines.ready_s
        while True:
            self._attach_again(self.link.deadlines.usb_gone_s)
            try:
                return self._wait_ready()
            except TransportClosed:
                # It was opened before it had vanished.
                if self.link.halt.is_set() or time.monotonic() > give_up_s:
                    raise

    def _wait_ready(self, first_ping_s: float | None = None) -> None:
        """Wait for READY; ping when it does not come within `first_ping_s` seconds."""
        every_s = self.link.deadlines.ping_every_s
        pause_s = every_s if first_ping_s is None else first_ping_s
        give_up_s = time.monotonic() + self.link.deadlines.ready_s
        while (now_s := time.monotonic()) < give_up_s:
            ping_s = min(now_s + pause_s, give_up_s)
            while not self._is_ready and (now_s := time.monotonic()) < ping_s:
                self.link.pump(min(ping_s - now_s, READ_S))
            if self._is_ready:
                return
            pong = self.link.ask(Ping(), every_s)
            if isinstance(pong, Pong) and pong.code == PongCode.READY:
                return
            self._check_safe_mode(pong)
            pause_s = every_s
        msg = f"{self.link.name}: not ready {self.link.deadlines.ready_s:g} s after a reset"
        raise DeviceError(msg)

    def _check_safe_mode(self, pong: object, cause: DeviceError | None = None) -> None:
        if isinstance(pong, Pong) and pong.code == PongCode.SAFE_MODE:
            raise SafeModeError(
                f"{self.link.name} is in fail-safe mode, as after many crashes, and refuses "
                "commands: power it off and on again"
            ) from cause

    def _configure(self) -> None:
        *before, start = self._commands
        for _ in range(1 + RETRIES):
            self._is_streaming = self.has_restarted = False
            for command in before:
                self.link.command(command, resends=RETRIES)
                if self.has_restarted:
                    break
            else:
                # What came before is void; where a stream was before, its numbers go on.
                self.waiting.clear()
                self._count.last = None
                self._is_streaming = True
                # Where frames come, only the answer was lost; another start would cut them.
                self.link.command(start, resends=RETRIES, is_done=lambda: bool(self.waiting))
                if not self.has_restarted:
                    return
            self._wait_ready()
        raise DeviceError(f"{self.link.name} restarts again and again while it is configured")

    def _on_message(self, message: Message, command: Message | None, arrived_s: float) -> None:
        # Replies go to who asked; data from before the start are no stream.
        match command, message:
            case Reset(), Ack():
                # A READY from before it says nothing about the restart.
                self._is_ready = False
            case None, SystemMessage(SystemCode.BOOTING):
                self._is_ready, self.has_restarted = False, True
            case None, SystemMessage(SystemCode.READY):
                self._is_ready = self.has_restarted = True
            case None, Pong(PongCode.READY):
                # The late answer to a ping that was given up.
                self._is_ready = True
            case None, _ if self._is_streaming and not self.has_restarted:
                if frame := self._assembler.frame(message, arrived_s):
                    self.waiting.append(frame)
                    self.link.counts.update(frames=1, lost=frame.lost, restarts=frame.restarted)
