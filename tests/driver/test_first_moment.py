"""Commands before their imports are done: signals, and standard streams that are closed."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import environ, hears_sigterm, ran, started
from tests.recording_helpers import record_scene
from tests.waiting import wait_for

pytestmark = pytest.mark.integration
RADARD = ("radard", "--port", "sim:empty", "--model", "none", "-o", "null")
ENDLESS = {"x2radar": ("x2radar", "simulate", "--pty"), "radard": RADARD}
ENDLESS["train-export"] = ("x2train", "dataset", "--out", "set")


@contextmanager
def signalled(number: int, pause_s: float, *argv: str, cwd: Path) -> Iterator[subprocess.Popen]:
    """A command that gets a signal so long after it could hear one."""
    process = started("-m", *argv, stdout=subprocess.DEVNULL, cwd=cwd)
    try:
        wait_for(lambda: hears_sigterm(process.pid))
        if (cwd / "numpy.py").exists():
            # As process 1 of a container it would miss what comes before its handlers.
            wait_for((cwd / "begun").exists)
        time.sleep(pause_s)
        process.send_signal(number)
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("prog", ENDLESS)
def test_signals_are_obeyed_from_the_first_moment_on(prog, number, tmp_path):
    """Each moment alone: while numpy is loaded, and the command's own modules, and later."""
    for pause_s in (0.0, 0.1, 0.3, 0.6, 1.0):
        with signalled(number, pause_s, *ENDLESS[prog], cwd=tmp_path) as process:
            err = process.communicate(timeout=60)[1]
        assert (pause_s, process.returncode, err) == (pause_s, 0, b"")
    # Found before the real one, and never loaded.
    slow = "import pathlib, time\npathlib.Path('begun').touch()\ntime.sleep(120)\n"
    (tmp_path / "numpy.py").write_text(slow)
    with signalled(number, 0.0, *ENDLESS[prog], cwd=tmp_path) as process:
        assert (process.communicate(timeout=60)[1], process.returncode) == (b"", 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_where_python_drops_it_is_not_lost_and_where_processes_start_it_waits(number):
    """During an import it once met the callback of a lock, and the daemon ran on.

    A process that was half started said EOFError; any thread may get what is blocked.
    """
    code = f"""
        import _thread, signal, time, weakref
        from x2radar.interrupts import Interrupted, interrupts, without_interrupts

        class Dies:
            def __del__(self):
                signal.raise_signal({number:d})

        with interrupts():
            try:
                Dies()
                time.sleep(60)
            except Interrupted:
                pass
            try:
                kept = set()
                kept_by = weakref.ref(kept, lambda _gone: signal.raise_signal({number:d}))
                del kept
                time.sleep(60)
            except Interrupted:
                print("heard twice")
            try:
                with without_interrupts():
                    with without_interrupts():
                        _thread.interrupt_main({number:d})
                        time.sleep(0.05)
                    print("started")
                time.sleep(60)
            except Interrupted:
                print("heard")
            try:
                signal.raise_signal({number:d})
            except Interrupted:
                print("and at once")
    """
    done = ran("-c", textwrap.dedent(code), timeout=60)
    assert (done.stdout, done.stderr) == ("heard twice\nstarted\nheard\nand at once\n", "")


def test_what_a_handler_asks_for_is_never_waited_for_in_the_handler():
    """With a plain Event a daemon under load did not end on SIGTERM."""
    code = """
        import contextlib, signal
        from queue import Empty
        from radard.run.os_signals import Signals

        signals = Signals()
        signal.signal(signal.SIGALRM, lambda *_: signals.ask("dump"))
        for k in range(4000):
            signal.setitimer(signal.ITIMER_REAL, 1e-6 * (1 + k % 60))
            while not signals.take("dump"):
                with contextlib.suppress(Empty):
                    signals.wake.get(timeout=0.002)
        print("all heard")
    """
    assert ran("-c", textwrap.dedent(code), timeout=60).stdout == "all heard\n"


@pytest.mark.parametrize("package", ["x2radar", "radard", "x2train"])
def test_before_the_handlers_stand_next_to_nothing_is_loaded(package):
    """What a signal meets before them is a traceback, or nothing at all as process 1."""
    code = f"import sys, {package}.__main__ as main; print(*sys.modules)"
    loaded = set(ran("-S", "-c", code).stdout.split())
    assert "x2radar.startup" in loaded
    assert not loaded & {"typing", "re", "threading", "contextlib", "argparse", "x2radar.command"}


def shell(argv, redirect, folder, unbuffered="", limit="unlimited"):
    """What came of a command in a shell, with its streams and the size of its files as said."""
    line = f"ulimit -f {limit}; export PYTHONUNBUFFERED={unbuffered}; "
    line += f"exec {sys.executable} -m {' '.join(argv)} {redirect}"
    given = {"stderr": subprocess.PIPE, "cwd": folder, "timeout": 120}
    return subprocess.run(["/bin/sh", "-c", line], check=False, **given)


@pytest.mark.parametrize("closed", [">&-", "<&- >&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(
    "argv",
    [
        ("x2radar", "scenes"),
        ("x2radar", "info", "sim:empty", "--json"),
        ("x2train", "--help"),
        (*RADARD, "-o", "json", "--speed", "max", "--duration", "3"),
    ],
    ids=" ".join,
)
def test_standard_streams_that_are_closed_are_the_null_device(argv, closed, tmp_path):
    """Before, a traceback; and the next file that was opened took the number of stdout."""
    done = shell(argv, closed, tmp_path)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["SIGHUP", "SIGUSR1"])
def test_a_daemon_that_starts_is_not_ended_by_what_it_heeds_later(name, tmp_path):
    for pause_s in (0.0, 0.3, 0.7, 1.2):
        with signalled(getattr(signal, name), pause_s, *RADARD, "-v", cwd=tmp_path) as process:
            word = {"SIGHUP": b"reload: done", "SIGUSR1": b'state {"state"'}[name]
            said = b""
            while word not in said:
                line = process.stderr.readline()
                assert line, (pause_s, process.poll(), said)
                said += line
            process.terminate()
            assert process.wait(60) == 0


@pytest.mark.parametrize(
    "argv", [("x2radar", "scenes"), ("radard", "explain"), ("radard", "--version")]
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_stdout_that_is_full_is_one_line(argv, unbuffered, tmp_path):
    """Buffered, as anywhere but in a container, it was four lines and the exit code 120."""
    done = shell(argv, ">/dev/full", tmp_path, unbuffered)
    assert (done.returncode, done.stderr.count(b"\n")) == (1, 1)
    assert b"No space left on device" in done.stderr
    assert b"internal" not in done.stderr


def test_a_system_without_any_place_for_temporary_files_is_no_matter_of_a_simulation(tmp_path):
    """It took one for the name of a folder that it never makes; stdout was blamed."""
    argv = (*RADARD, "--speed", "max", "--duration", "3")
    done = shell(argv, ">/dev/null", tmp_path, limit=0)
    assert done.returncode == 0
    assert b"temporary" not in done.stderr


def test_an_exit_code_tells_what_went_wrong_also_where_nobody_can_be_told(tmp_path):
    for argv, code in ((("x2radar", "info", "gone.h5"), 66), (("radard", "--nope"), 2)):
        for unbuffered in ("", "1"):
            assert shell(argv, "2>/dev/full", tmp_path, unbuffered).returncode == code
    # A name of any bytes is printed.
    argv = [sys.executable, "-m", "x2radar", "info", b"\xff.x2cap"]
    done = subprocess.run(argv, capture_output=True, cwd=tmp_path, timeout=60, check=False)
    assert (done.returncode, done.stderr.count(b"\n")) == (66, 1)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-16"])
def test_a_locale_changes_nothing_of_what_is_printed(encoding, tmp_path):
    record_scene(tmp_path / "a.h5", "human", n=200)
    argv = ("-m", "radard", "why", tmp_path / "a.h5", "--at", "2.5")
    usual = ran(*argv, text=False)
    other = ran(*argv, text=False, env=environ(PYTHONIOENCODING=encoding))
    assert (other.returncode, other.stdout) == (0, usual.stdout)
    assert "\N{MINUS SIGN}".encode() in other.stdout


@pytest.mark.parametrize("name", [b"k\xfcche", b"a$\\x$b%20", "küche".encode()])
def test_recordings_whose_names_have_any_bytes_are_read_judged_and_drawn(name, tmp_path):
    record_scene(tmp_path / os.fsdecode(name + b".h5"), "human", n=200)
    for argv in (
        [b"x2radar", b"plot", name + b".h5", b"--out", name + b".png"],
        [b"radard", b"detect", name + b".h5", b"--model", b"none"],
        [b"radard", b"detect", name + b".h5", b"--model", b"none", b"--out", name + b".parquet"],
        [b"radard", b"why", name + b".h5", b"--at", b"2.5", b"--out", name + b".w.png"],
    ):
        command: list[bytes] = [os.fsencode(sys.executable), b"-m", *argv]
        done = subprocess.run(command, capture_output=True, cwd=tmp_path, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
