"""radard setup --install and --uninstall: a whole installation in a folder that is a root."""

import json
import os
import re
import shutil
import stat

import pytest
import yaml

from radard.cli import main
from radard.commands.setup import files
from radard.commands.setup.command import COMMANDS, RECORD_FILE
from radard.config.config import Config, load_config

PROGRAM = "/opt/radard/bin/radard"


def installed(capsys, root, *argv):
    code = main(["setup", "--root", str(root), *argv])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


@pytest.fixture
def root(tmp_path):
    """A machine's root with an installation below /opt, and with folders of its own."""
    for folder in ("etc/udev/rules.d", "usr/local/bin", "opt/radard/bin", "var/lib"):
        (tmp_path / folder).mkdir(parents=True)
    for name in COMMANDS:
        program = tmp_path / "opt/radard/bin" / name
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
    return tmp_path


def tree(root):
    """What lies below a root: modes of folders, content of files, targets of links."""
    found = {}
    for path in sorted(root.rglob("*")):
        name = str(path.relative_to(root))
        if path.is_symlink():
            found[name] = str(path.readlink())
        else:
            found[name] = (
                path.read_bytes() if path.is_file() else stat.S_IMODE(path.stat().st_mode)
            )
    return found


def without_user(found):
    """Leave out what systemd-sysusers keeps for itself in etc/."""
    own = {f"etc/{name}" for name in ("passwd", "group", "shadow", "gshadow", ".pwd.lock")}
    return {name: what for name, what in found.items() if name.rstrip("-") not in own}


@pytest.mark.integration
def test_install_and_purge_leave_a_root_as_it_was(root, capsys):
    before = tree(root)
    out = installed(capsys, root, "--install", "--exec", PROGRAM)
    made = tree(root)
    assert set(made) > set(before)
    assert f"ExecStart={PROGRAM} --port /dev/x2radar".encode() in made[str(files.UNIT_FILE)]
    assert b"User=radard" in made[str(files.INSTANCE_FILE)]
    assert made[str(files.UDEV_FILE)] == files.udev_rules().encode()
    assert made["usr/local/bin/x2radar"] == "/opt/radard/bin/x2radar"
    assert made[str(files.STATE_FOLDER)] == 0o700
    for name in COMMANDS:
        assert f"usr/local/share/man/man1/{name}.1" in made
        assert f"usr/local/share/bash-completion/completions/{name}" in made
        assert f"usr/local/share/zsh/site-functions/_{name}" in made
    if shutil.which("systemctl"):
        wants = "etc/systemd/system/multi-user.target.wants/radard.service"
        assert made[wants].endswith("etc/systemd/system/radard.service")
    if shutil.which("systemd-sysusers"):
        assert "radard:x:" in (root / "etc/passwd").read_text()
        assert "radard" in (root / "etc/group").read_text().partition("dialout:")[2].split("\n")[0]
    assert "left to do" in out  # this is not the machine that runs
    # A second time changes nothing.
    installed(capsys, root, "--install", "--exec", PROGRAM)
    assert tree(root) == made
    installed(capsys, root, "--uninstall", "--purge")
    assert without_user(tree(root)) == without_user(before)
    if shutil.which("userdel") and os.geteuid() == 0:
        assert (
            not (root / "etc/passwd").exists() or "radard" not in (root / "etc/passwd").read_text()
        )


@pytest.mark.integration
def test_without_purge_state_and_changed_settings_stay(root, capsys):
    installed(capsys, root, "--install", "--exec", PROGRAM)
    config = root / "etc/radard/config.yaml"
    config.write_text(config.read_text() + "zones: {exclude: [[2.1, 2.6]]}\n")
    (root / files.STATE_FOLDER / "radar.calibration.json").write_text("{}")
    out = installed(capsys, root, "--uninstall")
    assert f"{config}: kept" in out
    assert config.exists()
    assert (root / files.STATE_FOLDER / "radar.calibration.json").exists()
    assert not (root / files.UNIT_FILE).exists()
    assert not (root / "usr/local/bin/radard").is_symlink()
    assert not (root / RECORD_FILE).exists()
    # And they are there again for the next installation.
    assert "stays as it is" in installed(capsys, root, "--install", "--exec", PROGRAM)
    assert "2.6" in config.read_text()


