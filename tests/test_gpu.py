"""Batches on a torch device against the NumPy tier and the daemon's features; on the CPU."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from radard.dsp.doppler import gaussian_taper, micro_doppler_direct
from tests.sim_helpers import axis_of
from x2radar.errors import SceneError
from x2radar.sim.echo import TIERS, noise_colour, spectrum
from x2train.gpu import BatchEcho
from x2train.gpu_features import BatchFeatures, MapSettings, feature_maps

C = 299_792_458.0
X2 = axis_of("baseband")
AXIS = replace(X2, n_range=96, bin_length_m=8 * X2.bin_length_m)
SETTINGS = MapSettings(60.0, n_cpi=28)


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def echo():
    return BatchEcho(AXIS)


@pytest.fixture(scope="module")
def features(echo):
    return BatchFeatures(echo.grid, AXIS.range_m, SETTINGS)


def scene(n_batch=4, n_slow=60, n_points=5, seed=0):
    """Points that walk through the middle of the swath."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(n_slow)[:, None] / 60
    speed = rng.uniform(-0.6, 0.6, (n_batch, 1, n_points))
    range_m = rng.uniform(1.7, 2.3, (n_batch, 1, n_points)) + speed * (t_s - t_s[-1] / 2)
    return range_m, rng.uniform(0.1, 1, range_m.shape)


def numpy_frames(range_m, amplitude, axis=AXIS, error_db=-80.0):
    make = TIERS["spectral"].frames
    return np.stack(
        [make(r, a, axis, error_db=error_db) for r, a in zip(range_m, amplitude, strict=True)]
    )


# ---------------------------------------------------------------- echoes


@pytest.mark.parametrize("phase_sign", [-1, 1])
@pytest.mark.parametrize("is_complex", [False, True])
def test_same_numbers_as_the_numpy_tier(phase_sign, is_complex):
    axis = replace(AXIS, phase_sign=phase_sign)
    range_m, amplitude = scene()
    rng = np.random.default_rng(1)
    range_m += rng.uniform(-1.5, 1.5, (4, 1, 5))  # some leave the swath
    if is_complex:
        amplitude = amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape))
    ours = BatchEcho(axis).frames(range_m, amplitude)
    assert ours.dtype == torch.complex64
    assert ours.shape == (4, 60, 96)
    level = np.abs(amplitude).sum(axis=2, keepdims=True)
    wanted = numpy_frames(range_m, amplitude, axis)
    assert (np.abs(ours.numpy() - wanted) / level).max() < 2e-6


@pytest.mark.parametrize("error_db", [-40.0, -60.0, -100.0])
def test_the_stated_error_against_the_reference(error_db):
    range_m, amplitude = scene(2, 10)
    ours = BatchEcho(AXIS, error_db=error_db).frames(range_m, amplitude).numpy()
    for k in range(2):
        wanted = TIERS["passband"].frames(range_m[k], amplitude[k], AXIS, error_db=-120)
        level = amplitude[k].sum(axis=1, keepdims=True)
        assert (np.abs(ours[k] - wanted) / level).max() < 10 ** (error_db / 20)


def test_spectrum_is_the_numpy_tiers(echo):
    range_m, amplitude = scene()
    ours = echo.spectrum(range_m, amplitude).numpy()
    for k in range(4):
        wanted, grid = spectrum(range_m[k], amplitude[k], AXIS, error_db=-80.0)
        assert np.abs(ours[k] - wanted).max() < 3e-6 * np.abs(wanted).max()
        assert np.array_equal(grid.absolute_hz, echo.grid.absolute_hz)


def test_windows_do_not_depend_on_the_batch(echo):
    range_m, amplitude = scene()
    together = echo.frames(range_m, amplitude)
    alone = echo.frames(torch.from_numpy(range_m[2:3]), torch.from_numpy(amplitude[2:3]))
    assert (together[2:3] - alone).abs().max() < 1e-6 * amplitude[2].sum(axis=1).max()


def test_extremes(echo):
    """Far outside, at zero, not there, denormal: nothing but zeros, and no NaN."""
    away = np.array([0.0, -5.0, 1e3, 1e6, 1e300, np.inf, -np.inf])
    range_m = np.tile(away, (1, 3, 1))
    assert not echo.frames(range_m, np.ones_like(range_m)).any()
    inside, unit = scene(1, 4)
    for level in (0.0, 5e-324, 1e-40):
        assert not echo.frames(inside, level * unit).any()
    for shape in ((0, 4, 3), (2, 0, 3), (2, 4, 0), (1, 1, 1)):
        frames = echo.frames(np.full(shape, 2.0), np.ones(shape))
        assert frames.shape == (*shape[:2], 96)
        assert torch.isfinite(torch.view_as_real(frames)).all()


