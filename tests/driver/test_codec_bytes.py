"""The bytes of every message beyond the everyday ones, written out by hand."""

import numpy as np
import pytest

from tests.codec_helpers import same
from x2radar.wire import messages as core
from x2radar.wire import messages_expert as expert
from x2radar.wire import messages_status as status
from x2radar.wire import messages_x4 as x4
from x2radar.wire.codec import decode_any, decode_command, decode_response, encode
from x2radar.wire.messages import Message
from x2radar.wire.wire_ids import BootloaderKey, NoiseMapControl, X4Setting


def floats(*values: float) -> np.ndarray:
    return np.array(values, np.float32)


def octets(*values: int) -> np.ndarray:
    return np.array(values, np.uint8)


ONE, TWO, HALF = "00 00 80 3f", "00 00 00 40", "00 00 00 3f"
COMMANDS = [
    (expert.StartBootloader(BootloaderKey.OLD), "02 f0 5e b9 a2"),
    (expert.StartBootloader(BootloaderKey.NEW), "02 f1 6e b9 a2"),
    (expert.SetSubmode(0x10, 2), "20 10 02"),
    (expert.SetCom(b"\x05"), "23 05"),
    (expert.SetNoiseMapControl(NoiseMapControl.ADAPTIVE), "25 10 02 00 00 00"),
    (expert.GetNoiseMapControl(), "25 11"),
    (expert.SetPin(1, 2, 3), "40 10 01 00 00 00 02 00 00 00 03 00 00 00"),
    (expert.WritePin(1, 2), "40 20 01 00 00 00 02 00 00 00"),
    (expert.ReadPin(1), "40 21 01 00 00 00"),
    (expert.SetOutputControl(0x0C, 1), "41 10 0c 00 00 00 01 00 00 00"),
    (expert.SetDebugOutput(b"\x01\x02"), "42 01 02"),
    (expert.SetDebugLevel(3), "b0 03"),
    (expert.BootloaderCommand(0x10, b"\x01\x02\x00\xff"), "c0 10 01 02 00 ff"),
    (expert.BootloaderCommand(0, b""), "c0 00"),
    (expert.SetAppItem(0x01020304, b"\x09"), "10 10 04 03 02 01 09"),
    (expert.GetDetectionZone(), "10 11 1c 0a a1 96"),
    (expert.GetDetectionZoneLimits(), "10 11 1d 0a a1 96"),
    (expert.GetSensitivity(), "10 11 2b 11 a5 10"),
    (expert.GetAppItem(0x01020304), "10 11 04 03 02 01"),
    (expert.FactoryPreset(), "10 12"),
    (expert.StoreNoiseMap(), "10 13"),
    (expert.LoadNoiseMap(), "10 14"),
    (expert.DeleteNoiseMap(), "10 16"),
    (expert.RadlibExecute(b"\x07"), "90 10 07"),
    (expert.SetVarInt(5, 6), "90 11 05 00 00 00 06 00 00 00"),
    (expert.GetVarInt(5), "90 12 05 00 00 00"),
    (expert.SetVarFloat(5, 2.0), f"90 13 05 00 00 00 {TWO}"),
    (expert.GetVarFloat(5), "90 14 05 00 00 00"),
    (expert.SetRegisterField(5, 6), "90 15 05 00 00 00 06 00 00 00"),
    (expert.GetRegisterField(5), "90 16 05 00 00 00"),
    (expert.GetFrameFloat(), "90 17"),
    (expert.GetFrameRaw(), "90 18"),
    (expert.GetChipId(), "90 19"),
    (expert.TimingMeasurement(), "90 20"),
    (expert.ResetRadarHardware(), "90 30"),
    (expert.SetRadarClock(b""), "90 31"),
    (expert.FramesToFlash(b"\x01"), "90 40 01"),
    (expert.SystemTest(0x11), "90 50 11"),
    (expert.GetVersionOld(), "90 55"),
    (expert.GetBuildOld(), "90 56"),
    (expert.GetProductOld(), "90 57"),
    (expert.SystemCommand(0x60, b"\x01\x02"), "90 60 01 02"),
    (expert.SetAppFloats(7, floats(1, 2)), f"90 70 07 00 00 00 02 00 00 00 {ONE} {TWO}"),
    (expert.SetOutputUncounted(0x10, 1), "90 71 10 00 00 00 01 00 00 00"),
    (expert.GetProfileId(), "90 74"),
    (x4.X4Init(), "50 20"),
    (x4.X4SetFrameRate(2.0), f"50 10 10 00 00 00 {TWO}"),
    (x4.X4SetPulsesPerStep(20), "50 10 11 00 00 00 14 00 00 00"),
    (x4.X4SetIterations(64), "50 10 12 00 00 00 40 00 00 00"),
    (x4.X4SetDownConversion(1), "50 10 13 00 00 00 01"),
    (x4.X4SetFrameArea(0.5, 2.0), f"50 10 14 00 00 00 {HALF} {TWO}"),
    (x4.X4SetDacStep(1), "50 10 15 00 00 00 01"),
    (x4.X4SetDacMin(949), "50 10 16 00 00 00 b5 03 00 00"),
    (x4.X4SetDacMax(1100), "50 10 17 00 00 00 4c 04 00 00"),
    (x4.X4SetFrameAreaOffset(0.5), f"50 10 18 00 00 00 {HALF}"),
    (x4.X4Enable(1), "50 10 19 00 00 00 01"),
    (x4.X4SetCentreFrequency(3), "50 10 20 00 00 00 03"),
    (x4.X4SetPower(2), "50 10 21 00 00 00 02"),
    (x4.X4SetPrfDivider(16), "50 10 25 00 00 00 10"),
    (x4.X4Set(X4Setting.PIF_REGISTER, b"\x01\x02"), "50 10 23 00 00 00 01 02"),
    (x4.X4Get(X4Setting.FPS), "50 11 10 00 00 00"),
    (x4.X4WriteSpi(0x21, 0x55), "50 12 22 00 00 00 21 55"),
    (x4.X4Write(X4Setting.XIF_REGISTER, b"\x01"), "50 12 24 00 00 00 01"),
    (x4.X4ReadSpi(0x21, 2), "50 13 22 00 00 00 21 02 00 00 00"),
    (x4.X4Read(X4Setting.PIF_REGISTER, b"\x01"), "50 13 23 00 00 00 01"),
]
DOPPLER = "01 00 00 00 02 00 00 00 03 00 00 00 04 00 00 00 02 00 00 00 05 00 00 00"
RESPONSES = [
    (expert.HilReply(b"\x01"), "12 01"),
    (expert.BootloaderReply(b""), "e0"),
    (core.UserReply(1, 2, b"\x03"), "11 50 01 00 00 00 02 00 00 00 03"),
    (core.UserData(1, 2, b"\x03"), "a0 50 01 00 00 00 02 00 00 00 03"),
    (core.DataText(0, 2, "AB"), "a0 13 00 00 00 00 02 00 00 00 02 00 00 00 41 42"),
    (core.ByteReply(1, 2, (7, 255)), "11 10 01 00 00 00 02 00 00 00 02 00 00 00 07 ff 01"),
    (status.RespirationStatusExt(b"\x01\x02"), "50 6b a1 75 23 01 02"),
    (
        status.PresenceStatusShort(1, 2.0, 0.5, 4),
        f"50 be 52 1a 99 01 {TWO} {HALF} 04 00 00 00",
    ),
    (
        status.PresenceSingle(1, 2, 0.5, 2, 9),
        f"50 1e fa 3b 72 01 00 00 00 02 00 00 00 {HALF} 02 09 00 00 00",
    ),
    (
        status.PresenceMovingList(
            1, 2, floats(1), floats(2), *[floats(1, k) for k in (0.5, 1, 2)]
        ),
        "50 1f fa 3b 72 01 00 00 00 02 00 00 00 01 00 00 00 02 00 00 00"
        f"{ONE} {TWO} {ONE} {HALF} {ONE} {ONE} {ONE} {TWO}",
    ),
    (
        status.RespirationMovingList(1, floats(1, 2), floats(0.5, 1)),
        f"50 00 3b 0a 61 01 00 00 00 02 00 00 00 {ONE} {TWO} {HALF} {ONE}",
    ),
    (
        status.RespirationDetectionList(1, floats(1), floats(2), floats(0.5)),
        f"50 02 3b 0a 61 01 00 00 00 01 00 00 00 {ONE} {TWO} {HALF}",
    ),
    (
        status.NormalisedMovementList(1, 0.5, 2.0, floats(1), floats(2)),
        f"50 cf 31 a3 c3 01 00 00 00 {HALF} {TWO} 01 00 00 00 {ONE} {TWO}",
    ),
    (
        status.VitalSigns(1, 7, *[1.0, 2.0, 0.5] * 3, 1.0),
        f"50 02 01 02 20 01 00 00 00 07 00 00 00 {' '.join([ONE, TWO, HALF] * 3)} {ONE}",
    ),
    (status.SleepStage(1, 2), "50 02 3a 08 41 01 00 00 00 02 00 00 00"),
    (
        status.PulseDoppler(1, 2, 3, 4, 5, 1.0, 2.0, 0.5, 1.0, 2.0, floats(0.5, 2)),
        f"50 10 00 00 00 {DOPPLER} {ONE} {TWO} {HALF} {ONE} {TWO} {HALF} {TWO}",
    ),
    (
        status.NoiseMap(1, 2, 3, 4, 5, 1.0, 2.0, 0.5, 1.0, 2.0, floats(0.5, 2)),
        f"50 12 00 00 00 {DOPPLER} {ONE} {TWO} {HALF} {ONE} {TWO} {HALF} {TWO}",
    ),
    (
        status.PulseDopplerBytes(1, 2, 3, 4, 5, 2.0, 0.5, 1.0, 2.0, 0.5, 1.0, 2.0, octets(8, 9)),
        f"50 11 00 00 00 {DOPPLER} {TWO} {HALF} {ONE} {TWO} {HALF} {ONE} {TWO} 08 09",
    ),
    (
        status.NoiseMapBytes(1, 2, 3, 4, 5, 2.0, 0.5, 1.0, 2.0, 0.5, 1.0, 2.0, octets(8, 9)),
        f"50 13 00 00 00 {DOPPLER} {TWO} {HALF} {ONE} {TWO} {HALF} {ONE} {TWO} 08 09",
    ),
    (
        status.ParameterFile(octets(65), octets(1, 2)),
        "50 23 76 ba 32 01 00 00 00 02 00 00 00 41 01 02",
    ),
    (status.DecimStatus(b"\x01"), "50 aa 45 76 32 01"),
    (status.AppData(0x01020304, b"\x05"), "50 04 03 02 01 05"),
]


