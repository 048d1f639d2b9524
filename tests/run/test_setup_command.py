"""radard setup: what it prints, what it installs, what a mount sees."""

import sys
from pathlib import Path

import numpy as np
import pytest

from radard.cli import main
from radard.commands.setup.coverage import CoverageOptions, snr_db
from radard.commands.setup.files import systemd_unit, udev_rules
from radard.errors import UsageError
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import parse_scene

ROOT = Path(__file__).parents[2]


def printed(capsys, *argv):
    assert main(["setup", *argv]) == 0
    return capsys.readouterr().out


def test_printed_files_are_those_of_deploy(capsys):
    rules = printed(capsys, "udev")
    assert rules == (ROOT / "deploy/udev/60-x2radar.rules").read_text()
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
    rcs_m2 = CoverageOptions().rcs_m2 * SEED_GAIN
    scene = f"steps: [{{duration_s: 60}}]\nclutter: [{{range_m: {range_m}, rcs_m2: {rcs_m2}}}]"
    settings = RadarSettings.for_frame_rate(60, output="iq")
    stream = EchoStream(parse_scene(scene, "point", "point"), 0, settings)
    frames = np.array([stream.next() for _ in range(200)])
    k = int(np.argmin(abs(stream.axis.range_m - range_m)))
    signal = abs(frames[:, k].mean()) ** 2
    return 10 * np.log10(signal / frames.var(axis=0).mean())


@pytest.mark.parametrize("y_m", [1.0, 2.0, 3.0])
def test_coverage_is_what_the_simulated_module_shows(y_m):
    told = snr_db(CoverageOptions(height_m=1.2), 0.0, y_m, 1.2)
    assert told == pytest.approx(echo_db(1.2, 1.2, y_m), abs=1.5)
