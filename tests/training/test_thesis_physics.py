"""The thesis' physics, from the element's end.

Proven elsewhere, and not again here: down-converted RF against the analytic baseband form,
Doppler of a constant velocity, blind speed, aliasing (test_sim_receiver); mu against a float64
direct sum (test_doppler); the taper's ends and range-Doppler (test_doppler); the bodies'
tables and draws (test_sim_motion); the receiver's noise (test_sim_receiver); D's line of a
synthetic spectrogram (test_cadence).
"""

import numpy as np
import pytest

from radard.dsp.cadence import cadence_velocity_diagram
from radard.dsp.doppler import micro_doppler
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import Scatterer
from x2radar.sim.signal.pulse import BOLTZMANN, LinkBudget, baseband_noise_power
from x2train.thesis import elements
from x2train.thesis.elements import ElementSpec, dwell

pytestmark = pytest.mark.integration

LAMBDA_M = 299_792_458.0 / 6.8e9
FS_HZ = 41e9
RATES = (60, 200)


@pytest.fixture
def body(monkeypatch):
    """Put a body of our own, without variation, in the place of the human."""

    def put(*points):
        monkeypatch.setattr(elements, "THESIS_BODIES", {"thesis_human": points})
        monkeypatch.setattr(elements, "draw", lambda given, _: given)

    return put


def point(y_m, *, vy_mps=0.0, gait_hz=0.0, swing_m=0.0, rcs_m2=1e4):
    return Scatterer(0, y_m, 0, vy_mps, gait_hz, 0, swing_m, 0, rcs_m2)


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("noise", elements.NOISES)
def test_noise_is_that_of_the_link_budget_at_every_rate(body, rate_hz, noise):
    body(point(30.0))  # out of the swath
    spec = ElementSpec(frame_rate_hz=rate_hz, noise=noise)
    frames = dwell(spec, "human", 0)[0].frames.astype(np.complex128)
    wanted = baseband_noise_power(RadarSettings().axis, spec.budget.noise_sigma)
    assert np.mean(np.abs(frames[:, 50:-50]) ** 2) == pytest.approx(wanted, rel=0.03)


@pytest.mark.parametrize("range_m", [1.0, 2.0, 3.2])
def test_level_of_an_echo_is_the_radar_equations(body, range_m):
    """Signal over noise at the sampler: (2.11) over k (TA + TRx) fs, by hand."""
    body(point(range_m))
    made = dwell(ElementSpec(), "human", 0)[0]
    peak = np.abs(made.frames.astype(np.complex128).mean(axis=0)).max()
    gain = 10**0.4
    received_w = 1e-3 * gain**2 * LAMBDA_M**2 * 1e4 / ((4 * np.pi) ** 3 * range_m**4)
    noise_w = BOLTZMANN * 290 * 10**1.3 * FS_HZ
    sigma = LinkBudget().noise_sigma
    assert peak**2 / 2 / sigma**2 == pytest.approx(received_w / noise_w, rel=0.03)
    assert made.axis.range_m[np.abs(made.frames[0]).argmax()] == pytest.approx(range_m, abs=0.02)


def test_noise_as_printed_is_what_the_printed_equations_say():
    """(2.13) divides TRx by the gain, (2.12) multiplies amplitude with it: 18.4 dB in all."""
    better = ElementSpec().budget.noise_figure / ElementSpec(noise="printed").budget.noise_figure
    te = 290 + (10**1.3 - 1) * 290 / 10
    assert better == pytest.approx(10 * 290 * 10**1.3 / te)
    assert 10 * np.log10(better) == pytest.approx(18.4, abs=0.1)


@pytest.mark.parametrize("rate_hz", RATES)
@pytest.mark.parametrize("gait_hz", [1.0, 1.5, 2.5])
def test_cadence_line_of_a_known_gait(body, rate_hz, gait_hz):
    """A swing runs through every velocity once a period: D has lines at its multiples only."""
    body(point(2.0, gait_hz=gait_hz, swing_m=0.02))
    mu = micro_doppler(dwell(ElementSpec(frame_rate_hz=rate_hz), "human", 0)[0].frames, 28)
    lines = cadence_velocity_diagram(mu)[:, :28].sum(axis=0)
    every = round(2 * gait_hz)  # columns are 0.5 Hz apart
    on = np.arange(1, 28) % every == 0
    assert lines[1:][on].max() > 10 * lines[1:][~on].max()
    fastest = cadence_velocity_diagram(mu)[[13, 15]].sum(axis=0)  # off the turning points
    assert fastest[1:28].argmax() + 1 in {every, 2 * every}
