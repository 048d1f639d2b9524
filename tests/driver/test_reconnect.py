"""A device that goes away and comes back: real terminals, and scripted radars for the rest."""

import contextlib
import itertools
import time

import numpy as np
import pytest

from tests.device_helpers import SETTINGS, Clock, in_thread, plugged, served
from tests.sim_helpers import axis_with
from x2radar import errors
from x2radar.backoff import Backoff
from x2radar.device.device import RadarStats, X2Radar
from x2radar.device.link import Deadlines
from x2radar.device.reconnect import ReconnectingRadar, StreamEvent
from x2radar.device.transport import SerialTransport, memory_pair
from x2radar.errors import DeviceError, NoPort, PortNotFound, ReadTimeout, TransportClosed
from x2radar.frame import Frame
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene

pytestmark = pytest.mark.integration
SHORT = Deadlines(reply_s=60, ready_s=60, ping_every_s=0.03, usb_gone_s=0.1, stall_s=60)
AXIS = axis_with("rf", 4, 0.004, 0.6, bandwidth_hz=0, sample_rate_hz=0)


def kinds(items):
    return [item.kind if isinstance(item, StreamEvent) else "frame" for item in items]


def take_until(items, wanted, most=500):
    """Items up to and with the first one that `wanted` says yes to."""
    taken = []
    for item in items:
        taken.append(item)
        if wanted(item):
            return taken
        assert len(taken) < most
    raise AssertionError(taken)


def is_frame(item):
    return isinstance(item, Frame)


class Socket:
    """A simulated module on a pseudo-terminal under one name, to pull and to plug in again."""

    def __init__(self, name):
        self.name = name
        self.plugged = contextlib.ExitStack()

    def plug(self):
        pty = self.plugged.enter_context(plugged())
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(pty.path)

    def pull(self):
        self.plugged.close()
        self.name.unlink(missing_ok=True)

    def radar(self, *, backoff=None, **options):
        connect = lambda: SerialTransport(str(self.name))  # noqa: E731
        inner = X2Radar(connect, SETTINGS, deadlines=SHORT, name="x2")
        return ReconnectingRadar(inner, backoff=backoff or Backoff(0.01, 0.05, "x2"), **options)


@pytest.fixture
def socket(tmp_path):
    made = Socket(tmp_path / "ttyX2")
    yield made
    made.pull()


def test_pulled_and_plugged_in_again(socket):
    socket.plug()
    with socket.radar() as radar:
        items = radar.items()
        before = [next(items) for _ in range(5)]
        socket.pull()
        lost = take_until(items, lambda item: not is_frame(item))[-1]
        assert lost.kind == "lost"
        assert "gone" in lost.reason
        socket.plug()
        *between, found, after = take_until(items, is_frame)
        assert {item.kind for item in between} <= {"lost"}
        assert (found.kind, found.reason) == ("found", "x2 sends frames again")
        assert after.restarted
        assert after.index > before[-1].index
        following = [next(items) for _ in range(3)]
        assert [f.index - after.index for f in following] == [1, 2, 3]
        assert not any(f.restarted for f in following)
        assert radar.stats.reconnects == 1
        assert radar.stream.device == "x2"


@pytest.mark.parametrize("is_plugged", [False, True], ids=["waiting", "streaming"])
def test_closing_from_another_thread_ends_it_at_once(socket, is_plugged):
    if is_plugged:
        socket.plug()
    radar = socket.radar(wait=True, backoff=Backoff(60, 60, "x2"))
    thread = in_thread(lambda: list(radar.items()))
    time.sleep(0.25)
    radar.close()
    thread.join(59)
    assert not thread.is_alive()


def test_gaps_repeats_and_reboots_are_told_before_the_frame_that_they_concern():
    plan = {"drop_frames": 0.03, "duplicate": 0.03, "reboot": 0.005}
    near, far = memory_pair()
    inner = X2Radar(lambda: near, SETTINGS, deadlines=SHORT)
    module = SimulatedModule(load_scene("empty"), 1, plan)
    with served(far, module, speed=20.0), ReconnectingRadar(inner) as radar:
        items = list(itertools.islice(radar.items(), 600))
    assert {"gap", "repeat", "restart"} <= set(kinds(items))
    index = -1
    told = {}
    for item in items:
        if isinstance(item, StreamEvent):
            told[item.kind] = item
            continue
        assert item.restarted == ("restart" in told)
        assert item.lost == (told["gap"].n_frames if "gap" in told else 0)
        # Without a restart, no frame number is left out that was not told of.
        assert item.index == index + 1 + item.lost or (item.restarted and item.index > index)
        index, told = item.index, {}


