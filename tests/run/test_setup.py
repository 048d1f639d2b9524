"""radard setup: what it prints, installs below a root and takes away, and what a mount sees."""

import json
import os
import re
import shutil
import stat
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from radard.cli import main
from radard.commands.setup import files
from radard.commands.setup.command import COMMANDS, RECORD_FILE
from radard.commands.setup.coverage import CoverageOptions, snr_db
from radard.commands.setup.files import systemd_unit, udev_rules
from radard.config.config import Config, load_config
from radard.errors import UsageError
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import parse_scene

MOUNT = CoverageOptions(height_m=1.2, tilt_deg=0, width_deg=65, limit_db=10, rcs_m2=0.01)
PROGRAM = "/opt/radard/bin/radard"
ROOT = Path(__file__).parents[2]


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
        elif path.is_file():
            found[name] = path.read_bytes()
        else:
            found[name] = stat.S_IMODE(path.stat().st_mode)
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
        users = root / "etc/passwd"
        assert not users.exists() or "radard" not in users.read_text()


@pytest.mark.integration
def test_without_purge_state_and_changed_settings_stay(root, capsys):
    installed(capsys, root, "--install", "--exec", PROGRAM)
    config = root / "etc/radard/config.yaml"
    config.write_text(config.read_text() + "zones: {exclude: [[2.1, 2.6]]}\n")
    (root / files.STATE_FOLDER / "radar.calibration.json").write_text("{}")
    assert f"{config}: kept" in installed(capsys, root, "--uninstall")
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
    attic = ("--name", "attic", "--port", "/dev/ttyACM1")
    installed(capsys, root, "--install", "--exec", PROGRAM, *attic)
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
    assert load_config(path, environ={}).output == ("http://127.0.0.1:8434",)
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
        (["--install", "--exec", PROGRAM], "installed as a package"),
    ],
)
def test_what_cannot_be_installed_is_one_line(root, argv, words, capsys):
    home = root / "home/me"
    home.mkdir(parents=True)
    shutil.copy(root / "opt/radard/bin/radard", home)
    if "package" in words:
        unit = root / "usr/lib/systemd/system/radard.service"
        unit.parent.mkdir(parents=True)
        unit.touch()
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


def printed(capsys, *argv):
    assert main(["setup", *argv]) == 0
    return capsys.readouterr().out


def test_printed_files_are_those_of_deploy(capsys):
    assert printed(capsys, "udev") == (ROOT / "deploy/udev/60-x2radar.rules").read_text()
    unit = printed(capsys, "systemd", "--exec", "/opt/radard/bin/radard")
    assert unit == (ROOT / "deploy/systemd/radard.service").read_text()


def test_an_adapter_gets_a_rule_of_its_own_that_modem_manager_heeds():
    text = udev_rules("0403:6014", "FT1.A-2")
    rule = 'ATTRS{idVendor}=="0403", ATTRS{idProduct}=="6014", ATTRS{serial}=="FT1.A-2"'
    assert any(line.startswith(rule) for line in text.splitlines())
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in text
    assert text.index(rule) < text.index("ID_MM_DEVICE_IGNORE")


@pytest.mark.parametrize(
    ("usb", "serial", "word"),
    [
        ("0403:6014", None, "belong together"),
        (None, "A1", "belong together"),
        ("403:6014", "A1", "--usb '403:6014'"),
        ("0403:6014", 'A1", RUN+="/bin/sh', "--serial"),
        ("0403:6014", "A1\n", "--serial"),
    ],
)
def test_adapters_that_are_none(usb, serial, word):
    with pytest.raises(UsageError, match=word):
        udev_rules(usb, serial)


@pytest.mark.parametrize(
    ("program", "port", "line"),
    [
        (None, "/dev/x2radar", f"{sys.prefix}/bin/radard --port /dev/x2radar --wait"),
        ("/a b/radard", "x", '"/a b/radard" --port x --wait'),
        ("/r", "socket://h:1?rate=60", "/r --port socket://h:1?rate=60 --wait"),
        ("/r", "sim:100%", "/r --port sim:100%% --wait"),
        ("/r", 'a"b$c', '/r --port "a\\"b$$c" --wait'),
    ],
)
def test_unit_starts_what_was_named(program, port, line, capsys):
    named = ("--exec", program) if program else ()
    text = printed(capsys, "systemd", "--port", port, *named)
    starts = [each for each in text.splitlines() if each.startswith("ExecStart=")]
    assert starts == [f"ExecStart={line} --config /etc/radard/config.yaml"]


@pytest.mark.parametrize(("program", "port"), [("radard", "x"), ("/r", "x\nUser=root")])
def test_what_no_unit_can_hold(program, port):
    with pytest.raises(UsageError):
        systemd_unit(Path(program), port)


def test_install_without_the_right_to(tmp_path, monkeypatch, capsys):
    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "write_text", refuse)
    assert main(["setup", "udev", "--install", "--root", str(tmp_path)]) == 77
    assert "use sudo" in capsys.readouterr().err


def echo_db(height_m, z_m, y_m):
    """A still point's echo over the noise, as the simulated module shows both."""
    range_m = float(np.hypot(y_m, z_m - height_m))
    rcs_m2 = MOUNT.rcs_m2 * SEED_GAIN
    scene = f"steps: [{{duration_s: 60}}]\nclutter: [{{range_m: {range_m}, rcs_m2: {rcs_m2}}}]"
    settings = RadarSettings.for_frame_rate(60, output="iq")
    stream = EchoStream(parse_scene(scene, "point", "point"), 0, settings)
    frames = np.array([stream.next() for _ in range(200)])
    k = int(np.argmin(abs(stream.axis.range_m - range_m)))
    signal = abs(frames[:, k].mean()) ** 2
    return 10 * np.log10(signal / frames.var(axis=0).mean())


@pytest.mark.parametrize("y_m", [1.0, 2.0, 3.0])
def test_coverage_is_what_the_simulated_module_shows(y_m):
    assert snr_db(MOUNT, 0.0, y_m, 1.2) == pytest.approx(echo_db(1.2, 1.2, y_m), abs=1.5)
