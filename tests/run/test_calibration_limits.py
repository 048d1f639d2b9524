"""Room calibrations that count down, fail or are stopped: each ends, and once."""

import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from radard.config.config import load_config
from radard.detect.survey import RoomSurvey
from radard.errors import RadardError
from radard.run.room_calibration import RoomCalibration
from tests.machine_helpers import machine_settings
from tests.radar_helpers import BASEBAND, dwell_of, noise
from x2radar.frame import StreamInfo

DWELL = dwell_of(noise(60))
STREAM = StreamInfo(BASEBAND, 60.0, "test")
CONFIG = load_config(environ={})


class Survey:
    """A survey that makes whatever."""

    fails_at, fault = None, RadardError("the room is not empty")

    def __init__(self, *_):
        self.n = 0

    def add(self, _dwell):
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


def made_up_survey(monkeypatch, folder):
    """Return what makes a calibration of so many dwells, whose survey is made up."""
    for name, what in vars(Survey).items():
        if not name.startswith("__") or name == "__init__":
            monkeypatch.setattr(RoomSurvey, name, what, raising=False)

    def make(n_dwells, after_s=0):
        told = {"calibrate_after_s": after_s, "calibrate_s": float(n_dwells)}
        gate = CONFIG.gate.model_copy(update=told)
        service = CONFIG.service.model_copy(update={"state_dir": folder})
        config = CONFIG.model_copy(update={"gate": gate, "service": service})
        return RoomCalibration(config, SimpleNamespace(stream=STREAM, classifier=None), 0.0)

    return make


@pytest.fixture
def room(monkeypatch, tmp_path):
    return made_up_survey(monkeypatch, tmp_path)


def hear(calibration, n, first=1):
    """Return what is made of so many dwells."""
    heard = [calibration.take(replace(DWELL, t_s=float(k))) for k in range(first, first + n)]
    return [made for made in heard if made is not None]


def test_it_listens_to_whole_dwells_from_when_the_room_is_left_and_counts_down(room):
    """The room is left for three seconds, and every dwell is a second long."""
    calibration = room(25, after_s=3)
    seen = [calibration.progress]
    for k in range(1, 28):
        assert hear(calibration, 1, first=k) == []
        seen.append(calibration.progress)
    left = [("leave", s) for s in (3, 2, 1, 0)] + [("listen", s) for s in range(24, 0, -1)]
    assert [(each.phase, each.left_s) for each in seen] == left
    made = hear(calibration, 4, first=28)
    assert calibration.progress.phase == "made"
    assert [each.provenance.n_dwells for each in made] == [25]


@pytest.mark.parametrize("fault", [RadardError("it is not empty"), ZeroDivisionError("at 0")])
def test_a_survey_that_fails_has_the_last_word(room, monkeypatch, fault):
    monkeypatch.setattr(RoomSurvey, "fails_at", 2)
    monkeypatch.setattr(RoomSurvey, "fault", fault)
    calibration = room(30)
    hear(calibration, 2)
    assert calibration.progress.is_over
    hear(calibration, 20, first=3)
    calibration.stop("too late")
    text = str(fault) if isinstance(fault, RadardError) else repr(fault)
    assert (calibration.progress.phase, calibration.progress.text) == ("failed", text)


class CalibrationMachine(RuleBasedStateMachine):
    """Dwells, a survey that fails, and somebody who stops it, in any order."""

    @initialize(n=st.integers(25, 45), fails_at=st.none() | st.integers(1, 30))
    def begin(self, n, fails_at):
        self.folder = tempfile.TemporaryDirectory()
        self.patch = pytest.MonkeyPatch()
        room = made_up_survey(self.patch, Path(self.folder.name))
        self.patch.setattr(RoomSurvey, "fails_at", fails_at)
        self.calibration, self.n, self.n_heard, self.made = room(n), n, 0, []
        self.last = self.calibration.progress

    @rule(n=st.integers(1, 20))
    def listen(self, n):
        self.made += hear(self.calibration, n, first=self.n_heard + 1)
        self.n_heard += n

    @rule()
    def stop(self):
        self.calibration.stop("it was stopped")

    @invariant()
    def the_end_is_the_last_word(self):
        assert not self.last.is_over or self.calibration.progress == self.last
        self.last = self.calibration.progress

    def teardown(self):
        if not hasattr(self, "made"):
            return
        try:
            assert self.last.is_over or self.n_heard < self.n
            is_made = self.last.phase == "made"
            assert [made.provenance.n_dwells for made in self.made] == [self.n] * is_made
        finally:
            self.patch.undo()
            self.folder.cleanup()


TestCalibrationMachine = CalibrationMachine.TestCase
TestCalibrationMachine.settings = machine_settings(20)
