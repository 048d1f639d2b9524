import numpy as np
import pytest

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.errors import FeatureError
from tests.radar_helpers import noise, walker


def test_cadence_line_of_a_known_gait():
    t = np.arange(120) / 60
    mu = np.zeros((28, 120), np.float32)
    mu[20] = 1 + np.cos(2 * np.pi * 2.0 * t)
    diagram = cadence_velocity_diagram(mu)
    assert diagram[20, 1:60].argmax() + 1 == 4  # 2 Hz in steps of 0.5 Hz
    assert diagram[20, 0] == pytest.approx(120, rel=1e-5)
    assert not diagram[:20].any()


def test_type1_is_column_by_column_and_of_unit_norm_over_the_whole():
    diagram = np.arange(1, 28 * 120 + 1, dtype=np.float32).reshape(28, 120)
    vector = type1_vector(diagram, 28)
    norm = np.linalg.norm(diagram.astype(np.float64))
    assert vector.shape == (784,)
    assert vector[:28] == pytest.approx(diagram[:, 0] / norm)
    assert vector[28] == pytest.approx(diagram[0, 1] / norm)
    assert np.linalg.norm(type1_vector(diagram, 120)) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("n", [0, 121])
def test_type1_refuses(n):
    with pytest.raises(FeatureError, match="n_cadence"):
        type1_vector(np.zeros((28, 120), np.float32), n)


def test_extent_spans_both_scatterers_at_their_widest():
    near = walker(147, 60, speed_mps=0.3, start_m=1.4, level=1)
    far = walker(147, 60, speed_mps=0.0, start_m=2.0, level=1)
    swing = np.exp(1j * np.pi * np.arange(147))[:, None]
    frames = (near + far * swing).astype(np.complex64)
    profile = extent_profile(frames, 28, 64, least_sar=2)
    used = np.flatnonzero(profile)
    # Furthest apart in the last CPI, whose centre is frame 133: from 1.4 m - 0.3 m/s * 2.22 s to
    # 2 m, and on both sides 57 mm more until |z|^2 has fallen to a fifth.
    assert used[0] == 0
    assert (used[-1] + 1) * 0.0293 == pytest.approx(2.0 - 0.735 + 2 * 0.057, abs=2 * 0.0293)
    assert profile.max() == pytest.approx(1)


def test_extent_is_cut_and_padded():
    frames = walker(147, 60, speed_mps=0.5, start_m=2, level=1)
    short = extent_profile(frames, 28, 2, least_sar=2)
    long = extent_profile(frames, 28, 500, least_sar=2)
    assert short.shape == (2,)
    assert long.shape == (500,)
    assert not long[64:].any()
    assert np.array_equal(short, long[:2])


@pytest.mark.parametrize("level", [0.0, 1e-30, 1.0, 1e15])
def test_noise_and_silence_hold_no_target(level):
    frames = noise(147, 64, sigma=level) if level else np.zeros((147, 64), np.complex64)
    profile = extent_profile(frames, 28, 392)
    assert profile.shape == (392,)
    assert not profile.any()


@pytest.mark.parametrize("level", [1e-35, 1e-20, 1.0, 1e20, 1e35])
def test_diagram_and_vector_against_float64(level):
    mu = (np.random.default_rng(1).exponential(size=(28, 120)) * level).astype(np.float32)
    diagram = cadence_velocity_diagram(mu)
    wanted = np.abs(np.fft.fft(mu.astype(np.float64), axis=1))
    assert np.linalg.norm(diagram / level - wanted / level) < 1e-6 * np.linalg.norm(wanted / level)
    vector = type1_vector(diagram, 28)
    exact = (wanted[:, :28].T / np.linalg.norm(wanted / level) / level).ravel()
    assert np.linalg.norm(vector - exact) < 1e-6 * np.linalg.norm(exact)


def profile_in_float64(frames, n_cpi, n_profile):
    """The definition, frame by frame."""
    y = frames.astype(np.complex128)
    widest, best = 0, np.zeros(n_profile)
    for i in range(len(y) - n_cpi + 1):
        z = np.abs(y[i + n_cpi // 2] - y[i : i + n_cpi].mean(axis=0))
        power = (z / z.max()) ** 2
        sar = 1 / power.mean()
        at = np.flatnonzero(power > power.mean() * (1 + 0.2 * (sar - 1)))
        if sar >= 15 and at.size and at[-1] - at[0] + 1 > widest:
            widest = at[-1] - at[0] + 1
            best = np.zeros(n_profile)
            part = z[at[0] : at[-1] + 1][:n_profile] / z.max()
            best[: len(part)] = part
    return best


@pytest.mark.parametrize("exponent", [-140, -110, -60, 0, 60, 110])
@pytest.mark.parametrize("clutter_db", [0, 60])
def test_extent_profile_against_float64_at_any_level(exponent, clutter_db):
    frames = walker(147, 60, speed_mps=0.5, start_m=2, level=30)
    frames = frames + 30 * 10 ** (clutter_db / 20) * noise(1)[0]
    frames = np.ldexp(frames.astype(np.complex64).view(np.float32), exponent).view(np.complex64)
    wanted = profile_in_float64(
        np.ldexp(frames.view(np.float32).astype(float), -exponent).view(np.complex128), 28, 64
    )
    assert wanted.any()
    assert np.abs(extent_profile(frames, 28, 64) - wanted).max() < 1e-5
