import numpy as np
import pytest

from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.doppler import micro_doppler
from radard.errors import FeatureError, ModelMismatch
from radard.judge.features import FEATURES, FeatureSettings, FeatureStream, extract, feature_shape
from tests.radar_helpers import BASEBAND, copy_ring, dwell_of, dwells_in, lossy, noise, walker

SETTINGS = FeatureSettings(n_profile=64)


def test_shapes_are_as_announced():
    dwell = dwell_of(noise(147) + walker(147, 60, speed_mps=0.5, start_m=2, level=30))
    made = extract(dwell, SETTINGS, FEATURES)
    kept = {name: array.copy() for name, array in made.items()}
    for name, array in made.items():
        assert array.shape == feature_shape(name, SETTINGS)
        assert array.dtype == np.float32
    assert feature_shape("thesis_type1", FeatureSettings()) == (784,)
    assert feature_shape("thesis_type2", FeatureSettings()) == (1176,)
    # Type 2 is the profile, then type 1.
    assert np.array_equal(made["thesis_type2"][64:], made["thesis_type1"])
    # They own their memory.
    dwell.frames[:] = 0
    for name, array in made.items():
        assert np.array_equal(array, kept[name])


@pytest.mark.parametrize("lost", [[0], [146], [60, 61], [20, 90]])
def test_lost_frames_hardly_move_the_features(lost):
    frames = noise(147) + walker(147, 60, speed_mps=0.5, start_m=2, level=30)
    masked = extract(dwell_of(frames, lost=lost), SETTINGS, ("thesis_type1",))["thesis_type1"]
    # Columns that a lost frame touches take the mean of the others.
    mu = micro_doppler(frames, 28)
    touched = [i for i in range(120) if any(i <= k < i + 28 for k in lost)]
    mu[:, touched] = np.delete(mu, touched, axis=1).mean(axis=1, keepdims=True)
    wanted = type1_vector(cadence_velocity_diagram(mu), SETTINGS.n_cadence)
    assert np.linalg.norm(masked - wanted) < 1e-5


@pytest.mark.parametrize(
    ("made", "same"),
    [
        ({"velocity_cpi_carrier_hz": BASEBAND.carrier_hz}, 0.2),
        ({"velocity_cpi_carrier_hz": 2 * BASEBAND.carrier_hz}, 0.4),
        ({"velocity_cpi_carrier_hz": BASEBAND.carrier_hz / 2}, 0.1),
        ({"velocity_cpi_frames": 12}, 0.2),
        ({"velocity_cpi_frames": 30}, 0.5),
        ({"velocity_cpi_frames": 9, "velocity_cpi_carrier_hz": BASEBAND.carrier_hz / 2}, 0.15),
    ],
)
def test_a_cpi_is_as_long_as_the_carrier_and_the_frames_ask_for(made, same):
    dwell = dwell_of(noise(147) + walker(147, 60, speed_mps=0.5, start_m=2, level=30))
    asked = FeatureSettings(velocity_cpi_s=0.2, **made)
    maps = [
        extract(dwell, settings, ("velocity_time",))["velocity_time"]
        for settings in (asked, FeatureSettings(velocity_cpi_s=same))
    ]
    assert np.array_equal(*maps)
    other = extract(dwell, FeatureSettings(velocity_cpi_s=0.3), ("velocity_time",))
    assert not np.array_equal(maps[0], other["velocity_time"])


def test_following_dwells_give_what_single_ones_give():
    frames = noise(400) + walker(400, 60, speed_mps=0.5, start_m=3.5, level=30)
    stream, ring = FeatureStream(SETTINGS, FEATURES), copy_ring(147, 60.0)
    n_dwells = 0
    for n_dwells, dwell in enumerate(dwells_in(ring, lossy(frames, {170, 250})), 1):
        if n_dwells == 3:
            continue  # as while the gate is closed
        alone = extract(dwell, SETTINGS, FEATURES)
        for name, values in stream.extract(dwell).items():
            assert np.linalg.norm(values - alone[name]) <= 2e-6 * np.linalg.norm(values)
    assert n_dwells == 5


def test_what_cannot_be_made_is_named():
    with pytest.raises(FeatureError, match="cannot fill a CPI"):
        extract(dwell_of(noise(20)), SETTINGS, ())
    for n in (0, 121):
        with pytest.raises(FeatureError, match="n_cadence"):
            type1_vector(np.zeros((28, 120), np.float32), n)
    for raw in ({"n_cpis": 3}, {"n_cpi": 2.5}, {"n_cpi": True}, {"dwell_s": "x"}):
        with pytest.raises(ModelMismatch, match="features"):
            FeatureSettings.from_mapping(raw)


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
