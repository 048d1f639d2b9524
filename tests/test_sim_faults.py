"""Each fault does what it says, and the driver survives it."""

import contextlib
import itertools

import numpy as np
import pytest

from x2radar import framing
from x2radar.codec import decode_response, encode
from x2radar.device import Deadlines, X2Radar
from x2radar.errors import (
    DeviceError,
    MessageError,
    ReadTimeout,
    SafeModeError,
    SettingsError,
    TransportClosed,
)
from x2radar.framing import LineFault, Packet, PacketDecoder
from x2radar.messages import Ack, Data, ErrorReply, Ping, Pong, SetLed, SetMode, SystemMessage
from x2radar.ports import make_radar, parse_port
from x2radar.settings import RadarSettings
from x2radar.sim.faults import KINDS, FaultPlan, describe_faults, parse_faults
from x2radar.sim.host import connect
from x2radar.sim.module import EchoStream, SimulatedModule
from x2radar.sim.scene import load_scene
from x2radar.wire_ids import Mode, PongCode

SCENE = load_scene("human")
QUICK = Deadlines(reply_s=0.5, ready_s=3, ping_every_s=0.05, stall_s=0.5)


def say(module, command):
    module.receive(framing.encode(encode(command)))


def pieces(module):
    return list(iter(module.data_to_send, b""))


def stream_bytes(faults, seconds=10.005, seed=0, step_s=None):
    """Everything a streaming module sends, and when: a list of (time, piece)."""
    module = SimulatedModule(SCENE, seed, parse_faults(faults) if faults else None)
    say(module, SetMode(Mode.MANUAL))
    out = [(0.0, piece) for piece in pieces(module)]
    now_s = 0.0
    while now_s < seconds:
        now_s = module.next_due_s if step_s is None else now_s + step_s
        module.advance(min(now_s, seconds))
        out += [(min(now_s, seconds), piece) for piece in pieces(module)]
    return out


def decoded(parts):
    decoder = PacketDecoder()
    for t_s, piece in parts:
        for item in decoder.feed(piece):
            yield t_s, item


def messages(parts, kind=Data):
    out = []
    for t_s, item in decoded(parts):
        if isinstance(item, Packet):
            with contextlib.suppress(MessageError):  # damage that the checksum did not see
                message = decode_response(item.data)
                if isinstance(message, kind):
                    out.append((t_s, message))
    return out


def counters(parts):
    return [m.info for _, m in messages(parts)]


@pytest.fixture(scope="module")
def truth():
    """What the scene's frames are, by counter from 1."""
    return made_frames(RadarSettings())


@pytest.fixture(scope="module")
def told():
    """The same for a module that the driver configured: its delay came as a float32."""
    return made_frames(RadarSettings(sample_delay_s=float(np.float32(4e-9))))


def made_frames(settings):
    stream = EchoStream(SCENE, 0, settings)
    return [stream.next() for _ in range(700)]


def test_without_faults_nothing_is_wrong(truth):
    parts = stream_bytes("")
    assert counters(parts) == list(range(1, 602))
    assert all(isinstance(item, Packet) for _, item in decoded(parts))


@pytest.mark.parametrize(
    "faults", ["drop_bytes:1e-4", "flip_bits:1e-4", "junk:0.2", "spike:0.1", "drop_frames:0.2"]
)
def test_same_seed_same_bytes_whatever_the_steps(faults):
    def whole(**kwargs):
        return b"".join(piece for _, piece in stream_bytes(faults, 3.0, **kwargs))

    assert whole() == whole() == whole(step_s=0.1)
    assert whole() != whole(seed=1)


@pytest.mark.parametrize(("kind", "share"), [("drop_bytes", 1e-4), ("flip_bits", 1e-4)])
def test_damaged_bytes_cost_their_packets_only(kind, share, truth):
    clean, bad = stream_bytes(""), stream_bytes(f"{kind}:{share}")
    n_clean = sum(len(piece) for _, piece in clean)
    got = messages(bad)
    expected = 601 * (1 - share) ** (n_clean / 601)
    assert len(got) == pytest.approx(expected, abs=45)
    assert any(isinstance(item, LineFault) for _, item in decoded(bad))
    sound = sum(np.array_equal(m.values, truth[m.info - 1]) for _, m in got if m.info <= 601)
    # A checksum of eight bits lets one damaged packet in 256 through; that is the wire's.
    assert sound >= len(got) - 5


def test_junk_costs_at_most_the_packet_behind_it():
    parts = stream_bytes("junk:0.3")
    assert len(counters(parts)) > 601 - 0.3 * 601 * 0.3
    junk = [item for _, item in decoded(parts) if isinstance(item, LineFault)]
    assert len(junk) == pytest.approx(0.3 * 601, rel=0.3)


def test_dropped_and_doubled_frames():
    kept = counters(stream_bytes("drop_frames:0.2"))
    assert len(kept) == pytest.approx(0.8 * 601, rel=0.1)
    assert kept == sorted(set(kept))
    twice = counters(stream_bytes("duplicate:0.2"))
    assert len(twice) == pytest.approx(1.2 * 601, rel=0.1)
    assert sorted(set(twice)) == list(range(1, 602))


def test_counter_restart_and_reboot():
    jumps = np.diff(counters(stream_bytes("counter_restart:0.01")))
    assert (jumps < 0).sum() == pytest.approx(6, abs=5)
    parts = stream_bytes("reboot:0.01")
    assert (np.diff(counters(parts)) < 0).sum() == pytest.approx(6, abs=5)
    assert len(messages(parts, SystemMessage)) >= 2 * (np.diff(counters(parts)) < 0).sum()


