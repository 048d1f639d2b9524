"""The session: which reply belongs to which command. Feed bytes, take events; no clock, no port.

A session holds at most one outstanding command and matches by type, from `layouts.ANSWERS`: the
awaited type answers the command (`Answered`), ERROR refuses it (`Refused`), everything else is
passed on as `Received`. The caller decides when to `give_up`.
"""

from collections import deque
from dataclasses import dataclass

from x2radar.errors import MessageError, ProtocolError
from x2radar.wire import framing
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.framing import LineFault, Packet, PacketDecoder
from x2radar.wire.layouts import ANSWERS
from x2radar.wire.messages import Ack, ErrorReply, Message


@dataclass(frozen=True, slots=True)
class Received:
    """A message that answers nothing: data, status, system messages, extra ACKs."""

    message: Message


@dataclass(frozen=True, slots=True)
class Answered:
    """The outstanding command was answered."""

    command: Message
    reply: Message


@dataclass(frozen=True, slots=True)
class Refused:
    """The outstanding command was refused."""

    command: Message
    code: int


@dataclass(frozen=True, slots=True)
class Damaged:
    """Bytes were dropped, or a sound packet could not be read."""

    reason: str
    n_bytes: int


Event = Received | Answered | Refused | Damaged


class Session:
    """The host's side of the protocol, without I/O."""

    def __init__(self) -> None:
        self._decoder = PacketDecoder()
        self._events: deque[Event] = deque()
        self._to_send = bytearray()
        self.outstanding: Message | None = None
        """The command that waits for its reply, or None."""

    def send(self, command: Message) -> None:
        """Queue a command; raises ProtocolError if another one still waits for its reply."""
        if self.outstanding is not None:
            raise ProtocolError(f"{self.outstanding} is not answered yet")
        self._to_send += framing.encode(encode(command))
        self.outstanding = command

    def give_up(self) -> None:
        """Stop waiting for the outstanding command's reply."""
        self.outstanding = None

    def data_to_send(self) -> bytes:
        """Return the bytes that must go to the port now, and forget them."""
        data = bytes(self._to_send)
        self._to_send.clear()
        return data

    def receive(self, data: bytes) -> None:
        """Take bytes from the port; what they mean comes from `next_event`."""
        for item in self._decoder.feed(data):
            self._events.append(self._read(item))

    def next_event(self) -> Event | None:
        """Return the next event, or None when more bytes are needed."""
        return self._events.popleft() if self._events else None

    def _read(self, item: Packet | LineFault) -> Event:
        if isinstance(item, LineFault):
            return Damaged(item.fault.value, item.n_bytes)
        try:
            message = decode_response(item.data)
        except MessageError as err:
            return Damaged(str(err), len(item.data))
        command = self.outstanding
        if command is not None:
            if isinstance(message, ErrorReply):
                self.outstanding = None
                return Refused(command, message.code)
            if isinstance(message, ANSWERS.get(type(command), Ack)):
                self.outstanding = None
                return Answered(command, message)
        return Received(message)
