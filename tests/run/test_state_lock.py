"""The state directory is one daemon's, the runtime directory one user's; passwords are hidden."""

import errno
import os

import pytest

from radard import cli
from radard.config.config import load_config
from radard.config.credentials import redact
from radard.config.directories import runtime_dir, state_lock
from radard.errors import ConfigError
from tests.processes import started


def configured(folder, port="/dev/ttyACM0", **more):
    options = {"sensor": {"port": port}, "service": {"state_dir": folder}, **more}
    return load_config(environ={}, options=options)


def test_a_second_daemon_on_one_state_directory_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "state"
    arguments = ["--port", "sim:empty", "--duration", "5", "--speed", "max", "--model", "none"]
    monkeypatch.setenv("RADARD_SERVICE__STATE_DIR", str(folder))
    with state_lock(configured(folder)):
        assert cli.main([*arguments, "-o", "null"]) == 78
        line, *more = capsys.readouterr().err.splitlines()
        assert not more
        assert str(folder) in line
        assert "another radard uses this state directory" in line
    assert cli.main([*arguments, "-o", "null"]) == 0


@pytest.mark.integration
def test_the_lock_ends_with_a_process_that_is_killed(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from radard.config.config import load_config;"
        "from radard.config.directories import state_lock\n"
        "options = {'sensor': {'port': '/dev/x'}, 'service': {'state_dir': Path(sys.argv[1])}}\n"
        "with state_lock(load_config(environ={}, options=options)):\n"
        "    print('held', flush=True); time.sleep(600)\n"
    )
    config = configured(tmp_path)
    with started("-c", code, tmp_path, cwd=tmp_path, stderr=None) as other:
        try:
            assert other.stdout.readline() == b"held\n"
            with pytest.raises(ConfigError, match="another radard"), state_lock(config):
                pass
        finally:
            other.kill()
    with state_lock(config):
        pass


def test_what_keeps_nothing_there_needs_no_lock(tmp_path):
    environ = {"XDG_STATE_HOME": str(tmp_path)}
    with state_lock(configured(tmp_path)):
        for config in (configured(tmp_path, "replay:x.h5"), configured(None, "sim:demo")):
            with state_lock(config, environ), state_lock(config, environ):
                pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_locked_ends_no_start(tmp_path, caplog, monkeypatch):
    (tmp_path / "file").touch()
    with state_lock(configured(tmp_path / "file")):
        pass
    assert "not locked against a second radard: File exists" in caplog.text

    def flock(*_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("radard.config.directories.fcntl.flock", flock)
    with state_lock(configured(tmp_path)):
        pass
    assert "Read-only file system" in caplog.text


@pytest.fixture
def temp(tmp_path, monkeypatch):
    monkeypatch.setattr("radard.config.directories.tempfile.gettempdir", lambda: str(tmp_path))
    return tmp_path / f"radard-{os.getuid()}"


def run_dir(tmp_path):
    config = load_config(environ={}, options={"service": {"state_dir": tmp_path / "state"}})
    return runtime_dir(config, {})


def test_the_runtime_directory_in_tmp_is_made_for_this_user_alone(temp, tmp_path):
    before = os.umask(0)
    try:
        assert run_dir(tmp_path) == temp
    finally:
        os.umask(before)
    assert temp.stat().st_mode & 0o777 == 0o700
    assert run_dir(tmp_path) == temp


@pytest.mark.parametrize("how", ["open to others", "a link", "another's", "a file"])
def test_a_runtime_directory_that_another_could_have_made_is_not_used(
    how, temp, tmp_path, monkeypatch
):
    if how == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        temp.symlink_to(tmp_path / "elsewhere")
    elif how == "a file":
        temp.touch(mode=0o600)
    else:
        temp.mkdir(mode=0o700)
        temp.chmod(0o755 if how == "open to others" else 0o700)
    if how == "another's":
        uid = os.getuid()
        temp.rename(temp.with_name(f"radard-{uid + 1}"))
        monkeypatch.setattr("radard.config.directories.os.getuid", lambda: uid + 1)
    assert run_dir(tmp_path) == tmp_path / "state" / "run"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("mqtt://u:pw@h:1883/a", "mqtt://u:***@h:1883/a"),
        ("mqtt://u:pa/ss@h/a", "mqtt://u:***@h/a"),
        ("mqtt://u:p@ss@h/a", "mqtt://u:***@h/a"),
        ("mqtt://u:p:a/s@s@h", "mqtt://u:***@h"),
        ("mqtt://me@home.example:pass@h", "mqtt://me@home.example:***@h"),
        ("mqtt://h:1883/a", "mqtt://h:1883/a"),
        ("mqtt://u@h/a", "mqtt://u@h/a"),
        ("http://127.0.0.1:8434 and me@h", "http://127.0.0.1:8434 and me@h"),
        ("webhook:http://h:1/x", "webhook:http://h:1/***"),
        ("apprise:tgram://pw:pw/pw?token=pw", "apprise:tgram://***"),
        ("exec:notify --key pw", "exec:notify ***"),
        ("webhook:http://u:pa/ss@h/x", "webhook:/***"),
        ("webhook:http://u:p@ss@h/x", "webhook:/***"),
    ],
)
def test_passwords_are_hidden_whatever_is_in_them(text, shown):
    assert redact(text) == shown