def test_spike_and_clip(truth):
    peaks = [m.values.max() for _, m in messages(stream_bytes("spike:0.1"))]
    assert np.mean(np.array(peaks) > 500) == pytest.approx(0.1, abs=0.04)
    flat = [m.values for _, m in messages(stream_bytes("clip:0.02"))]
    assert np.max(flat) <= 51.0 + 1e-4
    assert np.min(flat) >= 49.0 - 1e-4


def test_split_merge_stall_and_bursts_change_only_when():
    clean = b"".join(piece for _, piece in stream_bytes("", 14.0))
    split = stream_bytes("split:7", 14.0)
    assert b"".join(piece for _, piece in split) == clean
    assert max(len(piece) for _, piece in split) == 7
    lumps = stream_bytes("merge:0.5", 14.0)
    times = {round(t, 6) for t, m in messages(lumps)}
    assert times <= {round(0.5 * k, 6) for k in range(30)}
    stalled = [t for t, _ in messages(stream_bytes("stall:2", 14.0))]
    assert not any(10.0 <= t < 12.0 for t in stalled)
    assert max(np.diff(stalled)) == pytest.approx(2.0, abs=0.05)
    burst = messages(stream_bytes("bursts:1", 5.0))
    late = [t - (m.info - 1) / 60 for t, m in burst if m.info % 20 == 0]
    assert late == pytest.approx([3.8 / 60] * len(late), abs=1e-6)
    assert [m.info for _, m in burst] == list(range(1, len(burst) + 1))


def answers(faults, *commands, seconds=5.0):
    module = SimulatedModule(SCENE, 0, parse_faults(faults))
    for command in commands:
        say(module, command)
    out = [(0.0, p) for p in pieces(module)]
    while module.next_due_s < seconds:
        now_s = module.next_due_s
        module.advance(now_s)
        out += [(now_s, p) for p in pieces(module)]
    return [(t, decode_response(i.data)) for t, i in decoded(out)]


def test_answers_of_a_module_in_trouble():
    assert answers("slow_ack:0.3", SetLed(1)) == [(0.3, Ack())]
    replies = [m for _, m in answers("error_reply:0.5", *[SetLed(1)] * 200)]
    assert sum(isinstance(m, ErrorReply) for m in replies) == pytest.approx(100, abs=30)
    assert answers("safe_mode:1", Ping())[0][1] == Pong(PongCode.SAFE_MODE)
    assert isinstance(answers("safe_mode:1", SetLed(1))[0][1], ErrorReply)
    assert answers("not_ready:2", Ping())[0][1] == Pong(PongCode.NOT_READY)


def frames(faults, n, seed=0):
    """The first frames that the driver hands out of a module with faults."""
    radar = make_radar(parse_port(f"sim:human?seed={seed}&fault={faults}"), speed=None)
    with radar:
        return list(itertools.islice(radar.frames(), n))


@pytest.mark.parametrize(
    "faults",
    [
        "junk:0.1",
        "split:7",
        "duplicate:0.1",
        "drop_frames:0.1",
        "bursts:1",
        "merge:0.2",
        "junk:0.05,drop_frames:0.1,duplicate:0.1,split:900",
    ],
)
def test_the_driver_hands_out_true_frames_and_says_what_is_missing(faults, told):
    got = frames(faults, 400)
    first = got[0].counter
    for before, frame in itertools.pairwise(got):
        assert frame.index == frame.counter - first
        assert frame.lost == frame.counter - before.counter - 1
        assert not frame.restarted
    for frame in got:
        assert np.array_equal(frame.samples, told[frame.counter - 1])


@pytest.mark.parametrize("faults", ["drop_bytes:2e-5", "flip_bits:2e-5"])
def test_the_driver_goes_on_after_damage(faults, told):
    got = frames(faults, 300)
    true = sum(
        0 < f.counter <= len(told) and np.array_equal(f.samples, told[f.counter - 1]) for f in got
    )
    assert true >= len(got) - 4
    assert any(f.lost for f in got)


def test_the_driver_states_restarts():
    got = frames("counter_restart:0.02", 300)
    assert any(f.restarted for f in got)
    assert [f.index for f in got] == sorted({f.index for f in got})


def opened(faults, speed=None):
    plan = parse_faults(faults)
    return X2Radar(
        lambda: connect(lambda: SimulatedModule(SCENE, 0, plan), speed), deadlines=QUICK
    )


def test_start_up_with_slow_answers_and_without_ready():
    for faults, speed in (("slow_ack:0.1", None), ("not_ready:0.3", 1.0)):
        with opened(faults, speed) as radar:
            assert next(radar.frames()).index == 0


def test_what_cannot_be_opened_or_ends():
    with pytest.raises(SafeModeError):
        opened("safe_mode:1").open()
    with pytest.raises(DeviceError):
        opened("error_reply:1").open()
    with opened("hang_up:2") as radar, pytest.raises(TransportClosed):
        for _ in radar.frames():
            pass
    with opened("silent:2") as radar, pytest.raises(ReadTimeout):
        for _ in radar.frames():
            pass


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "known are drop_bytes"),
        ("smoke:1", "fault 'smoke'"),
        ("junk", "no value from 0 to 1"),
        ("junk:x", "no value"),
        ("junk:2", "per packet"),
        ("junk:nan", "no value"),
        ("junk:0.1,junk:0.2", "given twice"),
        ("split:0", "bytes"),
    ],
)
def test_plans_that_make_no_sense(text, words):
    with pytest.raises(SettingsError, match=words):
        parse_faults(text)


def test_plan_and_table():
    plan = parse_faults("junk:0.1, split:7")
    assert plan == FaultPlan({"junk": 0.1, "split": 7.0})
    assert plan.value("stall") == 0
    assert all(kind in describe_faults() for kind in KINDS)
