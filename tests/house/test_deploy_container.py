"""The container, the compose file and the add-on, as far as that goes without an engine.

Options and variables are given to radard itself.
"""

import contextlib
import json
import re
import shlex
import shutil
import subprocess
import sys

import pytest
import yaml

from tests.processes import ROOT, environ, ran, started
from tests.waiting import free_port, wait_for
from tests.web_helpers import ask

pytestmark = pytest.mark.nightly
CONTAINER = ROOT / "deploy/container"
ADDON = ROOT / "deploy/homeassistant/addon"
TOKEN = "0123456789abcdef" * 2


TEXT = (CONTAINER / "Containerfile").read_text()
JOINED = re.sub(r"\\\n#?\s*", " ", TEXT)
IMAGE = {
    key: value
    for key, _, value in (
        word.partition("=")
        for word in shlex.split(re.search(r"^ENV (.+)$", JOINED, re.MULTILINE)[1])
    )
    if key.startswith("RADARD_")
}
RUNS = [shlex.split(line) for line in re.findall(r"^#\s*(podman run.+)$", JOINED, re.MULTILINE)]
"""The image's variables, and the `podman run` lines of the comment, each as its words."""


def after_image(words):
    return words[words.index("uwb-radar-alarm") + 1 :]


def radard(*argv, folder, **more):
    """A finished radard in a folder, with the variables of the image."""
    return ran("-m", "radard", *argv, env=environ(**IMAGE, **more), cwd=folder)


def test_the_comments_commands_name_real_options_and_publish_the_dashboard(tmp_path):
    assert len(RUNS) == 2
    for words in RUNS:
        assert words[words.index("-e") + 1] == "DASHBOARD_TOKEN"
        assert words[words.index("-p") + 1].endswith(":8434:8434")
        given = {"folder": tmp_path, "DASHBOARD_TOKEN": TOKEN}
        done = radard("config", "check", *after_image(words), **given)
        assert (done.returncode, done.stdout) == (0, "configuration ok\n"), done.stderr


def answer(url, token):
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    with contextlib.suppress(OSError):
        return ask(url, headers=headers)[0]


def test_the_simulated_radar_of_the_comment_shows_its_dashboard_to_the_token_only(tmp_path):
    port = free_port()
    argv = [word.replace("8434", str(port)) for word in after_image(RUNS[0])]
    places = {"STATE_DIRECTORY": str(tmp_path / "s"), "RUNTIME_DIRECTORY": str(tmp_path / "r")}
    env = environ(**IMAGE, **places, DASHBOARD_TOKEN=TOKEN)
    process = started("-m", "radard", *argv, env=env, cwd=tmp_path, stdout=None, stderr=None)
    try:
        url = f"http://127.0.0.1:{port}/api/v1/status"
        wait_for(lambda: answer(url, TOKEN) == 200)
        assert {answer(url, wrong) for wrong in ("", "x" * 32)} <= {401, 403}
        # What the image's health check asks.
        wait_for(lambda: radard("health", folder=tmp_path, **places).returncode == 0)
    finally:
        process.terminate()
        process.wait(60)
    # And without a token it says so, rather than to serve everybody.
    done = radard(*argv, folder=tmp_path, **places)
    assert done.returncode == 78
    assert "DASHBOARD_TOKEN" in done.stderr


# ---------------------------------------------------------------- compose


def test_composes_radard_takes_its_options(tmp_path):
    service = yaml.safe_load((CONTAINER / "compose.yaml").read_text())["services"]["radard"]
    given = {
        key: TOKEN if "$" in value else value for key, value in service["environment"].items()
    }
    done = radard("config", "show", *service["command"], folder=tmp_path, **given)
    assert done.returncode == 0, done.stderr
    assert "mqtt://radard@mosquitto" in done.stdout
    assert "password_env: MQTT_PASSWORD" in done.stdout
    assert TOKEN not in done.stdout


# ---------------------------------------------------------------- add-on


OPTIONS = yaml.safe_load((ADDON / "config.yaml").read_text())["options"]


# What run.sh asks of bashio, the library of the add-ons' base images: answered from a file.
_BASHIO = """
bashio::config() {
    python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))[sys.argv[2]])' "$OPTIONS" "$1"
}
bashio::config.has_value() { bashio::config "$1" >/dev/null 2>&1; }
bashio::log.info() { echo "$*" >&2; }
bashio::log.warning() { echo "$*" >&2; }
bashio::services.available() { [ -n "${MQTT_HOST:-}" ]; }
bashio::services() { case $2 in host) echo "$MQTT_HOST";; port) echo 1883;; username) echo addons;;
    password) echo secret;; ssl) echo false;; esac; }
"""


def run_addon(folder, options, **more):
    """Run run.sh up to radard, which shows its configuration and ends."""
    (folder / "options.json").write_text(json.dumps(options))
    (folder / "bashio").write_text(_BASHIO)
    return subprocess.run(
        [shutil.which("bash"), "-c", f". {folder}/bashio; . {ADDON}/run.sh"],
        env=environ(
            **more,
            OPTIONS=str(folder / "options.json"),
            DATA=str(folder),
            RUNTIME=str(folder / "run"),
            RADARD=f"{sys.executable} -m radard config show",
        ),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_addon_gives_its_options_to_radard(tmp_path):
    options = {**OPTIONS, "device": "/dev/ttyACM0", "sensitivity": "high"}
    options |= {"entry_delay_s": 20, "token": TOKEN, "name": "hall"}
    done = run_addon(tmp_path, options, MQTT_HOST="core-mosquitto")
    assert done.returncode == 0, done.stderr
    shown = yaml.safe_load(done.stdout)
    assert (shown["sensor"]["name"], shown["sensor"]["port"]) == ("hall", "/dev/ttyACM0")
    assert (shown["alarm"]["sensitivity"], shown["alarm"]["entry_delay_s"]) == ("high", 20)
    assert shown["output"] == ["http://0.0.0.0:8434", "mqtt://core-mosquitto:1883"]
    assert shown["mqtt"]["username"] == "addons"
    names = (shown["web"]["token_env"], shown["mqtt"]["password_env"])
    assert names == ("DASHBOARD_TOKEN", "MQTT_PASSWORD")
    assert TOKEN not in done.stdout + done.stderr


def test_addon_without_options_simulates_and_makes_a_token_once(tmp_path):
    first = run_addon(tmp_path, OPTIONS)
    assert first.returncode == 0, first.stderr
    assert yaml.safe_load(first.stdout)["sensor"]["port"] == "sim:demo"
    token = (tmp_path / "token").read_text()
    assert re.fullmatch("[0-9a-f]{32}", token)
    assert token in first.stderr
    assert "no MQTT broker" in first.stderr
    assert token in run_addon(tmp_path, OPTIONS).stderr
