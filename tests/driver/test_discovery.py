import json
import re

import pytest

from tests.device_helpers import plugged
from x2radar.cli import main
from x2radar.device import discovery
from x2radar.device.discovery import PortRow, find_module, list_ports, port_state
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.errors import PortNotFound
from x2radar.recording.hdf5_reader import RecordingReader

pytestmark = pytest.mark.integration


@pytest.fixture
def module():
    with plugged() as far:
        yield far


@pytest.fixture
def nobody():
    far = PtyTransport()
    yield far
    far.close()


@pytest.fixture
def found(monkeypatch):
    """What is found where there are ports of these paths."""

    def find(*paths):
        monkeypatch.setattr(discovery, "list_ports", lambda: [PortRow(path) for path in paths])
        return find_module()

    return find


def test_a_module_answers_and_nobody_does_not(module, nobody, found):
    assert port_state(module.path) == (True, "ready")
    assert port_state(nobody.path) == (False, "silent")
    assert found(nobody.path, module.path, "/dev/rfcomm0") == module.path


def test_none_several_and_busy_ports_are_named(module, nobody, found):
    with pytest.raises(PortNotFound, match="there is no serial port"):
        found("/dev/rfcomm0")
    with pytest.raises(PortNotFound, match=rf"asked: {nobody.path} \(silent\)"):
        found(nobody.path)
    with plugged() as other, pytest.raises(PortNotFound, match="several modules answer"):
        found(module.path, other.path)
    held = SerialTransport(module.path)
    with pytest.raises(PortNotFound, match="in use"):
        found(module.path)
    held.close()
    with pytest.raises(PortNotFound, match="gone"):
        found("/dev/ttyNONE")


def test_ports_command(capsys):
    assert main(["ports", "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["path"] for row in rows] == [row.path for row in list_ports()]
    assert main(["ports"]) == 0


def test_selftest_reports_and_records(tmp_path, capsys):
    out = tmp_path / "mine.h5"
    argv = ["selftest", "--port", "sim:empty", "--duration", "1.2"]
    assert main([*argv, "--json", "--out", str(out)]) == 0
    report = json.loads(capsys.readouterr().out)
    # On a busy machine frames come in bursts, at another rate, some behind the last one asked for.
    assert report["figures"]["frames"] >= 72
    assert report["figures"]["noise_sigma"] == pytest.approx(0.04, rel=0.05)
    assert 30 < report["figures"]["frame_rate_reached_hz"] < 120
    assert report["info"]["order_code"] == "X2M-SIM"
    assert {v["about"] for v in report["verdicts"] if v["level"] == "fail"} <= {"rate"}
    assert RecordingReader(out).n_frames == 72
    assert main([*argv, "--out", str(out)]) == 66
    assert "never overwritten" in capsys.readouterr().err


def test_selftest_says_what_is_wrong(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    port = "sim:empty?fault=drop_frames:0.2,spike:0.1,junk:0.1"
    assert main(["selftest", "--port", port, "--duration", "1.5"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"WARN spikes +[1-9]\d* samples", text)
    for words in ("FAIL", "frames lost", "damaged stretches"):
        assert words in text
    assert RecordingReader(next(tmp_path.glob("x2radar-selftest-*.h5"))).n_frames
