"""Ids of events: of this run alone, the same in its replay; a demo never looks real."""

import h5py
import pytest

from radard.stream.source import open_source
from tests.radar_helpers import faults, run_radard, stable
from x2radar.cli import main as x2radar_main
from x2radar.errors import SettingsError
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.recording.hdf5_reader import RecordingReader

FAST = ("--speed", "max", "-o", "json", "--sensitivity", "high")


def ids(records):
    return [r["id"] for r in records if r["type"] == "event"]


def run(port, *argv):
    code, records, err = run_radard("--port", port, *FAST, *argv)
    assert (code, err) == (0, "")
    return records


def test_two_runs_of_one_scene_share_no_id_unless_their_run_is_named(tmp_path):
    first, second = (ids(run("sim:human", "--duration", "14")) for _ in range(2))
    assert first
    assert not set(first) & set(second)
    named = [stable(run("sim:human?run=test-1", "--duration", "14")) for _ in range(2)]
    assert named[0] == named[1]
    assert not set(ids(named[0])) & {*first, *second}


def test_a_replay_repeats_the_ids_of_the_run(tmp_path):
    file = tmp_path / "own.h5"
    live = run("sim:human", "--duration", "14", "--record", str(file))
    replays = [run(f"replay:{file}") for _ in range(2)]
    assert ids(live) == ids(replays[0]) == ids(replays[1])
    again = tmp_path / "again.h5"
    run(f"replay:{file}", "--record", str(again))
    assert RecordingReader(again).stream.run_id == RecordingReader(file).stream.run_id
    # The driver records it, too.
    file = tmp_path / "drivers.h5"
    argv = ["record", str(file), "--port", "sim:human?run=abc", "--duration", "1"]
    assert x2radar_main(argv) == 0
    assert RecordingReader(file).stream.run_id == "abc"


def test_a_recording_without_an_id_has_one_of_its_content(tmp_path):
    file, other = tmp_path / "a.h5", tmp_path / "b.h5"
    run("sim:human?seed=1", "--duration", "4", "--record", str(file))
    run("sim:human?seed=2", "--duration", "4", "--record", str(other))
    for path in (file, other):
        with h5py.File(path, "r+") as made:
            del made.attrs["run_id"]
    found = [open_source(f"replay:{path}").stream.run_id for path in (file, file, other)]
    assert found[0] == found[1] != found[2]
    assert len(found[0]) == 32


@pytest.mark.parametrize("key", ["run=", "run=a%2Fb", f"run={'x' * 65}"])
def test_ids_that_cannot_be(key):
    with pytest.raises(SettingsError, match="'run'"):
        make_radar(parse_port(f"sim:human?{key}"))


@pytest.mark.parametrize("mark", ["simulated", "replayed"])
def test_hello_status_and_events_say_what_the_stream_is(tmp_path, mark):
    file = tmp_path / "r.h5"
    records = run("sim:human", "--duration", "14", "--record", str(file))
    if mark == "replayed":
        records = run(f"replay:{file}")
    assert faults(records) == []
    for record in records:
        said = {name for name in ("simulated", "replayed") if record.get(name) is True}
        assert said == (set() if record["type"] == "decision" else {mark})
    assert {r["type"] for r in records} == {"hello", "status", "event", "decision"}
