"""What deploy/ holds runs as it says: `python tools/checks/deploy.py`.

The container's and the add-on's options and variables are given to radard itself, as far as that
goes without an engine; what the unit's sandbox forbids is tried inside it, where systemd runs.
"""

import contextlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon")]

from radard.commands.setup import files  # noqa: E402 - the path comes first
from tests.processes import environ, ran, started  # noqa: E402 - the path comes first
from tests.waiting import free_port, wait_for  # noqa: E402
from tests.web_helpers import ask  # noqa: E402

CONTAINER = ROOT / "deploy/container"
ADDON = ROOT / "deploy/homeassistant/addon"
UNIT = ROOT / "daemon/radard/units/radard.service"
TOKEN = "0123456789abcdef" * 2
JOINED = re.sub(r"\\\n#?\s*", " ", (CONTAINER / "Containerfile").read_text())
IMAGE = {
    key: value
    for line in re.findall(r"^ENV (.+)$", JOINED, re.MULTILINE)[:1]
    for key, _, value in (word.partition("=") for word in shlex.split(line))
    if key.startswith("RADARD_")
}
RUNS = [shlex.split(line) for line in re.findall(r"^#\s*(podman run.+)$", JOINED, re.MULTILINE)]
"""The image's variables, and the `podman run` lines of the comment, each as its words."""


def after_image(words: list[str]) -> list[str]:
    """Return what a container's radard is given."""
    return words[words.index("uwb-radar-alarm") + 1 :]


def radard(folder: Path, *argv: str, **more: str) -> Any:
    """Run radard in a folder, with the variables of the image."""
    return ran("-m", "radard", *argv, env=environ(**IMAGE, **more), cwd=folder)


def commands_of_the_comment(folder: Path) -> Iterator[str]:
    """The comment's commands name real options and publish the dashboard, with its token."""
    if len(RUNS) != 2:
        yield f"Containerfile: {len(RUNS)} commands in its comment"
    for words in RUNS:
        given = (words[words.index("-e") + 1], words[words.index("-p") + 1][-10:])
        if given != ("DASHBOARD_TOKEN", ":8434:8434"):
            yield f"Containerfile: {given}"
        done = radard(folder, "config", "check", *after_image(words), DASHBOARD_TOKEN=TOKEN)
        if done.stdout != "configuration ok\n":
            yield f"Containerfile: {done.stderr}"


def simulated_radar(folder: Path) -> Iterator[str]:
    """The comment's simulated radar shows its dashboard to the token alone, or does not start."""
    port = free_port()
    argv = [word.replace("8434", str(port)) for word in after_image(RUNS[0])]
    places = {"STATE_DIRECTORY": str(folder / "s"), "RUNTIME_DIRECTORY": str(folder / "r")}

    def answer(token: str) -> int | None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        with contextlib.suppress(OSError):
            return int(ask(f"http://127.0.0.1:{port}/api/v1/status", headers=headers)[0])
        return None

    env = environ(**IMAGE, **places, DASHBOARD_TOKEN=TOKEN)
    process = started("-m", "radard", *argv, env=env, cwd=folder, stdout=None, stderr=None)
    try:
        wait_for(lambda: answer(TOKEN) == 200)
        for wrong in ("", "x" * 32):
            if answer(wrong) not in {401, 403}:
                yield f"container: the token {wrong!r} gets {answer(wrong)}"
        # What the image's health check asks.
        wait_for(lambda: radard(folder, "health", **places).returncode == 0)
    finally:
        process.terminate()
        process.wait(60)
    done = radard(folder, *argv, **places)
    if done.returncode != 78 or "DASHBOARD_TOKEN" not in done.stderr:
        yield f"container: without a token {done.returncode}: {done.stderr}"


