"""Each fault does what it says, and the driver survives a module that misbehaves."""

import contextlib
import functools
import itertools

import numpy as np
import pytest

from tests.device_helpers import faulty
from tests.sim_helpers import EMPTY, HUMAN, MANUAL
from x2radar.device.link import Deadlines
from x2radar.errors import MessageError, SettingsError
from x2radar.modules.x2 import RadarSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.sim.module.faults import KINDS, parse_faults
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.wire_ids import SysCfg


def made(faults, seed=0, scene=HUMAN):
    return SimulatedModule(scene, seed, parse_faults(faults) if faults else None)


def say(module, *commands):
    for command in commands:
        module.receive(framing.encode(encode(command)))


def pieces(module):
    return list(iter(module.data_to_send, b""))


def run(module, until_s, step_s=None):
    """Let time pass; return what comes out and when, a list of (time, piece)."""
    out = [(module._now_s, piece) for piece in pieces(module)]
    now_s = module._now_s
    while now_s < until_s:
        now_s = min(module.next_due_s if step_s is None else now_s + step_s, until_s)
        module.advance(now_s)
        out += [(now_s, piece) for piece in pieces(module)]
    return out


@functools.cache
def stream(faults, seconds=10.005, seed=0, step_s=None, scene=HUMAN):
    """Everything a module sends that streams from the start, and when."""
    module = made(faults, seed, scene)
    say(module, MANUAL)
    return run(module, seconds, step_s)


def joined(parts):
    return b"".join(piece for _, piece in parts)


def decoded(parts):
    decoder = PacketDecoder()
    for t_s, piece in parts:
        for item in decoder.feed(piece):
            yield t_s, item


def messages(parts, kind=msg.Data):
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
    echo = EchoStream(HUMAN, 0, RadarSettings())
    return [echo.next() for _ in range(610)]


def test_without_faults_nothing_is_wrong(truth):
    parts = stream("")
    assert counters(parts) == list(range(1, 602))
    assert all(isinstance(item, Packet) for _, item in decoded(parts))
    for _, m in messages(parts):
        assert np.array_equal(m.values, truth[m.info - 1])


ALL = [
    *("drop_bytes:1e-4", "flip_bits:1e-4", "junk:0.2", "split:900", "merge:0.3", "stall:2"),
    *("bursts:1", "silent:3.33", "hang_up:3.33", "drop_frames:0.2", "duplicate:0.2", "spike:0.1"),
    *("clip:0.02", "counter_restart:0.02", "reboot:0.02", "slow_ack:0.5", "error_reply:0.3"),
    *("not_ready:2", "safe_mode:1"),
    "drop_bytes:1e-5,junk:0.1,split:500,merge:0.3,drop_frames:0.1,duplicate:0.1,reboot:0.01",
]


@pytest.mark.parametrize("faults", ALL)
def test_same_input_same_bytes_whatever_the_steps(faults):
    seconds = 12.3 if "stall" in faults else 4.1
    once = joined(stream(faults, seconds, scene=EMPTY))
    assert joined(stream(faults, seconds, step_s=0.03, scene=EMPTY)) == once
    assert joined(stream(faults, seconds, step_s=1.7, scene=EMPTY)) == once
    other = joined(stream(faults, seconds, seed=1, scene=EMPTY))
    assert other != once or faults in {"safe_mode:1", "error_reply:0.3"}


def test_one_fault_does_not_touch_anothers_draws():
    alone = set(counters(stream("drop_frames:0.2")))
    assert set(counters(stream("spike:0.3,drop_frames:0.2,duplicate:0.4,split:2000"))) == alone
    twice = counters(stream("duplicate:0.3"))
    doubled = {k for k in twice if twice.count(k) == 2}
    both = counters(stream("duplicate:0.3,drop_frames:0.2"))
    assert {k for k in both if both.count(k) == 2} == doubled & alone


def test_split_merge_stall_and_bursts_change_only_when():
    clean = joined(stream("", 14.0, scene=EMPTY))
    split = stream("split:700", 14.0, scene=EMPTY)
    assert joined(split) == clean
    assert max(len(piece) for _, piece in split) == 700
    assert min(len(piece) for _, piece in split) < 20
    lumps = stream("merge:0.5", 14.0, scene=EMPTY)
    assert clean.startswith(joined(lumps))
    assert {round(t, 6) for t, m in messages(lumps)} <= {round(0.5 * k, 6) for k in range(30)}
    stalled = [t for t, _ in messages(stream("stall:2", 14.0, scene=EMPTY))]
    assert not any(10.0 <= t < 12.0 for t in stalled)
    assert max(np.diff(stalled)) == pytest.approx(2.0, abs=0.05)
    both = [t for t, _ in messages(stream("stall:2,merge:5", 14.0, scene=EMPTY))]
    assert sorted({round(t, 6) for t in both}) == [0.0, 5.0, 12.0]


