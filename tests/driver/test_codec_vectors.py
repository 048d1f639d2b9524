"""Whole packets, byte for byte, from outside and from an independent encoder.

The vectors were computed with another implementation of the protocol. `OUTSIDE` names those
that the maker's document, a public client or a trace of a real module prints as well.
docs/research/hardware.md states the counts.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from x2radar.wire.codec import decode_any, decode_command, decode_response, encode
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.framing import encode as frame
from x2radar.wire.layouts import COMMAND_VARIANTS, COMMANDS
from x2radar.wire.messages import (
    Ack,
    ErrorReply,
    GetSystemInfo,
    LoadProfile,
    Message,
    Ping,
    Pong,
    Reset,
    SetBaudRate,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SystemMessage,
)
from x2radar.wire.messages_status import RespirationStatus
from x2radar.wire.messages_x4 import X4SetFrameRate, X4SetPulsesPerStep
from x2radar.wire.wire_ids import (
    BasebandOutput,
    ErrorCode,
    InfoItem,
    Led,
    Mode,
    OutputRef,
    PongCode,
    Profile,
    RespirationState,
    SystemCode,
)

DOCS = Path(__file__).parents[2] / "docs" / "research" / "hardware.md"


def f32(value: float) -> float:
    return float(np.float32(value))


COMMAND_VECTORS = {
    "ping": (Ping(), "7d 01 ae ea aa ee 7c 7e"),
    "reset": (Reset(), "7d 22 5f 7e"),
    "run": (SetMode(Mode.RUN), "7d 20 01 5c 7e"),
    "idle": (SetMode(Mode.IDLE), "7d 20 11 4c 7e"),
    "manual": (SetMode(Mode.MANUAL), "7d 20 12 4f 7e"),
    "stop": (SetMode(Mode.STOP), "7d 20 13 4e 7e"),
    "load respiration": (LoadProfile(Profile.RESPIRATION), "7d 21 d6 a2 23 14 1f 7e"),
    "load sleep": (LoadProfile(Profile.SLEEP), "7d 21 17 7b f1 00 c1 7e"),
    "load presence": (LoadProfile(Profile.PRESENCE), "7d 21 12 89 28 00 ef 7e"),
    "led full": (SetLed(Led.FULL), "7d 24 02 00 5b 7e"),
    "led off": (SetLed(Led.OFF), "7d 24 00 00 59 7e"),
    "zone 1.8 to 2.5": (
        SetDetectionZone(f32(1.8), 2.5),
        "7d 10 10 1c 0a a1 96 66 66 e6 3f 00 00 20 40 e5 7e",
    ),
    "zone 0.4 to 2.0": (
        SetDetectionZone(f32(0.4), 2.0),
        "7d 10 10 1c 0a a1 96 cd cc cc 3e 00 00 00 40 ef 7e",
    ),
    "sensitivity 9": (SetSensitivity(9), "7d 10 10 2b 11 a5 10 09 00 00 00 fb 7e"),
    "baseband off": (
        SetOutput(OutputRef.BASEBAND, BasebandOutput.OFF),
        "7d 90 71 10 00 00 00 01 00 00 00 00 00 00 00 8d 7e",
    ),
    "baseband iq": (
        SetOutput(OutputRef.BASEBAND, BasebandOutput.IQ),
        "7d 90 71 10 00 00 00 01 00 00 00 01 00 00 00 8c 7e",
    ),
    "baseband ap": (
        SetOutput(OutputRef.BASEBAND, BasebandOutput.AMPLITUDE_PHASE),
        "7d 90 71 10 00 00 00 01 00 00 00 02 00 00 00 8f 7e",
    ),
    "baud 921600": (SetBaudRate(921_600), "7d 90 80 00 10 0e 00 73 7e"),
    "firmware id": (GetSystemInfo(InfoItem.FIRMWARE_ID), "7d 90 58 02 b7 7e"),
    "x4 20 fps": (X4SetFrameRate(20.0), "7d 50 10 10 00 00 00 00 00 a0 41 cc 7e"),
}
RESPONSE_VECTORS = {
    "pong ready": (Pong(PongCode.READY), "7d 01 ea ae ee aa 7c 7e"),
    "pong not ready": (Pong(PongCode.NOT_READY), "7d 01 aa ee ea ae 7c 7e"),
    "ack": (Ack(), "7d 10 6d 7e"),
    "booting": (SystemMessage(SystemCode.BOOTING), "7d 30 10 00 00 00 5d 7e"),
    "ready": (SystemMessage(SystemCode.READY), "7d 30 11 00 00 00 5c 7e"),
    "not recognised": (ErrorReply(ErrorCode.NOT_RECOGNIZED), "7d 20 01 00 00 00 5c 7e"),
    "command failed": (ErrorReply(ErrorCode.COMMAND_FAILED), "7d 20 21 00 00 00 7c 7e"),
}
OUTSIDE = {
    "ping",
    "reset",
    "run",
    "idle",
    "manual",
    "stop",
    "load respiration",
    "load sleep",
    "led full",
    "zone 1.8 to 2.5",
    "sensitivity 9",
    "x4 20 fps",
    "ack",
    "booting",
    "ready",
}


def unpacked(wire: str) -> bytes:
    (item,) = PacketDecoder().feed(bytes.fromhex(wire))
    assert isinstance(item, Packet)
    return item.data


@pytest.mark.parametrize(("message", "wire"), COMMAND_VECTORS.values(), ids=COMMAND_VECTORS)
def test_commands(message: Message, wire: str) -> None:
    assert frame(encode(message)) == bytes.fromhex(wire)
    assert decode_command(unpacked(wire)) == decode_any(unpacked(wire)) == message


@pytest.mark.parametrize(("message", "wire"), RESPONSE_VECTORS.values(), ids=RESPONSE_VECTORS)
def test_responses(message: Message, wire: str) -> None:
    assert frame(encode(message)) == bytes.fromhex(wire)
    assert decode_response(unpacked(wire)) == decode_any(unpacked(wire)) == message


def test_first_status_of_a_real_module() -> None:
    # A public client's trace of an X2M200, the sleep profile just started.
    wire = "7d 50 26 fe 75 23 01 00 00 00 04 00 00 00 01 00 00 00" + " 00" * 12 + " a7 7e"
    message = RespirationStatus(1, RespirationState.INITIALISING, 1, 0.0, 0.0, 0)
    assert decode_response(unpacked(wire)) == message
    assert frame(encode(message)) == bytes.fromhex(wire)


def test_pulses_per_step_as_the_document_prints_it() -> None:
    # One byte, where its text has four: read, but sent with four.
    assert decode_command(unpacked("7d 50 10 11 00 00 00 14 38 7e")) == X4SetPulsesPerStep(20)


def test_counts_that_the_documentation_states() -> None:
    vectors = COMMAND_VECTORS | RESPONSE_VECTORS
    assert set(vectors) >= OUTSIDE
    classes = {row.cls for row in COMMANDS + COMMAND_VARIANTS} | {SetOutput}
    printed = {type(message) for name, (message, _) in COMMAND_VECTORS.items() if name in OUTSIDE}
    counts = {
        "packets": len(vectors),
        "packets outside": len(OUTSIDE),
        "packets that are commands": len(COMMAND_VECTORS),
        "packets that are commands, outside": len(OUTSIDE & set(COMMAND_VECTORS)),
        "classes of commands": len(classes),
        "classes of commands with a vector": len({type(m) for m, _ in COMMAND_VECTORS.values()}),
        "classes of commands outside": len(printed),
    }
    stated = dict(re.findall(r"^\| (.+?) \| (\d+) \|$", DOCS.read_text("utf-8"), re.MULTILINE))
    assert {k: int(v) for k, v in stated.items()} == counts
