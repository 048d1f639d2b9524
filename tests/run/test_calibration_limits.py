"""Room calibrations that wait, are too slow, break off: each ends, and leaves no thread behind."""

import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from radard.config.config import load_config
from radard.detect.calibration import Provenance
from radard.detect.survey import RoomSurvey
from radard.errors import RadardError
from radard.run.room_calibration import RoomCalibration
from tests.machine_helpers import machine_settings
from tests.radar_helpers import dwell_of, noise
from tests.waiting import wait_for

DWELL = dwell_of(noise(60))
CONFIG = load_config(environ={})


def threads():
    return [t for t in threading.enumerate() if t.name == "calibration"]


class Survey:
    """A survey that hears nothing before it may, and makes whatever."""

    may = threading.Event()
    hears = threading.Event()
    fails_at, fault = None, RadardError("the room is not empty")

    def __init__(self, *_):
        self.n = 0

    def add(self, _dwell):
        self.hears.set()
        assert self.may.wait(60)
        self.n += 1
        if self.n == self.fails_at:
            raise self.fault

    def check_empty(self):
        pass

    def calibration(self, origin):
        class Made:
            provenance = replace(origin, n_dwells=self.n)

            def save(self, _path):
                pass

        return Made()


def survey_that_waits(monkeypatch, folder):
    """Return what makes a calibration of so many dwells, whose survey waits."""
    for name, what in vars(Survey).items():
        if not name.startswith("__") or name == "__init__":
            monkeypatch.setattr(RoomSurvey, name, what, raising=False)
    for name in ("may", "hears"):
        monkeypatch.setattr(RoomSurvey, name, threading.Event())
    made = []

    def make(n_dwells, after_s=0):
        told = {"calibrate_after_s": after_s, "calibrate_s": float(n_dwells)}
        gate = CONFIG.gate.model_copy(update=told)
        service = CONFIG.service.model_copy(update={"state_dir": folder})
        config = CONFIG.model_copy(update={"gate": gate, "service": service})
        return RoomCalibration(config, lambda: Provenance(made_utc="now"), 0.0, made.append)

    make.made = made
    make.survey = RoomSurvey
    return make


@pytest.fixture
def room(monkeypatch, tmp_path):
    yield survey_that_waits(monkeypatch, tmp_path)
    RoomSurvey.may.set()
    wait_for(lambda: not threads())


def hear(calibration, n, first=1):
    for k in range(first, first + n):
        calibration.take(replace(DWELL, t_s=float(k)))


def test_it_listens_to_whole_dwells_from_when_the_room_is_left_and_counts_down(room):
    """The room is left for three seconds, and every dwell is a second long."""
    calibration = room(25, after_s=3)
    seen = [calibration.progress]
    for k in range(1, 29):
        hear(calibration, 1, first=k)
        seen.append(calibration.progress)
    left = [("leave", s) for s in (3, 2, 1, 0)] + [("listen", s) for s in range(24, -1, -1)]
    assert [(each.phase, each.left_s) for each in seen] == left
    assert [each.daemon for each in threads()] == [True]
    hear(calibration, 3, first=29)
    room.survey.may.set()
    wait_for(lambda: calibration.progress.phase == "made")
    assert [made.provenance.n_dwells for made in room.made] == [25]


def test_half_a_minute_may_wait_and_no_more(room):
    calibration = room(1000)
    hear(calibration, 1)
    assert room.survey.hears.wait(60)
    hear(calibration, 30, first=2)
    assert calibration.progress.phase == "listen"
    hear(calibration, 1, first=32)
    assert calibration.progress.phase == "failed"
    assert calibration.progress.text == "the machine is too slow for it"
    room.survey.may.set()
    wait_for(lambda: not threads())
    assert room.made == []


@pytest.mark.parametrize("fault", [RadardError("it is not empty"), ZeroDivisionError("at 0")])
def test_a_survey_that_fails_has_the_last_word(room, monkeypatch, fault):
    monkeypatch.setattr(RoomSurvey, "fails_at", 2)
    monkeypatch.setattr(RoomSurvey, "fault", fault)
    calibration = room(30)
    room.survey.may.set()
    hear(calibration, 2)
    wait_for(lambda: calibration.progress.is_over)
    hear(calibration, 20, first=3)
    calibration.stop("too late")
    text = str(fault) if isinstance(fault, RadardError) else repr(fault)
    assert (calibration.progress.phase, calibration.progress.text) == ("failed", text)


class CalibrationMachine(RuleBasedStateMachine):
    """Dwells, a survey that is slow or fails, and somebody who stops it, in any order."""

    @initialize(n=st.integers(25, 45), fails_at=st.none() | st.integers(1, 30))
    def begin(self, n, fails_at):
        self.folder = tempfile.TemporaryDirectory()
        self.patch = pytest.MonkeyPatch()
        self.room = survey_that_waits(self.patch, Path(self.folder.name))
        self.patch.setattr(RoomSurvey, "fails_at", fails_at)
        self.calibration, self.n, self.n_heard, self.stopped = self.room(n), n, 0, False
        self.word = ""

    @rule(n=st.integers(1, 20))
    def listen(self, n):
        hear(self.calibration, n, first=self.n_heard + 1)
        self.n_heard += n

    @rule()
    def go_on(self):
        RoomSurvey.may.set()

    @rule()
    def stop(self):
        self.stopped = self.stopped or self.n_heard < self.n
        self.calibration.stop("it was stopped")

    @invariant()
    def the_end_is_the_last_word(self):
        progress = self.calibration.progress
        assert not self.word or progress.text == self.word
        self.word = progress.text if progress.is_over else ""

    def teardown(self):
        if not hasattr(self, "room"):
            return
        try:
            RoomSurvey.may.set()
            if self.stopped or self.n_heard >= self.n:
                wait_for(lambda: self.calibration.progress.is_over)
            self.calibration.stop("at the end")
            wait_for(lambda: not threads())
            is_made = self.calibration.progress.phase == "made"
            assert [made.provenance.n_dwells for made in self.room.made] == [self.n] * is_made
            assert not (is_made and self.stopped)
        finally:
            self.patch.undo()
            self.folder.cleanup()


TestCalibrationMachine = CalibrationMachine.TestCase
TestCalibrationMachine.settings = machine_settings(20)