@pytest.mark.parametrize("rate_hz", [20, 60])
def test_bursts_are_those_of_the_real_module(rate_hz):
    module = made("bursts:1")
    say(module, msg.SetSysInt(SysCfg.FPS, rate_hz), MANUAL)
    burst = messages(run(module, 6.0))
    assert [m.info for _, m in burst] == list(range(1, len(burst) + 1))
    late_ms = {}
    for t_s, m in burst:
        late_ms.setdefault(m.info % 20, []).append((t_s * rate_hz - (m.info - 1)) * 50)
    for phase, want_ms in {0: 190, 1: 145, 2: 100, 3: 55, 10: 50}.items():
        # The very first frame has nothing before it that was late.
        assert late_ms[phase][1:] == pytest.approx([want_ms] * len(late_ms[phase][1:]), abs=1e-3)
    assert max(late_ms[15]) == pytest.approx(0, abs=1e-3)


def test_spike_clip_and_counter_restart(truth):
    frames = [m.values for _, m in messages(stream("spike:0.1"))]
    hit = [(f, t) for f, t in zip(frames, truth, strict=False) if f.max() > 500]
    assert len(hit) == pytest.approx(60, abs=25)
    assert all(0 < (f != t).sum() <= 3 for f, t in hit)
    for f, t in zip([m.values for _, m in messages(stream("clip:0.02"))], truth, strict=False):
        assert np.allclose(f, np.clip(t, 49, 51), atol=1e-4)
    # A restart changes the number only.
    got = messages(stream("counter_restart:0.02"))
    assert len(got) == 601
    for (_, m), frame in zip(got, truth, strict=False):
        assert np.array_equal(m.values, frame)
    steps = np.diff([m.info for _, m in got])
    assert (steps != 1).sum() == pytest.approx(12, abs=10)
    assert all(m.info == 1 for (_, m), step in zip(got[1:], steps, strict=True) if step != 1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "fault '': unknown"),
        ("smoke:1", "fault 'smoke': unknown"),
        ("junk", r"has no value; write junk:VALUE \(per packet\)"),
        ("junk:x", "'x' is no value from 0 to 1"),
        ("junk:2", r"is no value from 0 to 1 \(per packet\)"),
        ("junk:nan", "no value"),
        ("junk:0.1,junk:0.2", "given twice"),
        ("split:0", r"whole number from 1 to 65536 \(bytes\)"),
        ("bursts:0", "from 1 to 1"),
    ],
)
def test_plans_that_make_no_sense(text, words):
    with pytest.raises(SettingsError, match=words) as caught:
        parse_faults(text)
    assert all(kind in str(caught.value) for kind in KINDS)
    assert "\n" not in str(caught.value)


SCENE = load_scene("human")
QUICK = Deadlines(reply_s=0.5, ready_s=3, ping_every_s=0.05, stall_s=0.5)


@pytest.fixture(scope="module")
def told():
    """The scene's frames by counter from 1; the driver tells the delay as a float32."""
    stream = EchoStream(SCENE, 0, RadarSettings(sample_delay_s=float(np.float32(4e-9))))
    return [stream.next() for _ in range(1500)]


def frames(faults, n):
    """The first frames that the driver hands out of a module with faults."""
    with make_radar(parse_port(f"sim:human?fault={faults}"), speed=None) as radar:
        return list(itertools.islice(radar.frames(), n))


def is_made(frame, told):
    return 0 < frame.counter <= len(told) and np.array_equal(
        frame.samples, told[frame.counter - 1]
    )


def assert_counted(got):
    """Every frame says what is missing before it, as its counter has it."""
    for before, frame in itertools.pairwise(got):
        if frame.restarted:
            assert frame.counter <= before.counter
            assert (frame.lost, frame.index) == (0, before.index + 1)
        else:
            assert frame.lost == frame.counter - before.counter - 1
            assert frame.index == before.index + frame.lost + 1


@pytest.mark.parametrize(
    "faults",
    [
        *("drop_bytes:1e-4", "junk:0.1", "split:7", "merge:0.2", "slow_ack:0.1"),
        "drop_bytes:1e-5,junk:0.05,drop_frames:0.1,duplicate:0.1,split:900,bursts:1",
    ],
)
def test_true_frames_only_and_what_is_missing_is_said(faults, told):
    got = frames(faults, 60 if faults == "split:7" else 400)
    assert got[0].index == 0
    assert not any(frame.restarted for frame in got)
    assert_counted(got)
    assert all(is_made(frame, told) for frame in got)
    assert (got[-1].index > len(got) - 1) == faults.startswith("drop") or faults == "junk:0.1"


def test_flipped_bits_pass_only_where_the_checksum_is_blind(told):
    got = frames("flip_bits:1e-4", 500)
    assert_counted(got)
    assert any(frame.lost for frame in got)
    wrong = [frame for frame in got if not is_made(frame, told)]
    # Two flips of the same bit cancel in a XOR of bytes: 0.4 % of packets at this rate.
    assert len(wrong) <= 0.012 * len(got)
    for frame in wrong:
        assert (frame.samples != told[frame.counter - 1]).sum() <= 2
    # A module that reboots is heard again.
    got = frames("reboot:0.01", 400)
    assert_counted(got)
    assert 1 <= sum(frame.restarted for frame in got) <= 12
    assert all(is_made(frame, told) for frame in got)


SLOW = [("slow_ack:0.1", None), ("slow_ack:0.03", 1.0), ("not_ready:0.3", 1.0)]


@pytest.mark.parametrize(("faults", "speed"), [*SLOW, ("not_ready:100", None)])
def test_it_opens_all_the_same(faults, speed):
    with faulty(faults, speed, deadlines=QUICK) as radar:
        assert next(radar.frames()).index == 0