@pytest.mark.integration
def test_another_program_renews_the_unit_and_nobody_elses_file_is_lost(root, capsys):
    rules = root / files.UDEV_FILE
    rules.write_text("mine")
    (root / "usr/local/bin/radard").write_text("somebody else's")
    installed(capsys, root, "--install", "--exec", PROGRAM)
    assert rules.with_name(rules.name + ".old").read_text() == "mine"
    assert (root / "usr/local/bin/radard").read_text() == "somebody else's"
    shutil.copytree(root / "opt/radard", root / "opt/newer")
    installed(capsys, root, "--install", "--exec", "/opt/newer/bin/radard", "--port", "/dev/ttyS9")
    unit = (root / files.UNIT_FILE).read_text()
    assert "ExecStart=/opt/newer/bin/radard --port /dev/ttyS9 " in unit
    assert not (root / (str(files.UNIT_FILE) + ".old")).exists()
    installed(capsys, root, "--uninstall", "--purge")
    assert (root / "usr/local/bin/radard").read_text() == "somebody else's"


@pytest.mark.integration
def test_a_second_radar_has_its_own_configuration_and_folders(root, capsys):
    installed(capsys, root, "--install", "--exec", PROGRAM)
    first = (root / files.UNIT_FILE).read_text()
    installed(
        *(capsys, root, "--install", "--exec", PROGRAM),
        *("--name", "attic", "--port", "/dev/ttyACM1"),
    )
    assert (root / files.UNIT_FILE).read_text() == first
    config = load_config(root / "etc/radard/attic.yaml", environ={})
    assert (config.sensor.name, config.sensor.port) == ("attic", "/dev/ttyACM1")
    unit = (root / files.INSTANCE_FILE).read_text()
    assert "ExecStart=/opt/radard/bin/radard --wait --config /etc/radard/%i.yaml" in unit
    for key, folder in (
        ("StateDirectory=radard-%i", config.service.state_dir),
        ("RuntimeDirectory=radard-%i", config.service.runtime_dir),
    ):
        assert f"\n{key}\n" in unit
        assert folder.name == "radard-attic"
    assert (root / "var/lib/radard-attic").is_dir()
    record = json.loads((root / RECORD_FILE).read_text())
    assert record["units"] == ["radard.service", "radard@attic.service"]
    installed(capsys, root, "--uninstall", "--purge")
    assert not list((root / "var/lib").iterdir())


def test_the_first_configuration_is_valid_and_shows_all_that_can_be_set(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "first.yaml"
    path.write_text(files.first_config())
    config = load_config(path, environ={})
    assert config.output == ("http://127.0.0.1:8434",)
    # Every section, taken out of its comment, is the built-in configuration.
    _, _, lines = path.read_text().partition("# What can be set")
    path.write_text(re.sub(r"(?m)^#(?=[a-z]|  )", "", lines.partition("\n")[2]))
    assert set(yaml.safe_load(path.read_text())) == set(Config.model_fields)
    assert load_config(path, environ={}) == Config()


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--install", "--uninstall"], "give --install, --uninstall, or one of"),
        (["--install", "--exec", "/opt/none/radard"], "no such program"),
        (["--install", "--exec", "/home/me/radard"], "a service does not see home folders"),
        (["--install", "--exec", PROGRAM, "--name", "../x"], "must be letters, digits"),
        (["--uninstall"], "nothing that radard setup --install has made"),
    ],
)
def test_what_cannot_be_installed_is_one_line(root, argv, words, capsys):
    home = root / "home/me"
    home.mkdir(parents=True)
    shutil.copy(root / "opt/radard/bin/radard", home)
    before = tree(root)
    try:
        ended = main(["setup", "--root", str(root), *argv])
    except SystemExit as stop:
        ended = stop.code
    err = capsys.readouterr().err
    assert (ended, err.count("\n")) == (2, 1)
    assert words in err
    assert tree(root) == before


@pytest.mark.parametrize(
    "text", ["", "[]", '{"files": {"/etc/passwd": ""}}', '{"links": {"../x": ""}}']
)
def test_a_damaged_record_removes_nothing(root, text, capsys):
    (root / RECORD_FILE).parent.mkdir()
    (root / RECORD_FILE).write_text(text)
    before = tree(root)
    assert main(["setup", "--uninstall", "--purge", "--root", str(root)]) == 78
    assert "is no record of an installation" in capsys.readouterr().err
    assert tree(root) == before


def test_a_package_needs_no_installation(root, capsys):
    unit = root / "usr/lib/systemd/system/radard.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("")
    assert main(["setup", "--install", "--root", str(root), "--exec", PROGRAM]) == 2
    assert "installed as a package" in capsys.readouterr().err
