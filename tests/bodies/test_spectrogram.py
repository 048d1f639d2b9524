"""What a spectrogram of a built-in walker shows, against what is known of people's.

Made at 500 frames a second, where nothing aliases, without room and noise.
"""

import numpy as np
import pytest

from radard.dsp.doppler import micro_doppler, velocity_mps
from tests.sim_helpers import axis_with
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.person import draw_person
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.antenna import Antenna

RATE_HZ, N_CPI = 500.0, 64
X2 = RadarSettings()
AXIS = axis_with("baseband", 400, 8 * X2.axis.bin_length_m, 1.0)


def spectrogram(speed_mps, seed):
    """Power by velocity and time of somebody who comes, velocities, steps a second."""
    rng = np.random.default_rng(seed)
    person = draw_person(rng, path=[(0, 14), (0, 1)], speed_mps=speed_mps, total_rcs_dbsm=0.0)
    t_s = 2.5 + np.arange(round(4.5 * RATE_HZ)) / RATE_HZ
    antenna = Antenna(height_m=1.0, shape="isotropic")
    rows = antenna.direct(person.at(t_s, antenna.position_m))
    frames = echo_frames(rows.range_m, rows.root_rcs_m, AXIS)
    strides = person.motion.feet.clock.at(t_s[[0, -1]])
    power = micro_doppler(frames, N_CPI)
    steps_hz = 2 * np.diff(strides)[0] / np.diff(t_s[[0, -1]])[0]
    return power, velocity_mps(N_CPI, RATE_HZ, AXIS.carrier_hz), steps_hz


def strongest_hz(x):
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)), 2**15))
    frequency = np.fft.rfftfreq(2**15, 1 / RATE_HZ)
    part = (frequency > 0.8) & (frequency < 4)
    return frequency[part][spectrum[part].argmax()]


@pytest.mark.parametrize("speed", [0.8, 1.2, 1.6])
def test_torso_line_and_limb_envelope(speed):
    lines, peaks = [], []
    for seed in range(3):
        power, v, steps_hz = spectrogram(speed, seed)
        trunk = np.abs(v - speed) < 0.5 * speed
        line = v[trunk] @ power[trunk] / power[trunk].sum(axis=0)
        is_limb = power > power.max(axis=0) * 10**-2.5
        envelope = np.where(is_limb, v[:, None], -np.inf).max(axis=0)
        # A leg swings forward once a step; 4.5 s resolve 0.2 Hz.
        assert strongest_hz(envelope) == pytest.approx(steps_hz, rel=0.04)
        assert line.mean() == pytest.approx(speed, rel=0.1)
        lines.append(np.quantile(line, [0.05, 0.95]) / speed)
        peaks.append(np.quantile(envelope, 0.95) / speed)
    low, high = np.mean(lines, axis=0)
    assert 0.7 < low < 0.95
    assert 1.02 < high < 1.3
    # Ankles reach 2.7 to 3.5 times the walking speed, toes up to 4.5 times.
    assert 2.7 < np.mean(peaks) < 4.5
