"""Elements of the thesis: the same from seed to set, and the physics in them."""

import os
from dataclasses import replace

import numpy as np
import pytest

from radard.dsp.cadence import cadence_velocity_diagram
from radard.dsp.doppler import micro_doppler
from radard.errors import UsageError
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import Scatterer
from x2radar.sim.signal.pulse import BOLTZMANN, LinkBudget, baseband_noise_power
from x2train.sets.workers import Crew
from x2train.thesis import elements, sets
from x2train.thesis.elements import PROFILE, ElementSpec, dwell, element
from x2train.thesis.sets import Cell, load_cell, load_maps, make_bodies, rectify

pytestmark = pytest.mark.integration

SPEC = ElementSpec(dwell_s=1.0)
CELL = Cell(2, "dog", 60)


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(sets, "_SHARD", 3)


def make(folder, spec=SPEC, first=0, n=5, workers=1):
    for body in ("dog", "human"):
        told = []

        def tell(*now, told=told):
            told.append(now)

        make_bodies(folder, spec, body, first, n, crew=Crew(workers, report=tell))
        assert told[-1] == (n, n)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"n_cpi": 1}, "M = 1: must be 2 to 120"),
        ({"n_cpi": 121}, "M = 121: must be 2 to 120, the columns of the record"),
        ({"n_cadence": 61}, "I alpha = 61: must be 1 to 60, half the columns"),
        ({"n_cadence": 0}, "I alpha = 0"),
        ({"frame_rate_hz": 0}, "frame rate 0: must be 1 to 1000"),
        ({"frame_rate_hz": 1001}, "frame rate 1001"),
        ({"dwell_s": 0.1}, "M = 28: must be 2 to 6"),
    ],
)
def test_what_makes_no_vector_is_refused(wrong, says):
    with pytest.raises(UsageError, match=says):
        ElementSpec(**wrong)


def test_an_element_follows_from_its_seed_body_and_number():
    one, again = element(SPEC, "cat", 7), element(SPEC, "cat", 7)
    np.testing.assert_equal(one, again)
    for other in [(SPEC, "cat", 8), (SPEC, "dog", 7), (replace(SPEC, seed=1), "cat", 7)]:
        assert not np.array_equal(one["vector"], element(*other)["vector"])


def test_data_sets_alternate_and_do_not_depend_on_chunks_or_workers(tmp_path, monkeypatch):
    # Where linear algebra has several threads, as here, even one worker is a process.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    make(tmp_path / "a")
    # What comes in this process, as a training, has all threads again.
    assert not {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"} & os.environ.keys()
    whole = load_cell(tmp_path / "a", SPEC, CELL, 0, 10)
    assert whole.x.shape == (10, 1176)
    np.testing.assert_array_equal(whole.y, [0, 1] * 5)
    for k, body in ((4, "dog"), (5, "human")):
        np.testing.assert_allclose(whole.x[k], element(SPEC, body, 2)["vector"], atol=1e-6)
    monkeypatch.setattr(sets, "_SHARD", 2)
    make(tmp_path / "b", workers=2)
    other = load_cell(tmp_path / "b", SPEC, CELL, 0, 10)
    np.testing.assert_array_equal(whole.x, other.x)
    np.testing.assert_array_equal(whole.in_view, other.in_view)


def test_maps_are_kept_to_a_level(tmp_path):
    make(tmp_path)
    maps, data = load_maps(tmp_path, SPEC, CELL, 0, 10)
    wanted = element(SPEC, "human", 1)
    for name, values in maps.items():
        assert np.abs(values[3] - wanted[name]).max() <= 0.5 / 255 + 1e-6
    assert data.in_view[3] == wanted["in_view"]


def test_rectified_profiles_have_their_peak_on_the_left():
    x = np.zeros((3, 1176), np.float32)
    x[0, :5] = [0.2, 0, 0.3, 1, 0.5]
    x[1, :5] = [0.2, 1, 0.3, 0, 0.5]
    x[:, PROFILE:] = np.linspace(0, 1, 784)
    out = rectify(x)
    np.testing.assert_array_equal(out[0, :5], x[0, 4::-1])
    np.testing.assert_array_equal(out[1:], x[1:])
    np.testing.assert_array_equal(out[:, PROFILE:], x[:, PROFILE:])


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
@pytest.mark.parametrize("noise", ["input", "printed"])
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
    assert better == pytest.approx(10 * 290 * 10**1.3 / (290 + (10**1.3 - 1) * 290 / 10))
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
