"""Link: one opening of a port; commands with deadlines, and counts of what went wrong.

The session matches replies, the transport moves bytes; a link joins them to a clock. What
comes besides replies goes to one listener, in the order of arrival.

A command that stays without an answer may have been lost on the way, or its answer; it is
sent again where that does no harm. The late answer of the first copy would then be taken
for that of the next command, so a ping draws the line: modules answer in order, and no
answer but the ping's own is a pong.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from x2radar.device.transport import Transport
from x2radar.errors import DeviceError, RestartRequired, TransportClosed
from x2radar.wire.messages import Message, Ping
from x2radar.wire.protocol import Answered, Damaged, Event, Received, Refused, Session
from x2radar.wire.wire_ids import ErrorCode

RETRIES = 3
READ_S = 0.25
# The module did not take the command, and says that it may do so later.
_AGAIN = frozenset({ErrorCode.BUSY, ErrorCode.CRC_FAILED})

Listener = Callable[[Event, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deadlines:
    """How long the driver waits, in seconds.

    Attributes
    ----------
    reply_s : float
        For the reply to one command (ModuleConnector waits 2 s), and in all for a module
        that says it is busy.
    ready_s : float
        From reset to ready; a module on USB re-enumerates in between.
    ping_every_s : float
        Pause after which a module that should be ready is asked again.
    usb_gone_s : float
        After a reset was acknowledged, until a port on USB is opened again and any module is
        asked whether it is ready: it acknowledges first and restarts half a second later.
    stall_s : float
        Without a frame for so long, a stream counts as lost although the port is open; or
        for three frames, where that is longer.
    restart_s : float
        For a module that answered that it restarts by itself (error 0x22).
    again_s : float
        Until a busy module is asked again.
    """

    reply_s: float = 2.0
    ready_s: float = 10.0
    ping_every_s: float = 0.25
    usb_gone_s: float = 0.7
    stall_s: float = 1.5
    restart_s: float = 2.0
    again_s: float = 0.1


class Link:
    """One open port with its session.

    Parameters
    ----------
    transport : Transport
        Just opened; closed by `close`.
    listener : callable
        Gets every event, replies too, with its time of arrival in seconds (monotonic).
    name : str
        What to call the module in messages.
    deadlines : Deadlines
        How long to wait.
    counts : Counter
        Where "retries" and "damaged" are counted.
    halt : Event
        Set by whoever wants every wait to end.
    """

    def __init__(
        self,
        transport: Transport,
        listener: Listener,
        *,
        name: str,
        deadlines: Deadlines,
        counts: Counter[str],
        halt: threading.Event,
    ) -> None:
        self._transport = transport
        self._listener = listener
        self._name = name
        self._deadlines = deadlines
        self._counts = counts
        self._halt = halt
        self._session = Session()
        # Asked now: once the module restarts, its device is no longer there to look at.
        self.is_usb = bool(getattr(transport, "is_usb", False))

    def close(self, farewell: bytes = b"") -> None:
        """Close the port, after sending `farewell` as far as it still goes out."""
        try:
            if farewell:
                self._transport.write(farewell)
        except TransportClosed:
            pass
        finally:
            self._transport.close()

    def pump(self, wait_s: float) -> Answered | Refused | None:
        """Move bytes once, waiting up to `wait_s` seconds for the first; return the reply.

        Raises
        ------
        TransportClosed
            If the port went away, or is being closed.
        """
        if self._halt.is_set():
            msg = f"{self._name} was closed"
            raise TransportClosed(msg)
        session = self._session
        if out := session.data_to_send():
            self._transport.write(out)
        if data := self._transport.read(wait_s):
            session.receive(data)
        arrived_s = time.monotonic()
        reply: Answered | Refused | None = None
        while (event := session.next_event()) is not None:
            match event:
                case Answered() | Refused():
                    # One command is out at a time, so there is one reply at most.
                    reply = event
                case Damaged():
                    self._counts["damaged"] += 1
                case Received():
                    pass
            self._listener(event, arrived_s)
        return reply

    def listen(self, wait_s: float) -> None:
        """Take what comes for `wait_s` seconds."""
        until_s = time.monotonic() + wait_s
        while (left_s := until_s - time.monotonic()) > 0:
            self.pump(min(left_s, READ_S))

    def ask(self, command: Message, wait_s: float) -> Message | Refused | None:
        """Send a command once.

        Parameters
        ----------
        command : Message
            Any host message.
        wait_s : float
            How long to wait for the answer, in seconds.

        Returns
        -------
        Message, Refused or None
            The reply, the refusal, or nothing in time.
        """
        session = self._session
        session.give_up()
        session.send(command)
        until_s = time.monotonic() + wait_s
        while (left_s := until_s - time.monotonic()) > 0:
            reply = self.pump(min(left_s, READ_S))
            if reply is not None:
                return reply.reply if isinstance(reply, Answered) else reply
        session.give_up()
        return None

    def command(
        self,
        command: Message,
        *,
        resends: int = 0,
        wait_s: float | None = None,
        is_done: Callable[[], bool] = lambda: False,
    ) -> Message | None:
        """Send a command until it is answered.

        Parameters
        ----------
        command : Message
            Any host message.
        resends : int
            How often it may be sent again when no answer comes.
        wait_s : float, optional
            For each answer, in seconds; otherwise `Deadlines.reply_s`.
        is_done : callable
            Asked when no answer came: whether the command shows its effect all the same.

        Returns
        -------
        Message or None
            The reply; None when `is_done` said so.

        Raises
        ------
        DeviceError
            If the module refuses (RestartRequired with error 0x22), or never answers.
        """
        wait_s = self._deadlines.reply_s if wait_s is None else wait_s
        busy_until_s = time.monotonic() + wait_s
        unanswered = 0
        while True:
            reply = self.ask(command, wait_s)
            if reply is None:
                if is_done():
                    return None
                unanswered += 1
                if unanswered > resends:
                    msg = f"{self._name}: no answer to {command}"
                    raise DeviceError(msg)
            elif isinstance(reply, Refused):
                if not self.may_ask_again(reply) or time.monotonic() > busy_until_s:
                    raise refusal(self._name, reply)
            else:
                if unanswered and not isinstance(command, Ping):
                    self.ask(Ping(), self._deadlines.ping_every_s)
                return reply
            self._counts["retries"] += 1

    def may_ask_again(self, refused: Refused) -> bool:
        """Say whether a refusal is one for now only, after waiting until it may be over."""
        if refused.code not in _AGAIN:
            return False
        self.listen(self._deadlines.again_s)
        return True


def refusal(name: str, refused: Refused) -> DeviceError:
    """Return the error that says what `name` refused."""
    code = refused.code
    try:
        label = ErrorCode(code).name.lower().replace("_", " ")
    except ValueError:
        label = "unknown"
    kind = RestartRequired if code == ErrorCode.RESTARTING else DeviceError
    return kind(f"{name} refused {refused.command}: error {code:#x} ({label})")
