"""The demo of `./run`: what somebody sees who has no module yet."""

import json
from pathlib import Path

import pytest

from radard.config.config import load_config
from radard.config.directories import clip_dir, demo_state, log_path, own_folder
from tests.processes import environ, ran
from tests.waiting import free_port

pytestmark = pytest.mark.integration
NEXT_DOG_S = 42.0
PAGE = "http://127.0.0.1:8434"


def test_the_alarm_ends_before_the_next_dog_and_its_clip_with_the_demo(tmp_path):
    (tmp_path / "tmp").mkdir()
    command = ["-m", "radard", "--port", "sim:demo?seed=1", "--speed", "max"]
    command += ["--duration", "44", "-o", "json", "-o", f"http://127.0.0.1:{free_port()}"]
    home = environ(HOME=str(tmp_path / "home"), TMPDIR=str(tmp_path / "tmp"))
    done = ran(*command, env=home, cwd=tmp_path, check=True)
    assert "clips, labels and settings end with it; --state DIR keeps them" in done.stderr
    records = [json.loads(line) for line in done.stdout.splitlines()]
    events = [r for r in records if r["type"] == "event" and r["kind"] == "alarm"]
    assert (events[0]["phase"], events[-1]["phase"]) == ("new", "end")
    assert len({e["id"] for e in events}) == 1
    assert events[0]["reason"].startswith("human")
    assert events[-1]["end_t_s"] < NEXT_DOG_S
    clip = Path(events[0]["clip"])
    assert clip.is_relative_to(tmp_path / "tmp")
    assert not clip.parent.parent.exists()
    assert not (tmp_path / "home").exists()


def made_of(port, *outputs, **sections):
    options = {"sensor": {"port": port}, "output": list(outputs), **sections}
    config = load_config(environ={}, options=options)
    return config, demo_state(config, {})


def test_a_folder_of_its_own_is_for_simulations_on_a_page_alone(tmp_path):
    _, made = made_of("sim:cat", "json", PAGE)
    assert clip_dir(made, {}) == own_folder() / "clips"
    assert log_path(made, {}) == own_folder() / "log.db"
    named = {"service": {"state_dir": tmp_path}}
    for config, same in (
        made_of("sim:cat", "json"),
        made_of("/dev/ttyACM0", PAGE),
        made_of("replay:night.h5", PAGE),
        made_of("sim:cat", PAGE, **named),
    ):
        assert same is config
