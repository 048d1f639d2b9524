"""What tests of the dashboard share: a browser, and a daemon before which somebody walks."""

import contextlib

import pytest

from tests.browser_helpers import CHROMIUM, Tab
from tests.dashboard_helpers import maker
from tests.web_helpers import Running

make = pytest.fixture(maker)


@pytest.fixture
def client(make):
    """A client of a dashboard that is asked without a network."""
    return make()


@pytest.fixture(scope="session")
def browser():
    why = "no playwright: pip install '.[browser]'"
    playwright = pytest.importorskip("playwright.sync_api", reason=why)
    with playwright.sync_playwright() as p:
        made = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield made
        made.close()


@pytest.fixture(scope="module")
def radard(tmp_path_factory):
    """A daemon before which somebody walks, fast, with a model that alarms."""
    folder = tmp_path_factory.mktemp("radard")
    given = {"LATCH_S": "600", "REFRACTORY_S": "0", "SENSITIVITY": "high"}
    environ = {f"RADARD_ALARM__{name}": value for name, value in given.items()}
    argv = ("--port", "sim:human?seed=1", "-o", f"store:{folder}/radard.db")
    running = Running(folder, *argv, environ=environ)
    running.wait_online()
    yield running
    running.end()


@pytest.fixture
def launched(tmp_path):
    """A function that starts daemons in processes of their own; all end with the test."""
    with contextlib.ExitStack() as stack:

        def start(*arguments, **options):
            running = Running(tmp_path, *arguments, **options)
            stack.callback(running.end)
            return running

        yield start


@pytest.fixture
def empty(launched):
    """A daemon before an empty room."""
    return launched("--port", "sim:empty", "--model", "none").wait_online()


@pytest.fixture
def tab(browser, request):
    """A function that opens tabs; each must end without complaints, unless it says so."""
    made = []

    def build(running=None, **options):
        running = running or request.getfixturevalue("radard")
        made.append(Tab(browser, running, **options))
        return made[-1]

    yield build
    for one in made:
        one.page.close()
        assert one.complaints == []


@pytest.fixture
def one(tab):
    """One tab, which shows the live page."""
    return tab().open()
