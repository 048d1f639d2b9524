import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from radard.cli import main
from radard.config.config import load_config
from radard.config.directories import calibration_file, for_service
from radard.config.sections import GateSettings
from radard.detect.calibration import Provenance, load_calibration
from radard.detect.gate import Gate
from radard.detect.survey import RoomSurvey
from radard.errors import ConfigError, NotAllowed, RadardError
from radard.pipeline import Pipeline
from radard.run.components import use_calibration
from tests.radar_helpers import dwell_of, noise, walker
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.wall_clock import utc_text

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)


def quiet_dwells(n, first=0, level=1.0):
    for k in range(n):
        frames = level * noise(60, seed=first + k)
        yield replace(dwell_of(frames), t_s=1.0 + k)


def surveyed(dwells, **options):
    # Where a rate is asked for, nothing else sets a threshold.
    rate = 86_400 if options else GateSettings().false_alarms_per_day
    survey = RoomSurvey(GateSettings(false_alarms_per_day=rate), 1.0)
    for dwell in dwells:
        survey.add(dwell)
    made = survey.calibration(Provenance(), **options)
    return survey, made


@pytest.mark.parametrize("level", [1e-12, 1.0, 1e12])
def test_the_map_is_the_noise_in_any_unit(level):
    survey, made = surveyed(quiet_dwells(30, level=level))
    survey.check_empty()
    assert made.floor / level**2 == pytest.approx(np.ones(64), rel=0.1)
    assert made.threshold_db == pytest.approx(np.full(64, 8.7), abs=1.0)
    assert made.threshold_db.min() > 8.2
    assert made.provenance.n_dwells == 30
    assert made.provenance.duration_s == pytest.approx(30.0)
    assert made.provenance.false_gates_per_day < 1e-3


def test_predicted_rate_is_kept_by_dwells_that_were_not_heard():
    share = 0.02
    _, made = surveyed(quiet_dwells(60), false_gates_per_day=share * 86_400)
    assert made.provenance.false_gates_per_day == pytest.approx(share * 86_400, rel=0.01)
    gate = Gate(GateSettings(), calibration=made)
    opened = sum(gate.read(dwell).is_open for dwell in quiet_dwells(700, first=1000))
    # Student's t leaves room for the short survey, so fewer than the share, but not none.
    assert 2 <= opened <= 2 * share * 700


def humming(n, level=(2.5, 2.5)):
    """Quiet dwells with a machine in one place."""
    rng = np.random.default_rng(1)
    for dwell in quiet_dwells(n):
        frames = dwell.frames.copy()
        frames[:, 9] += rng.uniform(*level) * np.exp(2j * np.pi * 8 * np.arange(60) / 60)
        yield replace(dwell, frames=frames)


def test_a_restless_corner_gets_a_higher_threshold_of_its_own():
    _, made = surveyed(humming(40, (0.5, 3)))
    assert made.threshold_db[9] == made.threshold_db.max()
    assert made.threshold_db[9] > np.median(made.threshold_db) + 1


def test_who_walks_ends_the_survey_and_what_hums_may_be_taken():
    survey, _ = surveyed(quiet_dwells(10))
    for k in range(10):
        frames = noise(60, seed=90 + k) + walker(60, 60, speed_mps=0.5, start_m=2.0, level=30)
        survey.add(replace(dwell_of(frames.astype(np.complex64)), t_s=11.0 + k))
    with pytest.raises(RadardError, match=r"something moves at .* to .* m;"):
        survey.check_empty()
    survey, _ = surveyed(humming(20))
    with pytest.raises(RadardError, match="the room is not empty"):
        survey.check_empty()
    survey.check_empty(takes_machines=True)


def test_too_little_is_no_calibration_and_windows_with_losses_do_not_count():
    with pytest.raises(RadardError, match="too little was heard: 5 sound windows"):
        surveyed(quiet_dwells(5))
    survey = RoomSurvey(GateSettings(), 1.0)
    for dwell in quiet_dwells(3):
        survey.add(replace(dwell, n_lost=30, longest_gap_s=0.5))
    with pytest.raises(RadardError, match="nothing was heard"):
        survey.check_empty()


def command(*arguments):
    return main(["calibrate", *map(str, arguments), "--speed", "max", "--model", "none"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("calibration") / "room.json"
    assert command("--port", "sim:empty", "--duration", 25, "--out", path) == 0
    return path


def test_command_keeps_map_and_provenance(made):
    made = load_calibration(made)
    assert made.provenance.port == "sim:empty"
    assert made.provenance.device == "sim:empty"
    assert made.provenance.model == "none"
    assert made.provenance.duration_s == pytest.approx(25, abs=1.0)
    age = datetime.now(UTC) - datetime.fromisoformat(made.provenance.made_utc)
    assert timedelta(seconds=-2) < age < timedelta(minutes=5)
    assert (made.floor > 0).all()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--port", "sim:empty"], "--out FILE"),
        (["--out", "x.json"], "no port"),
        (["--port", "sim:empty", "--out", "x", "--duration", "5"], "--duration 5: must be 25"),
        (["--port", "sim:empty", "--out", "x", "--false-gates", "0"], "--false-gates 0"),
    ],
)
def test_usage(arguments, word, capsys):
    assert command(*arguments) == 2
    assert word in capsys.readouterr().err


