"""The container, the compose file and the add-on, as far as that goes without an engine.

Keys are compared with those that their documentation lists; options and variables are given to
radard itself.
"""

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tomllib
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml

from radard.config.sections import AlarmSection
from tests.radar_helpers import python
from tests.waiting import free_port, wait_for

ROOT = Path(__file__).parents[2]
CONTAINER = ROOT / "deploy/container"
ADDON = ROOT / "deploy/homeassistant/addon"
TOKEN = "0123456789abcdef" * 2
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Docker, Compose specification: services top-level element.
SERVICE_KEYS = {
    *("image", "build", "restart", "ports", "volumes", "depends_on", "command", "environment"),
    *("devices", "group_add", "cap_drop", "security_opt", "read_only", "tmpfs"),
}
# Home Assistant, developer docs: add-on configuration (required ones, and some optional).
ADDON_REQUIRED = {"name", "version", "slug", "description", "arch"}
ADDON_OPTIONAL = {
    *("machine", "url", "startup", "webui", "boot", "ports", "ports_description", "host_network"),
    *("host_ipc", "host_dbus", "host_pid", "host_uts", "devices", "homeassistant", "hassio_role"),
    *("hassio_api", "homeassistant_api", "docker_api", "privileged", "full_access", "apparmor"),
    *("map", "environment", "audio", "video", "gpio", "usb", "uart", "udev", "devicetree"),
    *("kernel_modules", "stdin", "legacy", "options", "schema", "image", "timeout", "tmpfs"),
    *("discovery", "services", "ingress", "ingress_port", "ingress_entry", "ingress_stream"),
    *("panel_icon", "panel_title", "panel_admin", "backup", "backup_pre", "backup_post"),
    *("backup_exclude", "advanced", "stage", "init", "watchdog", "realtime", "journald"),
    *("breaking_versions", "auth_api"),
}
# The same page: option types, with what may stand in their brackets.
TYPES = re.compile(
    r"(str|bool|int|float|email|url|password|port)(\([-\d.]*,[-\d.]*\))?\??"
    r"|match\(.+\)\??|list\([^()]+\)\??|device(\(subsystem=\w+\))?\??"
)


def containerfile():
    return (CONTAINER / "Containerfile").read_text()


def environment_of_the_image():
    text = re.sub(r"\\\n\s*", " ", containerfile())
    (line,) = re.findall(r"^ENV (.+)$", text, re.MULTILINE)
    found = dict(word.split("=", 1) for word in shlex.split(line))
    return {key: value for key, value in found.items() if key.startswith("RADARD_")}


def documented_runs():
    """The `podman run` lines of the comment, each as its words."""
    comment = "\n".join(
        line.lstrip("#").strip() for line in containerfile().splitlines() if line.startswith("#")
    )
    joined = comment.replace("\\\n", " ")
    return [shlex.split(line) for line in joined.splitlines() if line.startswith("podman run")]


def after_image(words):
    return words[words.index("uwb-radar-alarm") + 1 :]