class EndOfScriptError(Exception):
    """No loss: a stream never ends by itself."""


class FakeRadar:
    """A radar of a script: for each opening an exception, or counters and at last an exception."""

    name = "fake"
    stream = None

    def __init__(self, *script):
        self.script = list(script)
        self.n_closed = 0
        self.stats = RadarStats()
        self.opened = []
        self._index = 0
        self._now = []

    def open(self, *, halt, how="open"):  # noqa: ARG002 - as X2Radar
        self.opened.append(how)
        now = self.script.pop(0)
        if isinstance(now, Exception):
            raise now
        self._now = now

    def reopen(self, *, halt):
        self.open(halt=halt, how="reopen")

    def frames(self):
        is_first = self.opened[-1] == "reopen" and self._index > 0
        for item in self._now:
            if isinstance(item, Exception):
                raise item
            yield Frame(np.zeros(4, np.float32), item, self._index, 0, is_first, AXIS)
            self._index += 1
            is_first = False
        raise EndOfScriptError

    def close(self):
        self.n_closed += 1


GONE = TransportClosed("gone")
STALL = ReadTimeout("no frame")


def scripted(*script, clock=None, **options):
    clock = clock or Clock()
    fake = FakeRadar(*script)
    return ReconnectingRadar(fake, clock=clock, sleep=clock.sleep, **options), fake, clock


def test_any_loss_is_followed_by_a_new_opening():
    safe = DeviceError("restarts again and again")
    radar, fake, _ = scripted([1, GONE], [1, 2, STALL], [1, safe], [1])
    got = list(itertools.islice(radar.items(), 11))
    again = ["frame", "lost", "found", "frame"]
    assert kinds(got) == [*again, "frame", "lost", "found", *again]
    assert [f.index for f in got if is_frame(f)] == [0, 1, 2, 3, 4]
    assert fake.opened == ["open", "reopen", "reopen", "reopen"]


def test_pauses_grow_up_to_the_cap():
    failures = [PortNotFound("nothing there")] * 12
    radar, fake, clock = scripted([1, GONE], *failures, [1])
    items = take_until(radar.items(), lambda item: is_frame(item) and item.restarted)
    # The same reason is told once.
    assert kinds(items) == ["frame", "lost", "lost", "found", "frame"]
    plain = [min(0.25 * 2**k, 2.0) for k in range(13)]
    assert len(clock.slept_s) == 13
    ratios = [s / p for p, s in zip(plain, clock.slept_s, strict=True)]
    assert ratios == pytest.approx([ratios[0]] * 13)
    assert 2 / 3 < ratios[0] <= 1
    assert fake.n_closed >= 13


def test_a_device_that_is_lost_soon_again_is_left_alone_longer():
    clock = Clock()
    radar, _, _ = scripted([1, GONE], [1, GONE], [1, GONE], [1, 2, GONE], [1], clock=clock)
    for item in itertools.islice(radar.items(), 14):
        if is_frame(item) and item.counter == 2:
            clock.now_s += 11
    first = clock.slept_s[0]
    assert clock.slept_s == [first, 2 * first, 4 * first, first]


def test_at_start_errors_are_raised_or_waited_for_but_what_is_no_port_never():
    lost = PortNotFound("no"), errors.PortDenied("no"), GONE, DeviceError("no")
    for error in (*lost, NoPort("f")):
        is_port = not isinstance(error, NoPort)
        radar, fake, _ = scripted(error, wait=not is_port)
        with pytest.raises(type(error)):
            next(radar.items())
        assert fake.n_closed == 1
        radar, _, _ = scripted(error, [7], wait=True)
        if is_port:
            assert kinds(take_until(radar.items(), is_frame)) == ["lost", "found", "frame"]


def test_what_ends_the_stream():
    clock = Clock()
    clock.sleep = lambda _s: radar.close()
    radar, fake, _ = scripted([1, GONE], clock=clock)
    assert kinds(radar.items()) == ["frame", "lost"]
    assert fake.opened == ["open"]
    # With quit a loss is raised, and faults of the program always are.
    for loss, options in ((GONE, {"quit_on_loss": True}), (ZeroDivisionError(), {"wait": True})):
        radar, fake, _ = scripted([1, loss], **options)
        with pytest.raises(type(loss)):
            list(radar.items())
        assert fake.n_closed == 1