def composed(folder: Path) -> Iterator[str]:
    """The compose file's radard takes its options, and tells no secret."""
    service = yaml.safe_load((CONTAINER / "compose.yaml").read_text())["services"]["radard"]
    given = {
        key: TOKEN if "$" in value else value for key, value in service["environment"].items()
    }
    done = radard(folder, "config", "show", *service["command"], **given)
    for words in ("mqtt://radard@mosquitto", "password_env: MQTT_PASSWORD"):
        if words not in done.stdout:
            yield f"compose.yaml: no {words}: {done.stderr}"
    if TOKEN in done.stdout:
        yield "compose.yaml: the token is shown"


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


def run_addon(folder: Path, options: dict[str, Any], **more: str) -> Any:
    """Run run.sh up to radard, which shows its configuration and ends."""
    (folder / "options.json").write_text(json.dumps(options))
    (folder / "bashio").write_text(_BASHIO)
    own = {"OPTIONS": str(folder / "options.json"), "DATA": str(folder)}
    own |= {"RUNTIME": str(folder / "run"), "RADARD": f"{sys.executable} -m radard config show"}
    argv = [shutil.which("bash") or "bash", "-c", f". {folder}/bashio; . {ADDON}/run.sh"]
    given = {"env": environ(**more, **own), "cwd": folder, "capture_output": True, "text": True}
    return subprocess.run(argv, check=False, **given)  # type: ignore[call-overload]


def addon(folder: Path) -> Iterator[str]:
    """The add-on gives its options to radard; without any it simulates, and makes a token once."""
    options = {**OPTIONS, "device": "/dev/ttyACM0", "sensitivity": "high"}
    options |= {"entry_delay_s": 20, "token": TOKEN, "name": "hall"}
    done = run_addon(folder, options, MQTT_HOST="core-mosquitto")
    shown = yaml.safe_load(done.stdout) or {}
    wanted = {
        "sensor": {"name": "hall", "port": "/dev/ttyACM0"},
        "alarm": {"sensitivity": "high", "entry_delay_s": 20},
        "mqtt": {"username": "addons", "password_env": "MQTT_PASSWORD"},
        "web": {"token_env": "DASHBOARD_TOKEN"},
    }
    for section, values in wanted.items():
        found = {key: shown.get(section, {}).get(key) for key in values}
        if found != values:
            yield f"add-on: {section}: {found}: {done.stderr}"
    if shown.get("output") != ["http://0.0.0.0:8434", "mqtt://core-mosquitto:1883"]:
        yield f"add-on: output: {shown.get('output')}"
    if TOKEN in done.stdout + done.stderr:
        yield "add-on: the token is told"
    first, second = (run_addon(folder, OPTIONS).stderr for _ in range(2))
    token = (folder / "token").read_text()
    if not re.fullmatch("[0-9a-f]{32}", token) or token not in first or token not in second:
        yield f"add-on: no token of its own: {first}"
    if "no MQTT broker" not in first:
        yield f"add-on: {first}"
    simulated = yaml.safe_load(run_addon(folder, OPTIONS).stdout)["sensor"]["port"]
    if simulated != "sim:demo":
        yield f"add-on: without a device it opens {simulated}"


# Each is one attempt; its name is printed if it succeeds.
_PROBE = """
import ctypes, os, pathlib, socket
def attempt(name, do):
    try:
        do()
    except (OSError, AttributeError, StopIteration):
        return
    print(name)
libc = ctypes.CDLL(None, use_errno=True)
def checked(result):
    if result != 0:
        raise OSError(ctypes.get_errno())
for path in ("/etc/radard-probe", "/usr/radard-probe", "/opt/radard-probe"):
    attempt(f"write {path}", lambda p=path: pathlib.Path(p).write_text("x"))
attempt("read home", lambda: next(pathlib.Path("/root").iterdir()))
attempt("see other users' processes", lambda: next(
    p for p in pathlib.Path("/proc").glob("[0-9]*") if p.stat().st_uid != os.getuid()))
attempt("netlink", lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0))
attempt("packets", lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0))
attempt("namespace", lambda: checked(libc.unshare(0x10000000)))
attempt("mount", lambda: checked(libc.mount(b"none", b"/tmp", b"tmpfs", 0, None)))
attempt("host name", lambda: socket.sethostname("radard-probe"))
attempt("real time", lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)))
attempt("raw memory", lambda: open("/dev/mem", "rb"))
attempt("a disk", lambda: open("/dev/sda", "rb"))
attempt("set user id", lambda: (pathlib.Path("/tmp/probe").write_text("x"),
    os.chmod("/tmp/probe", 0o4755)))
attempt("kernel settings", lambda: pathlib.Path("/proc/sys/kernel/panic").write_text("1"))
# And what it must allow.
socket.socket(socket.AF_INET).close()
pathlib.Path(os.environ["STATE_DIRECTORY"], "x").write_text("x")
print("state", oct(os.stat(os.environ["STATE_DIRECTORY"]).st_mode & 0o777))
"""


