"""./run: the demo unless something names a port."""

import os
import shutil
import subprocess

import pytest

from tests.processes import ROOT

pytestmark = pytest.mark.integration
SHIPPED = (ROOT / "config.yaml").read_text()
DEMO, PAGE = ["--port", "sim:demo"], ["-o", "json", "-o", "http://127.0.0.1:8434"]


@pytest.fixture
def asked(tmp_path):
    """A function that gives ./run's arguments to radard, in a folder with a configuration."""
    here = tmp_path / "checkout"
    (here / "tools").mkdir(parents=True)
    (here / ".venv/bin").mkdir(parents=True)
    shutil.copy(ROOT / "run", here)
    (here / "tools/venv.sh").write_text("ensure_venv() { :; }\n")
    radard = here / ".venv/bin/radard"
    radard.write_text('#!/bin/sh\nfor word in "$@"; do echo "$word"; done\n')
    radard.chmod(0o755)

    def ask(*words, config=SHIPPED, **environ):
        (tmp_path / "config.yaml").write_text(config)
        given = {"env": {"PATH": os.environ["PATH"], **environ}, "cwd": tmp_path}
        argv = [here / "run", *words]
        done = subprocess.run(argv, capture_output=True, text=True, check=True, **given)
        return done.stdout.splitlines()

    return ask


def test_without_a_port_it_is_the_demo_and_what_is_named_stays(asked):
    for words in ([], ["--duration", "20"], ["--speed", "max"], ["-v"]):
        assert asked(*words) == [*words, *DEMO, *PAGE]
    assert asked("-o", "table") == ["-o", "table", *DEMO]
    assert asked("--port", "/dev/ttyACM0") == ["--port", "/dev/ttyACM0", *PAGE]
    for words in (["--help"], ["--version"], ["detect", "a.h5"], ["--config", "mine.yaml"]):
        assert asked(*words) == words


def test_a_port_of_configuration_or_environment_is_taken(asked):
    for config in (
        "sensor: {port: /dev/ttyACM0}\n",
        "sensor:\n  port: 'socket://10.0.0.5:4001'\n",
        "sensors:\n  hall: {port: sim:dog}\n",
        "sensor:\n  port: auto  # the only one\n",
    ):
        assert asked("--duration", "5", config=config) == ["--duration", "5", *PAGE]
    assert asked(config="sensor:\n  port: null\n# port: /dev/ttyACM0\n") == [*DEMO, *PAGE]
    assert asked(RADARD_SENSOR__PORT="sim:cat", RADARD_OUTPUT="json") == []
