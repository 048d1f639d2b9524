"""What a user is told whose installation lacks an extra, and where the dashboard listens."""

import socket

import pytest

from tests.processes import ran
from tests.radar_helpers import run_radard
from tests.waiting import free_port

pytestmark = pytest.mark.integration


@pytest.mark.parametrize(
    ("module", "prog", "missing", "extra"),
    [
        ("radard", "radard", "pydantic", "daemon"),
        ("x2train", "train-export", "rich", "train"),
        ("x2train", "train-export", "pydantic", "train"),
    ],
)
def test_a_missing_extra_is_one_line_that_names_it(module, prog, missing, extra):
    code = (
        f"import sys; sys.modules[{missing!r}] = None; sys.argv = [{prog!r}, '--help']; "
        f"from {module}.__main__ import main; sys.exit(main())"
    )
    done = ran("-c", code)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        f"{prog}: needs {missing}, which is not installed: "
        f"pip install 'uwb-radar-alarm[{extra}]'\n"
    )


def test_a_module_of_our_own_that_is_missing_is_a_fault():
    code = (
        "import sys; sys.modules['radard.config.options'] = None; sys.argv = ['radard']; "
        "from radard.__main__ import main; main()"
    )
    done = ran("-c", code)
    assert "internal error: ModuleNotFoundError" in done.stderr


def test_the_dashboard_is_named_once_it_listens_and_not_before():
    argv = ("--port", "sim:empty", "--speed", "max", "--duration", "3", "-o", "null")
    port = free_port()
    assert f"http://127.0.0.1:{port}/" in run_radard(*argv, "-o", f"http://127.0.0.1:{port}")[2]
    assert run_radard(*argv, "-q", "-o", f"http://127.0.0.1:{port}")[2] == ""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        said = run_radard(*argv, "-o", f"http://127.0.0.1:{port}")[2]
    assert "cannot listen" in said
    assert "listening at" not in said