def test_the_comments_commands_name_real_options_and_publish_the_dashboard(tmp_path):
    runs = documented_runs()
    assert len(runs) == 2
    for words in runs:
        assert words[words.index("-e") + 1] == "DASHBOARD_TOKEN"
        assert words[words.index("-p") + 1].endswith(":8434:8434")
        done = subprocess.run(
            [python(), "-m", "radard", "config", "check", *after_image(words)],
            env={**os.environ, **environment_of_the_image(), "DASHBOARD_TOKEN": TOKEN},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (0, "configuration ok\n"), done.stderr


def answer(url, token=None):
    request = urllib.request.Request(url)  # noqa: S310 - our own
    if token:
        request.add_header("Authorization", f"Bearer {token}")
    try:
        with urllib.request.urlopen(request, timeout=60) as reply:  # noqa: S310
            return reply.status
    except urllib.error.HTTPError as err:
        return err.code
    except OSError:
        return None


def test_the_simulated_radar_of_the_comment_shows_its_dashboard_to_the_token_only(tmp_path):
    port = free_port()
    argv = [word.replace("8434", str(port)) for word in after_image(documented_runs()[0])]
    environ = {**os.environ, **environment_of_the_image(), "STATE_DIRECTORY": str(tmp_path / "s")}
    environ |= {"RUNTIME_DIRECTORY": str(tmp_path / "r"), "DASHBOARD_TOKEN": TOKEN}
    process = subprocess.Popen([python(), "-m", "radard", *argv], env=environ, cwd=tmp_path)
    try:
        url = f"http://127.0.0.1:{port}/api/v1/status"
        wait_for(lambda: answer(url, TOKEN) == 200)
        assert answer(url) in {401, 403}
        assert answer(url, "x" * 32) in {401, 403}
        # What the image's health check asks.
        health = [python(), "-m", "radard", "health"]
        wait_for(
            lambda: subprocess.run(health, env=environ, cwd=tmp_path, check=False).returncode == 0
        )
    finally:
        process.terminate()
        process.wait(60)
    # And without a token it says so, rather than to serve everybody.
    del environ["DASHBOARD_TOKEN"]
    done = subprocess.run(
        [python(), "-m", "radard", *argv],
        env=environ,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 78
    assert "DASHBOARD_TOKEN" in done.stderr


def test_the_image_has_what_its_build_needs():
    copied = re.findall(r"^COPY (?!--from)(.+)$", containerfile(), re.MULTILINE)
    names = {name for line in copied for name in line.split()[:-1]}
    assert all((ROOT / name).exists() for name in names)
    build = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]
    backend = f"{build['backend-path'][0]}/{build['build-backend']}.py"
    assert {backend, "requirements.txt", "config.yaml"} <= names


# ---------------------------------------------------------------- compose


def compose():
    return yaml.safe_load((CONTAINER / "compose.yaml").read_text())


def test_compose_names_what_there_is():
    content = compose()
    assert set(content) == {"name", "services", "volumes"}
    for service in content["services"].values():
        assert set(service) <= SERVICE_KEYS
        for volume in service.get("volumes", []):
            source = volume.split(":")[0]
            made = (*content["volumes"], "./passwd")
            assert source in made or (CONTAINER / source).is_file()
        assert set(service.get("depends_on", [])) <= set(content["services"])
    build = content["services"]["radard"]["build"]
    assert ((CONTAINER / build["context"]).resolve() / build["dockerfile"]).is_file()
    assert (CONTAINER / build["context"]).resolve() == ROOT


def test_composes_radard_takes_its_options(tmp_path):
    service = compose()["services"]["radard"]
    environ = {
        key: TOKEN if "$" in value else value for key, value in service["environment"].items()
    }
    done = subprocess.run(
        [python(), "-m", "radard", "config", "show", *service["command"]],
        env={**os.environ, **environment_of_the_image(), **environ},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "mqtt://radard@mosquitto" in done.stdout
    assert "password_env: MQTT_PASSWORD" in done.stdout
    assert TOKEN not in done.stdout


NOT_AUTHORIZED = bytes([0x20, 2, 0, 5])
"""CONNACK of MQTT 3.1.1 (section 3.2.2.3)."""


def connack(port):
    """The broker's answer to a client that names no user."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as broker:
        broker.sendall(b"\x10\x0c\x00\x04MQTT\x04\x02\x00\x3c\x00\x00")
        return broker.recv(4)


@pytest.mark.skipif(shutil.which("mosquitto") is None, reason="no mosquitto here")
def test_mosquitto_takes_its_file_and_wants_a_password(tmp_path):
    port = free_port()
    (tmp_path / "passwd").touch()
    text = (CONTAINER / "mosquitto.conf").read_text()
    text = text.replace("listener 1883", f"listener {port} 127.0.0.1")
    text = text.replace("/mosquitto/config", str(tmp_path)).replace(
        "/mosquitto/data", str(tmp_path)
    )
    # Not as the user mosquitto, who may not read what a test makes.
    (tmp_path / "mosquitto.conf").write_text(f"{text}user root\n")
    process = subprocess.Popen(
        [shutil.which("mosquitto"), "-v", "-c", tmp_path / "mosquitto.conf"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        said = []
        for line in process.stdout:
            said.append(line)
            if "running" in line:
                break
        assert not [line for line in said if "Error" in line], said
        assert connack(port) == NOT_AUTHORIZED
    finally:
        # A signal that comes before the broker's loop has begun is forgotten by it.
        process.kill()
        process.wait(60)
        process.stdout.close()


# ---------------------------------------------------------------- add-on


def addon():
    return yaml.safe_load((ADDON / "config.yaml").read_text())


def test_addon_has_the_documented_keys_and_types():
    content = addon()
    assert set(content) >= ADDON_REQUIRED
    assert set(content) <= ADDON_REQUIRED | ADDON_OPTIONAL
    assert content["version"] == PROJECT["version"]
    assert re.fullmatch(r"[a-z0-9_]+", content["slug"])
    assert set(content["arch"]) <= {"aarch64", "amd64", "armhf", "armv7", "i386"}
    assert content["startup"] in {"initialize", "system", "services", "application", "once"}
    assert content["boot"] in {"auto", "manual", "manual_only"}
    for service in content["services"]:
        assert re.fullmatch(r"(mqtt|mysql):(provide|want|need)", service)
    assert all(re.fullmatch(r"\d+/(tcp|udp)", port) for port in content["ports"])
    for kind in content["schema"].values():
        assert TYPES.fullmatch(kind), kind
    # An option without a value is one that may be left out.
    assert set(content["options"]) == {k for k, v in content["schema"].items() if v[-1] != "?"}
    build = yaml.safe_load((ADDON / "build.yaml").read_text())
    assert set(build) <= {"build_from", "args", "labels", "codenotary"}
    assert set(build["build_from"]) == set(content["arch"])
    docker = (ADDON / "Dockerfile").read_text()
    assert docker.startswith("ARG BUILD_FROM\nFROM $BUILD_FROM\n")


def test_addon_explains_every_option():
    for path in (ADDON / "translations").glob("*.yaml"):
        content = yaml.safe_load(path.read_text())
        assert set(content) == {"configuration", "network"}
        assert set(content["configuration"]) == set(addon()["schema"])
        assert set(content["network"]) == set(addon()["ports"])
        for text in content["configuration"].values():
            assert set(text) == {"name", "description"}


def test_addon_offers_what_radard_takes():
    schema = addon()["schema"]
    field = AlarmSection.model_fields["entry_delay_s"]
    most = next(rule.le for rule in field.metadata if hasattr(rule, "le"))
    assert schema["entry_delay_s"] == f"int(0,{most})"


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


def run_addon(folder, options, **environ):
    """Run run.sh up to radard, which shows its configuration and ends."""
    (folder / "options.json").write_text(json.dumps(options))
    (folder / "bashio").write_text(_BASHIO)
    radard = f"{sys.executable} -m radard config show"
    return subprocess.run(
        [shutil.which("bash"), "-c", f". {folder}/bashio; . {ADDON}/run.sh"],
        env={
            **os.environ,
            **environ,
            "OPTIONS": str(folder / "options.json"),
            "DATA": str(folder),
            "RUNTIME": str(folder / "run"),
            "RADARD": radard,
        },
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_addon_gives_its_options_to_radard(tmp_path):
    options = {**addon()["options"], "device": "/dev/ttyACM0", "sensitivity": "high"}
    options |= {"entry_delay_s": 20, "token": TOKEN, "name": "hall"}
    done = run_addon(tmp_path, options, MQTT_HOST="core-mosquitto")
    assert done.returncode == 0, done.stderr
    shown = yaml.safe_load(done.stdout)
    assert (shown["sensor"]["name"], shown["sensor"]["port"]) == ("hall", "/dev/ttyACM0")
    assert (shown["alarm"]["sensitivity"], shown["alarm"]["entry_delay_s"]) == ("high", 20)
    assert shown["output"] == ["http://0.0.0.0:8434", "mqtt://addons@core-mosquitto:1883"]
    names = (shown["web"]["token_env"], shown["mqtt"]["password_env"])
    assert names == ("DASHBOARD_TOKEN", "MQTT_PASSWORD")
    assert TOKEN not in done.stdout + done.stderr


def test_addon_without_options_simulates_and_makes_a_token_once(tmp_path):
    first = run_addon(tmp_path, addon()["options"])
    assert first.returncode == 0, first.stderr
    assert yaml.safe_load(first.stdout)["sensor"]["port"] == "sim:demo"
    token = (tmp_path / "token").read_text()
    assert re.fullmatch("[0-9a-f]{32}", token)
    assert token in first.stderr
    assert "no MQTT broker" in first.stderr
    assert token in run_addon(tmp_path, addon()["options"]).stderr


def test_addon_folder_is_made_with_a_wheel(tmp_path):
    wheel = tmp_path / "uwb_radar_alarm-0.1.0-py3-none-any.whl"
    wheel.touch()
    subprocess.run(
        [ADDON / "make", tmp_path / "out"], env={**os.environ, "WHEEL": str(wheel)}, check=True
    )
    made = {path.name for path in (tmp_path / "out").iterdir()}
    copied = re.findall(r"^COPY (.+)$", (ADDON / "Dockerfile").read_text(), re.MULTILINE)
    for name in (name for line in copied for name in line.split()[:-1]):
        assert [each for each in made if Path(each).match(name)], name
    assert {"config.yaml", "build.yaml", "translations"} <= made
