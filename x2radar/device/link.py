"""Link: one opening of a port; commands with deadlines, and counts of what went wrong.

One command at most is out: its type in `ANSWERS` answers it, ERROR refuses it, everything else
answers nothing. It is sent again where that does no harm. The late answer of the first copy would
be taken for that of the next command, so a ping draws the line: no answer but its own is a pong.
"""

import contextlib
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from x2radar.device.transport import Transport
from x2radar.errors import DeviceError, RestartRequired, TransportClosed
from x2radar.wire import framing
from x2radar.wire.codec import encode, read_messages
from x2radar.wire.messages import ANSWERS, Ack, ErrorReply, Message, Ping, Reset
from x2radar.wire.wire_ids import ErrorCode

RETRIES = 3
"""How often a command is sent again: one lost packet is common, four in a row are not."""

READ_S = 0.25
"""Longest wait of one read: so much later a call of `close` is noticed at the latest."""

_AGAIN = frozenset({ErrorCode.BUSY, ErrorCode.CRC_FAILED})
"""The module did not take the command, and says that it may do so later."""
_ERROR_NAMES = {int(code): code.name.lower().replace("_", " ") for code in ErrorCode}

Listener = Callable[[Message, Message | None, float], None]
"""Gets a message, the command that it answers or refuses, and when it came, in monotonic s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Deadlines:
    """How long the driver waits, in seconds: what real modules leave room for."""

    reply_s: float = 2.0
    """For the reply to one command (as ModuleConnector), and in all for a busy module."""
    ready_s: float = 10.0
    """From reset to ready; a module on USB re-enumerates in between."""
    ping_every_s: float = 0.25
    """Until a module that should be ready is asked again."""
    usb_gone_s: float = 0.7
    """After a reset was acknowledged, until a port on USB is opened again and any module is asked
    whether it is ready: it restarts half a second after the answer
    (docs/reference/protocol.md)."""
    stall_s: float = 1.5
    """Without a frame for so long, or for three frames where that is longer, a stream counts as
    lost although the port is open."""
    restart_s: float = 2.0
    """For a module that answered that it restarts by itself (error 0x22)."""
    again_s: float = 0.1
    """Until a busy module is asked again."""


@dataclass(eq=False)
class Link:
    """One open port; `listener` gets every message."""

    transport: Transport
    listener: Listener
    name: str
    deadlines: Deadlines
    counts: Counter[str]
    halt: threading.Event

    def __post_init__(self) -> None:
        """Begin with nothing read and nothing asked."""
        self._decoder = framing.PacketDecoder()
        self._command: Message | None = None
        # Asked now: once the module restarts, its device is no longer there to look at.
        self.is_usb = bool(getattr(self.transport, "is_usb", False))

    def close(self, farewell: bytes = b"") -> None:
        """Close the port, after sending `farewell` as far as it still goes out."""
        with contextlib.closing(self.transport), contextlib.suppress(TransportClosed):
            if farewell:
                self.transport.write(farewell)

    def pump(self, wait_s: float, out: bytes = b"") -> Message | None:
        """Send `out`; read once, waiting `wait_s` for the first byte; return the reply."""
        if self.halt.is_set():
            raise TransportClosed(f"{self.name} was closed")
        if out:
            self.transport.write(out)
        data = self.transport.read(wait_s)
        arrived_s = time.monotonic()
        reply: Message | None = None
        for message in read_messages(self._decoder, data):
            if message is None:
                self.counts["damaged"] += 1
                continue
            command = self._command
            if command and isinstance(message, (ErrorReply, ANSWERS.get(type(command), Ack))):
                reply, self._command = message, None
            else:
                command = None
            self.listener(message, command, arrived_s)
        return reply

    def listen(self, wait_s: float) -> None:
        """Take what comes for `wait_s` seconds."""
        until_s = time.monotonic() + wait_s
        while (left_s := until_s - time.monotonic()) > 0:
            self.pump(min(left_s, READ_S))

    def ask(self, command: Message, wait_s: float) -> Message | None:
        """Send a command once; return its reply or refusal, or None after `wait_s` seconds."""
        out, self._command = framing.encode(encode(command)), command
        until_s = time.monotonic() + wait_s
        reply = None
        while reply is None and (left_s := until_s - time.monotonic()) > 0:
            reply, out = self.pump(min(left_s, READ_S), out), b""
        self._command = None
        return reply

    def command(
        self,
        command: Message,
        *,
        resends: int = 0,
        wait_s: float | None = None,
        is_done: Callable[[], bool] = lambda: False,
    ) -> Message:
        """Send a command until it is answered, up to `resends` times more; return the reply.

        When no answer came within `wait_s`, `is_done` says whether the command shows its effect
        all the same, as if ACK had come. Raises DeviceError (RestartRequired with error 0x22)
        otherwise.
        """
        wait_s = self.deadlines.reply_s if wait_s is None else wait_s
        busy_until_s = time.monotonic() + wait_s
        unanswered = 0
        while True:
            reply = self.ask(command, wait_s)
            if reply is None:
                if is_done():
                    return Ack()
                unanswered += 1
                if unanswered > resends:
                    hint = "a reset; is it an XeThru X2 module?"
                    asked = hint if isinstance(command, Reset) else command
                    raise DeviceError(f"{self.name}: no answer to {asked}")
            elif isinstance(reply, ErrorReply):
                code = reply.code
                if code not in _AGAIN or time.monotonic() > busy_until_s:
                    kind = RestartRequired if code == ErrorCode.RESTARTING else DeviceError
                    label = _ERROR_NAMES.get(code, "unknown")
                    raise kind(f"{self.name} refused {command}: error {code:#x} ({label})")
                self.listen(self.deadlines.again_s)
            else:
                if unanswered and not isinstance(command, (Ping, Reset)):
                    self.ask(Ping(), self.deadlines.ping_every_s)
                return reply
            self.counts["retries"] += 1
