"""Settings of all tests: the same on any machine and however they were started."""

import contextlib
import itertools
import json
import logging
import multiprocessing.process
import os
import signal
import socket
import subprocess
from pathlib import Path

import h5py  # noqa: F401 - asks `uname` as it is loaded, which a unit test may not
import pytest
from hypothesis import HealthCheck, settings

from tests.busy_machine import allow_for_it

# Before numpy is there: threads of its algebra wait in loops, for cores that other tests need.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

_known = {"derandomize": True, "deadline": None, "database": None}
settings.register_profile("fixed", suppress_health_check=[HealthCheck.too_slow], **_known)
settings.load_profile("fixed")


def pytest_addoption(parser):
    parser.addoption("--renew", action="store_true", help="write golden files, compare nothing")


def pytest_configure():
    """Give tests and the processes that they start a Ctrl-C; a shell's background ignores it."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Return how many processes test: one more than cores, since a quarter of the time is waits.

    Some files are done sooner than others are begun.
    """
    named = config.option.file_or_dir
    if named and all(".py" in name for name in named) and len(named) < 4:
        return 0
    return min(4, 1 + len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2)


@pytest.fixture(autouse=True)
def unit_tier(request, monkeypatch):
    """Let a test of ./test unit neither open a socket nor start a process, in any tier."""
    if any(map(request.node.get_closest_marker, ("integration", "nightly"))):
        return

    def refuse(*_args, **_kwargs):
        pytest.fail("a unit test opens no socket and starts no process: mark it integration")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(subprocess.Popen, "__init__", refuse)
    monkeypatch.setattr(os, "openpty", refuse)
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", refuse)


@pytest.fixture(scope="session", autouse=True)
def busy_machine():
    with pytest.MonkeyPatch.context() as patch:
        allow_for_it(patch)
        yield


@pytest.fixture(scope="session")
def fresh_folders(tmp_path_factory):
    """Folders one after the other; `mktemp` would look through all there are for each."""
    root = tmp_path_factory.mktemp("folders")
    return (root / str(n) for n in itertools.count())


@pytest.fixture(scope="session", autouse=True)
def nobodys_folders(fresh_folders):
    """Keep fixtures of modules, too, out of the folders of whoever runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        set_folders(patch, next(fresh_folders))
        yield


@pytest.fixture(autouse=True)
def own_log_level():
    """Give the log its level back: a command that ran within the process has set its own."""
    level = logging.root.level
    yield
    logging.root.setLevel(level)


@pytest.fixture(autouse=True)
def own_folders(nobodys_folders, fresh_folders, monkeypatch):
    """Keep the daemon's state and status from one test to another apart."""
    from radard.config.directories import own_folder

    own_folder.cache_clear()
    set_folders(monkeypatch, next(fresh_folders))


def set_folders(patch, folder):
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "NOTIFY_SOCKET", "WATCHDOG_USEC"):
        patch.delenv(name, raising=False)
    folder.mkdir()
    for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
        patch.setenv(name, str(folder))


@pytest.fixture
def golden(request):
    """Return what gives the rows of a file in tests/data; with --renew, today's are kept there."""

    def kept(name, rows):
        path = Path(__file__).parent / "data" / name
        if request.config.getoption("--renew"):
            path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        return [json.loads(line) for line in path.read_text().splitlines()]

    return kept


@pytest.fixture
def broker(tmp_path):
    """Start a real MQTT broker; a file with one of its own has that."""
    from tests.sink_helpers import MqttBroker

    made = MqttBroker(tmp_path)
    yield made
    made.stop()


@pytest.fixture
def listen(broker):
    """Return what listens to topics of the broker, until the end."""
    from tests.sink_helpers import Listener

    with contextlib.ExitStack() as stack:

        def begin(*topics):
            listener = Listener(broker.port, *topics)
            stack.callback(listener.close)
            return listener

        yield begin


@pytest.fixture
def server():
    """Start a real HTTP server that keeps what is posted."""
    from tests.sink_helpers import WebServer

    made = WebServer()
    yield made
    made.close()


@pytest.fixture
def launch(tmp_path, monkeypatch):
    """Return what starts daemons; all that still run end well with the test."""
    from tests.daemon_helpers import Daemon

    made = []

    def begin(**options):
        made.append(Daemon(tmp_path, monkeypatch, **options))
        return made[-1]

    yield begin
    results = [daemon.stop() for daemon in made if not daemon.is_stopped]
    assert results == [0] * len(results)


@pytest.fixture
def gate():
    """Return a door that a test puts before a method; it is open at the end."""
    from tests.daemon_helpers import Gate

    made = Gate()
    yield made
    made.open()
