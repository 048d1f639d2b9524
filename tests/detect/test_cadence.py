import numpy as np
import pytest

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.errors import FeatureError
from tests.radar_helpers import noise, walker


@pytest.mark.parametrize("n", [0, 121])
def test_type1_refuses(n):
    with pytest.raises(FeatureError, match="n_cadence"):
        type1_vector(np.zeros((28, 120), np.float32), n)


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
@pytest.mark.parametrize(("clutter_db", "n_profile"), [(0, 64), (60, 2), (60, 500)])
def test_extent_profile_against_float64_at_any_level(exponent, clutter_db, n_profile):
    frames = walker(147, 60, speed_mps=0.5, start_m=2, level=30)
    frames = frames + 30 * 10 ** (clutter_db / 20) * noise(1)[0]
    frames = np.ldexp(frames.astype(np.complex64).view(np.float32), exponent).view(np.complex64)
    wanted = profile_in_float64(
        np.ldexp(frames.view(np.float32).astype(float), -exponent).view(np.complex128),
        28,
        n_profile,
    )
    assert wanted.any()
    assert np.abs(extent_profile(frames, 28, n_profile) - wanted).max() < 1e-5
