"""Nothing leaves the machine, and nothing is written, but through outputs that were named."""

import json

import pytest

from tests.processes import environ, ran

pytestmark = pytest.mark.integration

WATCHED = """
import json, os, sys
events = []
def hook(event, args):
    writes = event == "open" and isinstance(args[1], str) and set(args[1]) & set("wax+")
    if writes or event.startswith("socket.") or event in ("os.mkdir", "sqlite3.connect"):
        events.append([event, str(args[0])])
sys.addaudithook(hook)
"""
RUN = """
from radard.cli import main
main(["--port", "sim:human", "--speed", "max", "--duration", "4", "-o", "null"])
"""
TRAINING = "import x2train.bundle.export, x2train.nets.bundle_answers"
REPORT = """
links = [f"/proc/self/fd/{f}" for f in os.listdir("/proc/self/fd")]
files = [os.readlink(link) for link in links if os.path.lexists(link)]
print(json.dumps({"events": events, "files": files}))
"""


def _run(code, home):
    env = environ()
    env.pop("ORT_DISABLE_TELEMETRY", None)
    env |= {"HOME": str(home / "home"), "XDG_CACHE_HOME": str(home / "home" / "cache")}
    env |= {"RUNTIME_DIRECTORY": str(home / "run"), "STATE_DIRECTORY": str(home / "state")}
    env |= {"PYTHONDONTWRITEBYTECODE": "1", "MPLCONFIGDIR": str(home / "matplotlib")}
    done = ran("-c", WATCHED + code + REPORT, env=env, cwd=home, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_a_run_without_outputs_opens_no_socket_and_writes_its_status_file_alone(tmp_path):
    seen = _run(RUN, tmp_path)
    own = (str(tmp_path / "run"), str(tmp_path / "state"))
    assert [
        event for event in seen["events"] if not event[1].removeprefix("file://").startswith(own)
    ] == []
    assert [file for file in seen["files"] if file.startswith("socket:")] == []
    assert not (tmp_path / "home").exists()


def test_training_loads_onnxruntime_without_its_telemetry(tmp_path):
    seen = _run(TRAINING, tmp_path)
    assert [event for event in seen["events"] if event[0].startswith("socket.")] == []
    assert not list((tmp_path / "home").rglob("*onnxruntime*"))