def test_long_ranges_keep_their_phase():
    axis = replace(AXIS, range_offset_m=1e5)
    range_m = axis.range_m[40] + np.linspace(0, 0.1, 50).reshape(1, 50, 1)
    ours = BatchEcho(axis).frames(range_m, np.ones_like(range_m)).numpy()
    wanted = TIERS["dense"].frames(range_m[0], np.ones((50, 1)), axis, error_db=-120)
    assert np.abs(ours[0] - wanted).max() < 1.1e-4


def test_bad_input_is_refused(echo):
    range_m, amplitude = scene(1, 3)
    with pytest.raises(SceneError, match=r"torch\.float32"):
        echo.frames(range_m.astype(np.float32), amplitude)
    with pytest.raises(SceneError, match="n_batch"):
        echo.frames(range_m[0], amplitude[0])
    with pytest.raises(SceneError, match="n_batch"):
        echo.frames(range_m, amplitude[..., :1])
    with pytest.raises(SceneError, match="'rf'"):
        BatchEcho(axis_of("rf"))
    with pytest.raises(SceneError, match="generator"):
        echo.noise(1, 3, 0.1)


# ---------------------------------------------------------------- noise


def test_noise_from_the_same_white_numbers(echo):
    """With the NumPy generator's numbers it is the NumPy noise."""
    n_white = noise_colour(AXIS).n_white
    white = np.random.default_rng(7).standard_normal((2, 5, 2, n_white), np.float32)
    ours = echo.noise(2, 5, 0.04, white=torch.from_numpy(white)).numpy()
    wanted = noise_colour(AXIS).draw(np.random.default_rng(7), 10, 0.04).reshape(2, 5, 96)
    assert np.abs(ours - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_noise_is_seeded_and_has_its_level(echo):
    a, b = (echo.noise(8, 50, 0.04, torch.Generator().manual_seed(3)) for _ in range(2))
    assert torch.equal(a, b)
    level = 0.04 * noise_colour(AXIS).sigma
    assert a.abs().square().mean().sqrt().item() == pytest.approx(level, rel=0.05)


# ---------------------------------------------------------------- features


@pytest.mark.parametrize("clutter_db", [0, 60, 100, 120])
def test_micro_doppler_is_the_daemons(echo, features, clutter_db):
    """Against the definition in float64, whatever stands still underneath."""
    range_m, amplitude = scene()
    rng = np.random.default_rng(2)
    frames = echo.frames(range_m, amplitude)
    wall = 10 ** (clutter_db / 20) * np.exp(2j * np.pi * rng.random((4, 1, 96)))
    frames = frames + torch.from_numpy(wall.astype(np.complex64))
    mu = features.micro_doppler(frames).numpy()
    assert mu.dtype == np.float32
    assert mu.shape == (4, 28, 33)
    for k in range(4):
        wanted = micro_doppler_direct(frames[k].numpy(), 28)
        assert np.linalg.norm(mu[k] - wanted) < 1e-5 * np.linalg.norm(wanted)


def test_range_time_is_the_power_of_what_moves(echo, features):
    frames = echo.frames(*scene())
    ours = features.range_time(frames + 30.0).numpy()
    y = frames.numpy().astype(np.complex128)
    wanted = np.abs(y - y.mean(axis=1, keepdims=True)) ** 2
    assert ours.dtype == np.float32
    assert np.abs(ours - wanted).max() < 2e-5 * wanted.max()


def velocity_by_definition(frames, echo, settings):
    """sum_f |sum_t w (X - mean) exp(-j 4 pi f v t / c)|^2 of one window, in float64."""
    s = settings
    band = np.abs(echo.grid.offset_hz) <= s.half_band_hz
    tau_s = 2 * (AXIS.range_m - echo.grid.reference_m) / C
    transform = np.exp(-2j * np.pi * np.outer(tau_s, echo.grid.offset_hz[band]))
    y = frames.astype(np.complex128)
    lines = (y - y.mean(axis=0)) @ transform / echo.grid.n_fft
    t_s = (np.arange(s.n_cpi) - (s.n_cpi - 1) / 2) / s.frame_rate_hz
    hz = echo.grid.absolute_hz[band]
    columns = []
    for at in range(0, len(frames) - s.n_cpi + 1, s.velocity_hop):
        cpi = gaussian_taper(s.n_cpi)[:, None] * lines[at : at + s.n_cpi]
        turn = np.exp(-4j * np.pi / C * s.velocity_mps[:, None, None] * t_s[:, None] * hz)
        columns.append((np.abs((cpi * turn).sum(axis=1)) ** 2).sum(axis=1))
    return np.stack(columns, axis=1)


def test_velocity_map_is_its_definition(echo, features):
    frames = echo.frames(*scene()) + 10.0
    ours = features.velocity(features.lines(frames)).numpy()
    assert ours.dtype == np.float32
    assert ours.shape == (4, 161, 5)
    for k in range(4):
        wanted = velocity_by_definition(frames[k].numpy(), echo, SETTINGS)
        assert np.abs(ours[k] - wanted).max() < 1e-4 * wanted.max()


@pytest.mark.parametrize("speed_mps", [-2.0, -0.6, 0.3, 1.2, 3.6])
def test_approaching_is_positive_beyond_the_ambiguity(echo, features, speed_mps):
    """A walk through the swath, in and out; the column in the middle of the window."""
    t_s = (np.arange(147) - 73) / 60
    range_m = (2.0 - speed_mps * t_s).reshape(1, 147, 1)
    lines = features.band(echo.spectrum(range_m, np.ones_like(range_m)))
    velocity = features.velocity(lines)[0]
    peak = velocity[:, round((73 - 13.5) / SETTINGS.velocity_hop)].argmax().item()
    assert SETTINGS.velocity_mps[peak] == pytest.approx(speed_mps, abs=0.05)


def test_without_frames_the_velocity_map_is_the_same(echo, features):
    """From X(f, t) or from frames: the same map for echoes away from the ends."""
    range_m, amplitude = scene()
    short = feature_maps(echo, features, range_m, amplitude, names=("velocity",))
    frames = echo.frames(range_m, amplitude)
    wanted = features.velocity(features.lines(frames))
    assert (short["velocity"] - wanted).abs().max() < 1e-3 * wanted.max()


def test_features_only_builds_no_frames_it_does_not_need(echo, features, monkeypatch):
    def refuse(*args):
        pytest.fail("frames were built")

    monkeypatch.setattr(BatchEcho, "frames", refuse)
    out = feature_maps(echo, features, *scene(), names=("velocity",))
    assert list(out) == ["velocity"]


@pytest.mark.parametrize("piece", [1, 3, 512])
def test_pieces_give_one_answer(echo, features, piece):
    range_m, amplitude = scene()
    clutter = torch.full((4, 96), 3.0 + 1.0j, dtype=torch.complex64)
    out = feature_maps(echo, features, range_m, amplitude, clutter=clutter, piece=piece)
    frames = echo.frames(range_m, amplitude) + clutter[:, None]
    wanted = {
        "micro_doppler": features.micro_doppler(frames),
        "range_time": features.range_time(frames),
        "velocity": features.velocity(features.lines(frames)),
    }
    assert out.keys() == wanted.keys()
    for name, values in wanted.items():
        assert (out[name] - values).abs().max() <= 1e-5 * values.max()


def test_noise_in_feature_maps_is_seeded(echo, features):
    range_m, amplitude = scene(2)

    def maps(seed):
        generator = torch.Generator().manual_seed(seed)
        return feature_maps(
            echo,
            features,
            range_m,
            0 * amplitude,
            names=("range_time",),
            sigma_rf=0.1,
            generator=generator,
        )["range_time"]

    assert torch.equal(maps(1), maps(1))
    assert not torch.equal(maps(1), maps(2))
    level = (0.1 * noise_colour(AXIS).sigma) ** 2
    assert maps(1).mean().item() == pytest.approx(level, rel=0.1)


def test_refusals(echo, features):
    range_m, amplitude = scene(1)
    with pytest.raises(SceneError, match="'colour': unknown; there are micro_doppler"):
        feature_maps(echo, features, range_m, amplitude, names=("colour",))
    with pytest.raises(SceneError, match="generator"):
        feature_maps(echo, features, range_m, amplitude, sigma_rf=1.0)
    short = echo.frames(range_m[:, :20], amplitude[:, :20])
    with pytest.raises(SceneError, match="20 frames cannot fill a CPI of 28"):
        features.micro_doppler(short)
    with pytest.raises(SceneError, match="20 frames"):
        features.velocity(features.lines(short))
    with pytest.raises(SceneError, match="n_cpi 1"):
        BatchFeatures(echo.grid, AXIS.range_m, MapSettings(60.0, n_cpi=1))
