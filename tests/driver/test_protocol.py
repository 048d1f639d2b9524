"""The session: which reply belongs to which command."""

import numpy as np
import pytest

from tests.device_helpers import wire
from x2radar.errors import MessageError, ProtocolError
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.protocol import Answered, Damaged, Event, Received, Refused, Session
from x2radar.wire.wire_ids import ErrorCode, Mode, PongCode, SystemCode

RUN = msg.SetMode(Mode.RUN)
PONG = msg.Pong(PongCode.READY)


def events(session: Session, data: bytes = b"") -> list[Event]:
    session.receive(data)
    out = []
    while (event := session.next_event()) is not None:
        out.append(event)
    return out


def waiting_for(command: msg.Message) -> Session:
    session = Session()
    session.send(command)
    assert session.outstanding == command
    return session


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        (RUN, msg.Ack()),
        (msg.Reset(), msg.Ack()),
        (msg.LoadProfile(1), msg.Ack()),
        (msg.Ping(), PONG),
        (msg.GetSystemInfo(2), msg.Reply(0x58, 2, "firmware")),
        (msg.GetMode(), msg.Reply(0, 0, (1,))),
        (RUN, msg.ErrorReply(ErrorCode.BUSY)),
    ],
    ids=lambda m: type(m).__name__,
)
def test_reply_answers_its_command(command: msg.Message, reply: msg.Message) -> None:
    session = waiting_for(command)
    is_refusal = isinstance(reply, msg.ErrorReply)
    wanted = Refused(command, reply.code) if is_refusal else Answered(command, reply)
    assert events(session, wire(reply)) == [wanted]
    assert session.outstanding is None
    session.send(command)


@pytest.mark.parametrize(
    "message", [msg.ErrorReply(ErrorCode.BUSY), msg.Unknown(b"\xb0\x01"), msg.Ack()]
)
def test_what_no_command_waits_for_is_received(message: msg.Message) -> None:
    assert events(Session(), wire(message)) == [Received(message)]


def test_data_between_a_command_and_its_reply() -> None:
    session = waiting_for(RUN)
    ready = msg.SystemMessage(SystemCode.READY)
    frame = msg.Data(0, 1, np.ones(3, np.float32))
    first, second, third, fourth = events(session, wire(frame, ready, msg.Ack(), frame))
    assert isinstance(first, Received)
    assert isinstance(first.message, msg.Data)
    assert second == Received(ready)
    assert third == Answered(RUN, msg.Ack())
    assert isinstance(fourth, Received)


@pytest.mark.parametrize(
    ("command", "other"), [(msg.Ping(), msg.Ack()), (RUN, PONG), (msg.GetSystemInfo(1), msg.Ack())]
)
def test_another_reply_type_is_no_answer(command: msg.Message, other: msg.Message) -> None:
    session = waiting_for(command)
    assert events(session, wire(other)) == [Received(other)]
    assert session.outstanding == command


def test_damage_does_not_end_the_wait() -> None:
    session = waiting_for(RUN)
    bad = bytearray(wire(msg.Ack()))
    bad[-2] ^= 1
    assert events(session, b"\x01\x02" + bytes(bad) + wire(msg.Ack())) == [
        Damaged("junk between packets", 2),
        Damaged("crc error", 4),
        Answered(RUN, msg.Ack()),
    ]
    # Nor does a sound packet with broken content.
    session = waiting_for(msg.Ping())
    (event,) = events(session, framing.encode(b"\x01\x02"))
    assert isinstance(event, Damaged)
    assert "Pong cut short" in event.reason
    assert event.n_bytes == 2
    assert session.outstanding == msg.Ping()


def test_second_command_is_refused_while_one_waits() -> None:
    session = waiting_for(RUN)
    with pytest.raises(ProtocolError, match="not answered yet"):
        session.send(msg.Ping())
    assert session.outstanding == RUN
    assert (session.data_to_send(), session.data_to_send()) == (wire(RUN), b"")
    session.give_up()
    with pytest.raises(MessageError):
        session.send(msg.SetMode(300))
    assert (session.outstanding, session.data_to_send()) == (None, b"")


def test_give_up_allows_the_next_command() -> None:
    session = waiting_for(msg.Ping())
    session.give_up()
    assert session.outstanding is None
    session.send(RUN)
    # The late pong is nobody's any more.
    assert events(session, wire(PONG, msg.Ack())) == [Received(PONG), Answered(RUN, msg.Ack())]
