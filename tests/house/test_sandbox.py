"""What the unit's sandbox forbids, tried inside it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly
UNITS = Path(__file__).parents[2] / "daemon/radard/units"
# Each is one attempt; its name is printed if it succeeds.
PROBE = """
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


def is_system_up():
    if os.geteuid() != 0 or shutil.which("systemd-run") is None:
        return False
    said = subprocess.run(
        [shutil.which("systemctl"), "is-system-running"],
        capture_output=True,
        text=True,
        check=False,
    )
    return said.stdout.strip() in {"running", "degraded"}


def test_what_the_sandbox_forbids_fails_within_it():
    if not is_system_up():
        pytest.skip("no systemd runs here that could start a service, or not as root")
    lines = (UNITS / "radard.service").read_text().splitlines()
    start = lines.index("NoNewPrivileges=yes")
    sandbox = [line for line in lines[start:] if "=" in line and not line.startswith("#")]
    sandbox = [line for line in sandbox if not line.startswith("WantedBy")]
    options = [shutil.which("systemd-run"), "--wait", "--pipe", "--collect", "--quiet"]
    options += [f"--property={line}" for line in (*sandbox, "DynamicUser=yes", "UMask=0077")]
    options += ["--property=StateDirectory=radard-probe", "--property=StateDirectoryMode=0700"]
    said = subprocess.run(
        [*options, os.path.realpath(sys.executable), "-c", PROBE],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if "203/EXEC" in said.stderr or "No such file" in said.stderr:
        pytest.skip("this interpreter lies where the service does not see it")
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines() == ["state 0o700"]