def test_it_replaces_a_calibration_and_nothing_else(made, tmp_path, capsys):
    listen = ("--port", "sim:empty", "--duration", 25, "--out")
    others = {"a.npz": b"PK frames", "config.yaml": b"sensor: {}", "b.json": b"{}"}
    for name, content in others.items():
        (tmp_path / name).write_bytes(content)
        assert command(*listen, tmp_path / name) == 78
        assert "not a calibration" in capsys.readouterr().err
        assert (tmp_path / name).read_bytes() == content
    kept = tmp_path / "room.json"
    before = load_calibration(made)
    older = replace(before.provenance, made_utc="2001-02-03T04:05:06.000Z")
    replace(before, provenance=older).save(kept)
    assert command(*listen, kept) == 0
    assert load_calibration(kept).provenance.made_utc != older.made_utc


def test_calibration_goes_where_the_daemon_looks(tmp_path, monkeypatch):
    service = tmp_path / "service"
    monkeypatch.setattr("radard.config.directories.SYSTEM_STATE_DIR", service)
    mine = config_of("auto", "/dev/ttyX", tmp_path / "mine")
    nobodys = config_of("auto", "/dev/ttyX", None)
    own = tmp_path / "mine" / "radar.calibration.json"
    assert for_service(mine, calibration_file(mine)) == own
    assert for_service(nobodys, calibration_file(nobodys)) == calibration_file(nobodys)
    service.mkdir()
    assert for_service(mine, calibration_file(mine)) == own
    assert for_service(nobodys, calibration_file(nobodys)) == service / "radar.calibration.json"
    monkeypatch.setattr("radard.config.directories.os.access", lambda *_: False)
    with pytest.raises(NotAllowed, match="use sudo"):
        for_service(nobodys, calibration_file(nobodys))


def pipeline_of(port="sim:empty"):
    with make_radar(parse_port(port), speed=None) as radar:
        next(iter(radar.frames()))
        stream = radar.stream
    return Pipeline(stream, load_config(environ={}, options={"model": {"name": "none"}}))


def config_of(calibration, port, state_dir):
    options = {"sensor": {"port": port}, "service": {"state_dir": state_dir}}
    return load_config(environ={}, options={**options, "gate": {"calibration": str(calibration)}})


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("made", "sim:empty", 60), (True, "")),
        (("none", "/dev/ttyX", 60), (False, "")),
        (("old", "sim:empty", 60), (True, "is stale: it is")),
        # One that was made is found by a real radar alone.
        (("auto", "/dev/ttyX", 60), (True, "")),
        (("auto", "/dev/ttyX", 20), (False, "goes without calibration")),
        (("auto", "sim:empty", 60), (False, "")),
        (("auto", "replay:x.h5", 60), (False, "")),
    ],
)
def test_which_calibration_is_used(asked, told, made, tmp_path, caplog):
    (named, port, rate), (is_used, words) = asked, told
    is_live = not port.startswith("replay:")
    (tmp_path / "radar.calibration.json").write_text(made.read_text())
    content = json.loads(made.read_text())
    content["provenance"]["made_utc"] = "2020-01-01T00:00:00Z"
    (tmp_path / "old.json").write_text(json.dumps(content))
    place = {"made": made, "old": tmp_path / "old.json"}.get(named, named)
    pipeline = pipeline_of(f"sim:empty?rate={rate}")
    use_calibration(config_of(place, port, tmp_path), pipeline, is_live=is_live)
    assert (pipeline.calibration is not None) is is_used
    assert words in caplog.text
    assert ("stale" in caplog.text) is ("stale" in words)
    # Asked for again it stays, and it can be taken away.
    kept = pipeline.calibration
    use_calibration(config_of(place, port, tmp_path), pipeline, is_live=is_live)
    assert pipeline.calibration is kept
    use_calibration(config_of("none", port, tmp_path), pipeline, is_live=is_live)
    assert pipeline.calibration is None


def test_named_calibration_must_be_there_and_fit(made, tmp_path):
    for place, rate, words in (("gone", 60, "cannot read"), (made, 20, "frame_rate_hz")):
        pipeline = pipeline_of(f"sim:empty?rate={rate}")
        with pytest.raises(ConfigError, match=words):
            use_calibration(config_of(place, "sim:empty", tmp_path), pipeline, is_live=True)


@pytest.mark.parametrize(
    ("made_at", "device", "software", "words"),
    [
        (NOW, "a", "1", []),
        (NOW - timedelta(days=91), "a", "1", ["91 days old"]),
        (NOW + timedelta(days=3), "a", "1", ["from the future"]),
        (NOW, "b", "2", ["device 'a', this is 'b'", "version '1', this is '2'"]),
        (NOW, "", "", []),
    ],
)
def test_staleness(made_at, device, software, words):
    _, made = surveyed(quiet_dwells(25))
    made_utc = utc_text(made_at.astimezone(UTC), "seconds")
    origin = Provenance(made_utc=made_utc, device="a", software="1")
    reasons = list(
        replace(made, provenance=origin).stale(device=device, software=software, now=NOW)
    )
    assert len(reasons) == len(words)
    assert all(word in reason for word, reason in zip(words, reasons, strict=True))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"colour": 1}, "provenance.colour: unknown"),
        ({"duration_s": "1"}, "provenance.duration_s"),
        ({"made_utc": "yesterday"}, "provenance.made_utc"),
        ({"made_utc": "2026-01-01T00:00:00"}, "no time zone"),
    ],
)
def test_wrong_provenance(change, word, made, tmp_path):
    path = tmp_path / "c.json"
    path.write_text(json.dumps({**json.loads(made.read_text()), "provenance": change}))
    with pytest.raises(ConfigError, match=word):
        load_calibration(path)
