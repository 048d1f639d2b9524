"""`x2radar plot` and the maps that it draws."""

import numpy as np
import pytest

from tests.recording_helpers import make
from tests.sim_helpers import axis_with
from x2radar import maps
from x2radar.cli import main
from x2radar.commands.plot import filled
from x2radar.errors import SettingsError

AXIS = axis_with("baseband", 80, 0.04, 0.5, bandwidth_hz=1.75e9, sample_rate_hz=0.0)


def walker(speed_mps, n=180, axis=AXIS, rate_hz=60.0):
    """A point that approaches, as RF or baseband, on top of a strong still echo."""
    rng = np.random.default_rng(3)
    range_m = 3.4 - speed_mps * np.arange(n) / rate_hz
    away_m = axis.range_m - range_m[:, None]
    pulse = np.exp(-((away_m / 0.06) ** 2))
    turns = 2 * axis.carrier_hz / 299792458.0
    if axis.kind == "rf":
        rows = pulse * np.cos(2 * np.pi * turns * away_m) + 50 * np.cos(axis.range_m)
        return (rows + 0.01 * rng.standard_normal(rows.shape)).astype(np.float32)
    rows = pulse * np.exp(-2j * np.pi * turns * range_m)[:, None] + 50
    return (rows + 0.01 * rng.standard_normal(rows.shape)).astype(np.complex64)


RF_AXIS = axis_with("rf", 800, 0.004, 0.5, bandwidth_hz=1.75e9, sample_rate_hz=0.0)


@pytest.mark.parametrize("axis", [AXIS, RF_AXIS], ids=["baseband", "rf"])
@pytest.mark.parametrize("speed_mps", [-0.5, 0.4, 1.0])
def test_the_velocity_of_a_point_is_the_true_one(axis, speed_mps):
    """±0.66 m/s can be told apart at 60 frames a second: the band tells 1.0 from -0.32."""
    power, velocity_mps, t_s = maps.velocity_time(walker(speed_mps, axis=axis), axis, 60.0)
    assert power.shape == (len(velocity_mps), len(t_s))
    assert velocity_mps[power.mean(axis=1).argmax()] == pytest.approx(speed_mps, abs=0.06)


@pytest.mark.parametrize("axis", [AXIS, RF_AXIS], ids=["baseband", "rf"])
def test_the_range_of_a_point(axis):
    power, range_m, t_s = maps.range_time(walker(0.8, axis=axis), axis, 60.0)
    assert np.abs(range_m[power.argmax(axis=0)] - (3.4 - 0.8 * t_s)).max() < 0.12


def test_nothing_too_little_and_missing_frames():
    still = np.zeros((60, 80), np.complex64)
    for make_map in (maps.range_time, maps.velocity_time):
        assert not make_map(still, AXIS, 60.0)[0].any()
        with pytest.raises(SettingsError, match="20 frames: at least 28 are needed"):
            make_map(still[:20], AXIS, 60.0)
    # A missing frame repeats the one before.
    samples, n_lost = filled(np.array([[1], [2], [np.nan], [np.nan], [3]], np.float32))
    assert samples[:, 0].tolist() == [1, 2, 2, 2, 3]
    assert n_lost == 2


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_recording_is_drawn(tmp_path, capsys, suffix):
    source, _ = make(tmp_path / "in.h5", "rf", np.delete(np.arange(1, 200), [50, 51]))
    out = tmp_path / f"out{suffix}"
    assert main(["plot", str(source), "--out", str(out), "--start", "0.5", "--duration", "2"]) == 0
    data = out.read_bytes()
    assert suffix == ".svg" or data.startswith(b"\x89PNG")
    for words in (b"2 frames missing", b"power under the peak (dB)", b"may be aliases"):
        assert suffix == ".png" or words in data
    assert str(out) in capsys.readouterr().err


def test_a_port_is_drawn(tmp_path):
    out = tmp_path / "out.png"
    argv = ["plot", "sim:dog?seed=1&kind=baseband", "--duration", "1", "--out", str(out)]
    assert main(argv) == 0
    assert out.stat().st_size > 10_000
