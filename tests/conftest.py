"""Settings of all tests: the same on any machine and however they were started."""

import itertools
import signal

import pytest
from hypothesis import HealthCheck, settings

from tests.busy_machine import allow_for_it

settings.register_profile(
    "fixed",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("fixed")


def pytest_configure():
    """Give tests and the processes that they start a Ctrl-C; a shell's background ignores it."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


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
def own_folders(nobodys_folders, fresh_folders, monkeypatch):
    """Keep the daemon's state and status from one test to another apart."""
    set_folders(monkeypatch, next(fresh_folders))


def set_folders(patch, folder):
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "NOTIFY_SOCKET", "WATCHDOG_USEC"):
        patch.delenv(name, raising=False)
    folder.mkdir()
    for name in ("XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
        patch.setenv(name, str(folder))
