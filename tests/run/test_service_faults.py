"""Fail-safe: what goes wrong is announced, in time, and never taken for quiet."""

from functools import partial

import numpy as np
import pytest

from radard.errors import ModelMismatch
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from tests.alarm_helpers import write_recording
from tests.radar_helpers import decisions, events, noise, run_radard, stable, states
from x2radar.device.link import Deadlines
from x2radar.recording.registry import open_recording

FAST = ("--speed", "max", "-o", "json")
GATE = ("--model", "none", "-o", "json")


def test_invalid_windows_are_a_fault_within_three_seconds_of_the_first_frame():
    port = "sim:human?fault=drop_frames:0.2"
    _, records, _ = run_radard("--port", port, *FAST, "--duration", "10")
    (fault,) = events(records, "fault")
    assert fault["t_s"] <= 3
    assert "frames missing" in fault["reason"]
    assert not events(records, "alarm")
    assert ("degraded", fault["reason"]) in states(records)


@pytest.mark.parametrize("error", [RuntimeError("onnxruntime: out of memory"), ModelMismatch("x")])
def test_a_model_error_is_a_fault_and_not_the_end(monkeypatch, error):
    answer, decide, made = Classifier.answer, Pipeline.decide, []

    def deciding(self, dwell):
        made.append(1)
        return decide(self, dwell)

    def failing(self, *given):
        if len(made) in {3, 4}:
            raise error
        return answer(self, *given)

    monkeypatch.setattr(Pipeline, "decide", deciding)
    monkeypatch.setattr(Classifier, "answer", failing)
    code, records, _ = run_radard("--port", "sim:human", *FAST, "--duration", "15")
    assert code == 0
    made = decisions(records)
    assert [d["seq"] for d in made] == list(range(1, 14))
    assert [d["seq"] for d in made if d["label"] == "invalid"] == [3, 4]
    assert [e["phase"] for e in events(records, "fault")] == ["new", "end"]
    assert str(error) in events(records, "fault")[0]["reason"]
    told = ["starting", "online", "degraded", "online", "offline"]
    assert [state for state, _ in states(records)] == told


def test_a_dead_sensor_is_a_fault(tmp_path):
    frames = noise(1200)
    frames[600:900] = frames[600]
    write_recording(tmp_path / "r.h5", frames)
    _, records, _ = run_radard("--port", f"replay:{tmp_path / 'r.h5'}", *GATE)
    new, end = events(records, "fault")
    assert "dead sensor" in new["reason"]
    assert 10 < new["t_s"] < 13
    assert end["phase"] == "end"
    assert any(state == "degraded" for state, _ in states(records))


@pytest.mark.integration
def test_a_silent_module_is_a_fault_and_comes_back(monkeypatch):
    monkeypatch.setattr("x2radar.device.device.Deadlines", partial(Deadlines, stall_s=0.5))
    port = "sim:empty?fault=silent:8"
    _, records, err = run_radard("--port", port, "--speed", "4", *GATE, "--duration", "14")
    new, end = events(records, "fault")
    assert "no frame for" in new["reason"]
    assert (new["phase"], end["phase"]) == ("new", "end")
    assert any(s == "offline" and "device absent" in why for s, why in states(records))
    assert states(records)[-2][0] == "online"
    assert "found" in err


def room_recording(path, change, seconds=75, rate_hz=60):
    """A still room of 96 bins with noise, changed by `change(t_s, echoes)` for each second."""
    rng = np.random.default_rng(3)
    echoes = 30 * (rng.standard_normal(96) + 1j * rng.standard_normal(96))
    blocks = []
    for second in range(seconds):
        parts = rng.standard_normal((rate_hz, 96, 2))
        blocks.append(parts[..., 0] + 1j * parts[..., 1] + change(second, echoes))
    write_recording(path, np.concatenate(blocks).astype(np.complex64), rate_hz, bin_length_m=0.03)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t_s, e: e * (0.1 if t_s >= 30 else 1), "covered: still echoes fell 20 dB"),
        (lambda t_s, e: e[::-1] if t_s >= 30 else e, "moved: echoes agree 0."),
        (lambda _t_s, e: e, None),
    ],
)
def test_tamper_is_an_event_and_the_same_in_every_replay(tmp_path, change, words):
    room_recording(tmp_path / "r.h5", change)
    argv = ("--port", f"replay:{tmp_path / 'r.h5'}", *GATE)
    _, records, _ = run_radard(*argv)
    made = events(records, "tamper")
    if words is None:
        assert made == []
        return
    (new,) = made
    assert new["reason"].startswith(words)
    # Changes of more than twice the limits: sooner than `tamper.hold_s`.
    assert 35 <= new["t_s"] <= 40
    assert stable(run_radard(*argv)[1]) == stable(records)


def test_a_quiet_period_takes_the_clock_of_the_recording(tmp_path, monkeypatch):
    file = tmp_path / "r.h5"
    run_radard("--port", "sim:thesis_human", *FAST, "--duration", "12", "--record", str(file))
    monkeypatch.setenv("RADARD_ALARM__TIMEZONE", "UTC")
    with open_recording(file) as reader:
        hour = int(reader.started_utc[11:13])
    for later_h, is_quiet in ((0, True), (4, False)):
        begin, end = ((hour + later_h + k) % 24 for k in (0, 2))
        monkeypatch.setenv("RADARD_ALARM__QUIET", f"['{begin:02}:00-{end:02}:00']")
        _, records, _ = run_radard("--port", f"replay:{file}", "-o", "json")
        assert any(r["alarm"] for r in records if r["type"] == "decision")
        assert (events(records, "alarm") == []) is is_quiet


def test_zones_and_sensitivity_change_events_and_no_decision(monkeypatch):
    def run(**environ):
        for key, value in environ.items():
            monkeypatch.setenv(key, value)
        _, records, _ = run_radard(
            "--port", "sim:thesis_human?run=test", *FAST, "--duration", "16"
        )
        for key in environ:
            monkeypatch.delenv(key)
        return stable([r for r in records if r["type"] == "decision"]), events(records, "alarm")

    plain, alarms = run()
    assert alarms
    # Too short for anybody to be in; a zone wholly outside the swath is refused.
    nowhere, none = run(RADARD_ZONES__INCLUDE="[[2.0, 2.001]]")
    assert none == []
    low, slower = run(RADARD_ALARM__SENSITIVITY="low")
    assert slower[0]["t_s"] > alarms[0]["t_s"]
    delayed, later = run(RADARD_ALARM__ENTRY_DELAY_S="6")
    assert later[0]["t_s"] == alarms[0]["t_s"] + 6
    off, disarmed = run(RADARD_ALARM__ARMED="false")
    assert disarmed == []
    assert plain == nowhere == low == delayed == off