def said_by(*argv: str, timeout_s: float = 120) -> Any:
    """Run a program of the system; return what came of it."""
    given = {"capture_output": True, "text": True, "timeout": timeout_s}
    return subprocess.run(argv, check=False, **given)  # type: ignore[call-overload]


def what_the_sandbox_forbids(_folder: Path) -> Iterator[str]:
    """What the unit's sandbox forbids fails within it; skipped where no systemd could start it."""
    program, systemctl = shutil.which("systemd-run"), shutil.which("systemctl")
    if os.geteuid() != 0 or program is None or systemctl is None:
        return
    if said_by(systemctl, "is-system-running").stdout.strip() not in {"running", "degraded"}:
        return
    lines = UNIT.read_text().splitlines()
    lines = lines[lines.index("NoNewPrivileges=yes") :]
    own = (
        "DynamicUser=yes",
        "UMask=0077",
        "StateDirectory=radard-probe",
        "StateDirectoryMode=0700",
    )
    kept = [x for x in lines if "=" in x and not x.startswith(("#", "WantedBy"))]
    options = [f"--property={line}" for line in (*kept, *own)]
    options += ["--wait", "--pipe", "--collect", "--quiet"]
    done = said_by(program, *options, os.path.realpath(sys.executable), "-c", _PROBE)
    # Else this interpreter lies where the service does not see it.
    is_seen = "203/EXEC" not in done.stderr and "No such file" not in done.stderr
    if is_seen and (done.returncode, done.stdout) != (0, "state 0o700\n"):
        yield f"sandbox: {done.stdout} {done.stderr}"


def units_of_systemd(folder: Path) -> Iterator[str]:
    """Where it is, systemd finds no fault in units, and the first is as tight as told."""
    if (program := shutil.which("systemd-analyze")) is None:
        return
    radard = Path(sys.prefix, "bin/radard")
    units = {
        "radard.service": files.systemd_unit(radard),
        "radard@attic.service": files.systemd_instance_unit(radard),
        "radard-failed@attic.service": files.shipped("radard-failed@.service"),
    }
    for name, text in units.items():
        unit = folder / name
        # With a program that is there.
        unit.write_text(re.sub(r"(?m)^ExecStart=\S+", "ExecStart=/bin/true", text))
        done = said_by(program, "verify", "--man=no", str(unit))
        if done.returncode or "radard" in done.stderr:
            yield f"{name}: {done.stderr}"
    told = said_by(program, "security", "--offline=true", str(folder / "radard.service")).stdout
    if (level := told.rpartition("Overall exposure level")[2].split()[2]) != "1.5":
        yield f"radard.service: an exposure of {level}"


CHECKS = (
    commands_of_the_comment,
    simulated_radar,
    composed,
    addon,
    what_the_sandbox_forbids,
    units_of_systemd,
)


def main() -> int:
    """Print what does not hold; return 1 if there is anything."""
    found = []
    for check in CHECKS:
        with tempfile.TemporaryDirectory() as folder:
            found += list(check(Path(folder)))
    for line in found:
        print(line)
    print(f"deploy: {len(CHECKS)} checks, {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
