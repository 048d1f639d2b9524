"""Files: written whole, for their owner alone, locked, and with or without a mark."""

import codecs
import errno
import json
import os

import numpy as np
import pytest

from radard import cli
from radard.config.config import load_config
from radard.config.credentials import redact
from radard.config.directories import _locked, lock_again, runtime_dir, state_lock
from radard.detect.calibration import Calibration, load_calibration
from radard.errors import ConfigError
from radard.judge.bundle import load_bundle, sidecar_path
from radard.log import EventLog
from radard.log_file import read_events
from radard.web.labels import FORMAT, read_labels
from tests.bodies.test_recorded import BVH
from tests.processes import started
from tests.sink_helpers import event
from x2radar.atomic import whole_file, write_atomically
from x2radar.sim.scene.scene import load_scene


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


def test_a_folder_that_is_made_anew_is_locked_again(tmp_path):
    """Before, a second daemon began there, and both wrote into one log without a word."""
    folder = tmp_path / "state"
    config = configured(folder)
    with state_lock(config):
        log = EventLog(folder / "log.db", lock=lock_again)
        folder.rename(tmp_path / "away")
        log.append(event())
        with pytest.raises(ConfigError, match="another radard"), state_lock(config):
            pass
        folder.rename(tmp_path / "away again")
        # As another process does.
        other = _locked(folder)
        log.append(event(2))
        assert "another radard" in log.fault
        os.close(other)
        log.close()
    assert [each.phase for each in read_events(folder / "log.db")] == ["new", "new"]


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


def test_a_file_and_its_folder_are_made_for_those_who_may_read_them(tmp_path):
    path = tmp_path / "deep" / "file"
    write_atomically(path, "\u00e9\n", mode=0o600)
    assert path.read_bytes() == b"\xc3\xa9\n"
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    write_atomically(path, b"new", sync=False)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_disk_that_takes_nothing_leaves_what_was_there(call, tmp_path, monkeypatch):
    path = tmp_path / "file"
    write_atomically(path, "old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, call) if call == "fsync" else (type(path), call)), full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_link_stays_a_link_and_leads_to_the_new_file(tmp_path):
    """As of a setting that lies on another disk; before, the link was replaced."""
    (tmp_path / "disk").mkdir()
    link = tmp_path / "file"
    link.symlink_to("disk/kept")
    for text in ("new", "newer"):
        write_atomically(link, text)
        assert (link.is_symlink(), (tmp_path / "disk" / "kept").read_text()) == (True, text)
    assert [each.name for each in (tmp_path / "disk").iterdir()] == ["kept"]


def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path):
    """Before, root lost /dev/null to a file of that name."""
    pipe = tmp_path / "null"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDWR)
    try:
        write_atomically(pipe, "text")
        with whole_file(pipe) as lent:
            assert lent == pipe
        assert (os.read(end, 99), pipe.is_fifo()) == (b"text", True)
    finally:
        os.close(end)


def test_a_file_in_the_way_of_the_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"."):
        write_atomically(tmp_path / "file" / "x", "x")


LABEL = {"format": FORMAT, "format_version": 1, "event": 26 * "0", "label": "pet", "kind": "fault"}
NUMBERS = {"frame_rate_hz": 60.0, "bin_length_m": 0.03, "range_offset_m": 0.6}
CALIBRATION = Calibration(**NUMBERS, floor=np.full(1, 1e-6), threshold_db=np.full(1, 9.0))


def finetune_labels(path):
    from x2train.finetune.own_clips import labelled_clips

    return labelled_clips(path)


def labelled(path):
    from x2train.judge.judging import read_list

    return read_list(path)


def motions(path):
    from x2train.motion.formats import read_motions

    return [motion.position.tolist() for motion in read_motions(path)]


def bundle(path):
    path.with_suffix(".onnx").write_bytes(sidecar_path("fast").with_suffix(".onnx").read_bytes())
    return load_bundle(str(path))


READERS = {
    "scene.yaml": (lambda p: load_scene(str(p)).steps, "steps: [{duration_s: 3}]\n"),
    "radard.yaml": (load_config, "alarm: {latch_s: 3}\n"),
    "labels.jsonl": (read_labels, json.dumps(LABEL) + "\n"),
    "own.jsonl": (finetune_labels, json.dumps(LABEL) + "\n"),
    "list.csv": (labelled, "file,start,end,label\na.h5,1,2,pet\n"),
    "list.yaml": (labelled, "- {file: a.h5, label: pet}\n"),
    "walk.bvh": (motions, BVH),
    "room.json": (lambda p: load_calibration(p).text(), CALIBRATION.text()),
    "fast.json": (bundle, sidecar_path("fast").read_text(encoding="utf-8")),
}


@pytest.mark.parametrize("name", READERS)
def test_a_mark_changes_nothing(name, tmp_path):
    read, text = READERS[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    plain = read(path)
    assert plain
    path.write_bytes(codecs.BOM_UTF8 + text.encode())
    assert read(path) == plain