def name_of(value: object) -> str | None:
    return type(value).__name__ if isinstance(value, Message) else None


@pytest.mark.parametrize(("message", "wire"), COMMANDS, ids=name_of)
def test_commands(message: Message, wire: str) -> None:
    data = bytes.fromhex(wire)
    assert encode(message) == data
    assert same(decode_command(data), message)
    assert same(decode_any(data), message)


@pytest.mark.parametrize(("message", "wire"), RESPONSES, ids=name_of)
def test_responses(message: Message, wire: str) -> None:
    data = bytes.fromhex(wire)
    assert encode(message) == data
    assert same(decode_response(data), message)
    assert same(decode_any(data), message)


def test_hil_is_a_command_only_to_those_who_know_the_direction() -> None:
    assert decode_command(b"\xa0\x01") == expert.HilCommand(b"\x01")
    assert encode(expert.HilCommand(b"\x01")) == b"\xa0\x01"


def test_every_class_of_the_other_modules_is_written_out() -> None:
    seen = {type(message) for message, _ in COMMANDS + RESPONSES}
    everyday = {status.RespirationStatus, status.SleepStatus, status.PresenceStatus}
    elsewhere = {expert.SetAppInts, expert.HilCommand, status.DopplerRow, status.DopplerRowBytes}
    for module in (expert, status, x4):
        classes = {c for c in vars(module).values() if isinstance(c, type)}
        own = {c for c in classes if c.__module__ == module.__name__}
        assert own - seen - everyday - elsewhere == set()


def test_presence_in_either_width_is_a_presence_status() -> None:
    short = decode_response(bytes.fromhex(f"50 be 52 1a 99 01 {TWO} {HALF} 04 00 00 00"))
    assert isinstance(short, status.PresenceStatus)
    assert (short.presence, short.signal_quality) == (1, 4)
