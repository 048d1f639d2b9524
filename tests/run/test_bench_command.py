"""radard bench: what it measures adds up; how fast the machine is, is nobody's test."""

import json

import pytest

from radard.cli import main
from radard.commands.bench import measure
from radard.config.config import load_config
from radard.errors import RadardError
from tests.alarm_helpers import write_recording
from tests.radar_helpers import noise

NAMES = [
    "bytes to frames",
    "frames to windows",
    "... and decisions, as heard",
    "... and decisions, always open",
    "all, at its worst",
]


def config_of(port, model="none"):
    return load_config(environ={}, options={"sensor": {"port": port}, "model": {"name": model}})


def test_stages_add_up(capsys):
    argv = ["bench", "--model", "thesis", "--duration", "5", "--rounds", "2"]
    cost = measure(config_of("sim:human", "thesis"), 5.0, 2)
    assert [stage.name for stage in cost.stages] == NAMES
    assert all(stage.cpu_s > 0 and stage.ratio > 0 for stage in cost.stages)
    decode, _, _, worst, everything = cost.stages
    assert everything.cpu_s == pytest.approx(decode.cpu_s + worst.cpu_s)
    assert everything.ratio == pytest.approx(decode.ratio + worst.ratio)
    assert (cost.model, cost.frame_rate_hz, cost.all_s) == ("thesis", 60.0, everything.cpu_s)
    assert cost.duration_s == pytest.approx(5.0)
    assert main(argv) == 0
    assert "sim:human: 60 frames a second, model thesis" in capsys.readouterr().out
    assert main([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["stage"] for row in told["stages"]] == NAMES


def test_a_recording_has_no_bytes(tmp_path):
    path = tmp_path / "r.h5"
    write_recording(path, noise(300))
    cost = measure(config_of(f"replay:{path}"), 5.0, 1)
    assert [stage.name for stage in cost.stages] == NAMES[1:]


def test_too_short_a_stream(tmp_path):
    with pytest.raises(RadardError, match="too short for one window"):
        measure(config_of("sim:empty"), 1.0, 1)
