"""Commands while a tamper event is on, and zones that no range of the swath is in."""

from dataclasses import replace

import numpy as np
import pytest

from radard.alarm.sensor_state import StateStore
from radard.alarm.zones import zone_fault, zone_warnings
from radard.config.config import load_config
from radard.config.sections import ZonesSection
from radard.health.health import Health
from radard.log import EventLog
from radard.pipeline import Pipeline
from radard.run.components import make_parts
from radard.run.worker import Worker
from radard.stream.ring import Notice
from tests.radar_helpers import BASEBAND, dwell_of, events, noise, run_radard
from x2radar.frame import StreamInfo

STREAM = StreamInfo(axis=BASEBAND, frame_rate_hz=60.0, device="test")


class Room:
    """A worker without threads, before a room whose echoes a test covers."""

    def __init__(self, *, port="replay:x", gate=None, state=None, health=None, **alarm):
        options = {"sensor": {"port": port}, "alarm": {"armed": False, **alarm}}
        options |= {"model": {"name": "none"}, "service": {"state_dir": state}}
        options["gate"] = gate or {"calibration": "none"}
        config = load_config(environ={}, options=options)
        self.config, self.pipeline = config, Pipeline(STREAM, config)
        parts = make_parts(config, self.pipeline, now=lambda _t_s: None, is_live=False)
        self.records = []
        store = StateStore(EventLog(None), None)
        self.worker = Worker(parts, self._put, health or Health(), store)
        self.echoes = (30 * np.random.default_rng(2).standard_normal((2, 64))).T @ [1, 1j]
        self.t_s = 0.0

    def _put(self, record, **_options):
        self.records.append(record)

    def events(self, kind):
        return events(self.records, kind)

    def listen(self, seconds, gain=1.0):
        for _ in range(seconds):
            self.t_s += 1.0
            frames = noise(147, seed=int(self.t_s)) + gain * self.echoes
            dwell = dwell_of(frames.astype(np.complex64))
            self.worker.handle(replace(dwell, t_s=self.t_s, end_frame=round(60 * self.t_s)))

    def command(self, name):
        self.worker.command(name)
        self.work()

    def work(self):
        self.worker.handle(replace(self.worker.ring.next_item(0), t_s=self.t_s))

    def reload(self, section, **changes):
        """Take up a section of the configuration, changed, as a reload does."""
        changed = getattr(self.config, section).model_copy(update=changes)
        config, old = self.config.model_copy(update={section: changed}), self.worker.parts
        given = {"now": lambda _t_s: None, "is_live": False, "old": old}
        self.worker.exchange(make_parts(config, self.pipeline, **given))
        self.work()

    def cover(self):
        self.listen(30)
        self.listen(25, gain=0.1)
        assert "tamper" in self.worker.tracker.open_events


def test_arming_does_not_end_a_tamper_that_lasts_and_says_so():
    room = Room()
    room.cover()
    for name in ("ack", "arm", "disarm", "arm"):
        room.command(name)
        room.listen(30, gain=0.1)
    assert room.worker.tracker.panel.is_armed
    made = room.events("tamper")
    assert [e["phase"] for e in made if e["phase"] != "update"] == ["new"]
    assert len([e for e in made if e["reason"].endswith("; armed all the same")]) == 2
    # Only this is for the asking: what is there now is as it should be.
    room.command("calibrate")
    room.listen(2, gain=0.1)
    assert room.events("tamper")[-1]["phase"] == "end"


def test_silence_is_a_fault_even_if_an_output_in_trouble_was_the_first_to_tell():
    now_s = 0.0
    health = Health(clock=lambda: now_s)
    room = Room(health=health)
    room.listen(1)
    now_s = 60.0
    assert health.complain("output x", "gone").state == "offline"
    for _ in range(2):
        room.worker.look_up()
    assert [e["phase"] for e in room.events("fault")] == ["new"]


def test_arming_can_be_refused():
    room = Room(arm_with_tamper="refuse")
    room.cover()
    room.command("arm")
    assert not room.worker.tracker.panel.is_armed
    assert room.events("tamper")[-1]["reason"].endswith("; arming was refused")
    room.listen(30)
    assert room.events("tamper")[-1]["phase"] == "end"
    room.command("arm")
    assert room.worker.tracker.panel.is_armed


@pytest.mark.parametrize(
    ("include", "exclude", "is_fault", "n_warnings"),
    [
        ((), (), False, 0),
        (((1.0, 2.0),), (), False, 0),
        (((0.5, 2.5),), (), False, 0),
        (((0.5, 5.0),), (), False, 1),
        (((1.0, 2.0), (4.0, 5.0)), (), False, 1),
        (((4.0, 5.0),), (), True, 1),
        ((), ((0.0, 9.0),), True, 0),
        (((1.0, 2.0),), ((0.5, 1.5), (1.5, 2.5)), True, 0),
        ((), ((0.0, 1.0), (1.2, 9.0)), False, 0),
    ],
)
def test_zones_against_a_swath(include, exclude, is_fault, n_warnings):
    zones = ZonesSection(include=include, exclude=exclude)
    assert bool(zone_fault(zones, 0.6, 2.5)) == is_fault
    assert len(list(zone_warnings(zones, 0.6, 2.5))) == n_warnings


def test_zones_outside_the_swath_end_the_start(tmp_path):
    file = tmp_path / "radard.yaml"
    file.write_text("zones: {include: [[50, 60]]}\n")
    argv = ("--port", "sim:empty", "--model", "none", "--duration", "4", "--speed", "max")
    code, _, err = run_radard(*argv, "--config", str(file))
    assert code == 78
    assert "zones: nothing counts within the sensor's swath" in err


def test_zones_outside_the_swath_are_a_fault_while_it_runs():
    room = Room()
    room.listen(3)
    room.reload("zones", include=((50.0, 60.0),))
    room.listen(2)
    (fault,) = room.events("fault")
    assert fault["reason"].startswith("zones: nothing counts")
    room.reload("zones", include=())
    room.listen(2)
    assert room.events("fault")[-1]["phase"] == "end"


def test_a_calibration_that_fails_ends_no_tamper_and_one_that_is_made_does(tmp_path):
    room = Room(
        gate={"calibration": "auto", "calibrate_after_s": 0, "calibrate_s": 30},
        port="sim:empty",
        state=tmp_path,
    )
    room.cover()
    room.command("calibrate")
    room.listen(2, gain=0.1)
    room.worker.handle(Notice("restart", "the module restarted", room.t_s))
    assert room.worker.state.calibration.phase == "failed"
    room.listen(4, gain=0.1)
    assert "tamper" in room.worker.tracker.open_events
    # And while one is being made it is on, too.
    room.command("calibrate")
    room.listen(29, gain=0.1)
    assert "tamper" in room.worker.tracker.open_events
    room.listen(2, gain=0.1)
    assert room.worker.state.calibration.phase == "made"
    made = room.events("tamper")
    assert made[-2]["reason"].endswith("; taken for the room: it was calibrated")
    assert made[-1]["phase"] == "end"


def test_a_reload_of_other_settings_ends_no_tamper():
    room = Room()
    room.cover()
    watch = room.pipeline.tamper
    room.reload("tamper", hold_s=8.0)
    assert room.pipeline.tamper is not watch
    room.listen(4, gain=0.1)
    assert "tamper" in room.worker.tracker.open_events
