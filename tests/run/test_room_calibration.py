"""The command `calibrate`: a running sensor makes its calibration, keeps it and uses it."""

import logging

import numpy as np
import pytest

from radard.detect.calibration import load_calibration
from tests.daemon_helpers import told
from tests.waiting import wait_for

pytestmark = pytest.mark.integration

FAST = {"port": "sim:empty", "speed": "10"}
GATE = {"calibrate_after_s": 3.0, "calibrate_s": 25.0}


def phase_of(daemon):
    return (daemon.panel().get("calibration") or {}).get("phase")


def ended(daemon):
    radar = daemon.radar
    wait_for(lambda: told(radar).get("seq"))
    seen = set()
    radar.command("calibrate")

    def is_over():
        seen.add(phase_of(daemon))
        return phase_of(daemon) in {"made", "failed"}

    wait_for(is_over)
    assert {"leave", "listen"} <= seen
    return told(radar)["calibration"]


def test_an_empty_room_is_kept_and_used(tmp_path, launch, caplog):
    caplog.set_level(logging.INFO, "radard")
    choices = []
    daemon = launch(sensor=FAST, gate=GATE, reload=lambda: choices[-1])
    told = ended(daemon)
    assert told["phase"] == "made"
    assert "predicted false gates" in told["text"]
    path = tmp_path / "state" / "radar.sim.calibration.json"
    made = load_calibration(path)
    assert (made.provenance.port, made.provenance.model) == ("sim:empty", "none")
    assert 22 <= made.provenance.n_dwells <= 26
    assert path.stat().st_mode & 0o777 == 0o644
    pipeline = daemon.radar.worker.parts.pipeline
    wait_for(lambda: pipeline.calibration is not None)
    np.testing.assert_allclose(pipeline.calibration.floor, made.floor, rtol=1e-3)
    seq = daemon.panel()["seq"]
    wait_for(lambda: daemon.panel()["seq"] > seq + 2)
    assert daemon.panel()["gate"] == "closed"
    # Also when a reload, as of what the page saves, makes another pipeline.
    mount = daemon.config.mount.model_copy(update={"height_m": 2.0})
    choices.append(daemon.config.model_copy(update={"mount": mount}))
    daemon.ask("reload")
    wait_for(lambda: daemon.radar.config().mount == mount)
    assert daemon.radar.worker.parts.pipeline.calibration is pipeline.calibration is not None


def test_one_that_a_reload_does_without_is_not_taken_up(launch):
    choices = []
    daemon = launch(sensor=FAST, gate=GATE, reload=lambda: choices[-1])
    wait_for(lambda: daemon.panel().get("seq"))
    daemon.radar.command("calibrate")
    wait_for(lambda: phase_of(daemon) == "listen")
    gate = daemon.config.gate.model_copy(update={"calibration": "none"})
    choices.append(daemon.config.model_copy(update={"gate": gate}))
    daemon.ask("reload")
    wait_for(lambda: phase_of(daemon) == "failed")
    assert "settings were changed" in told(daemon.radar)["calibration"]["text"]
    assert daemon.radar.worker.parts.pipeline.calibration is None


def test_a_file_that_cannot_be_written_holds_for_this_run(tmp_path, launch):
    (tmp_path / "file").write_text("")
    daemon = launch(sensor=FAST)
    wait_for(lambda: daemon.panel().get("seq"))
    # Not at the start, where a file that was named must be there.
    gate = daemon.config.gate.model_copy(
        update={**GATE, "calibration": str(tmp_path / "file" / "x.json")}
    )
    daemon.radar.worker.parts.config = daemon.config.model_copy(update={"gate": gate})
    told = ended(daemon)
    assert told["phase"] == "made"
    assert "holds until the end of this run" in told["text"]
    wait_for(lambda: daemon.radar.worker.parts.pipeline.calibration is not None)


def test_without_calibration_the_gate_learns_anew(launch, monkeypatch):
    restarted = []
    monkeypatch.setattr("radard.pipeline.Pipeline.restart", lambda _self: restarted.append(1))
    daemon = launch(gate={"calibration": "none"})
    wait_for(lambda: daemon.panel().get("seq"))
    daemon.radar.command("calibrate")
    wait_for(lambda: restarted)
    assert daemon.panel()["calibration"] is None
