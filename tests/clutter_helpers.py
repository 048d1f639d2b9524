"""Rooms with clutter, jitter and noise that the tests of clutter, gate and tracks share."""

from pathlib import Path

import numpy as np
import pytest

from radard.config.config import Config
from radard.detect.calibration import Calibration
from radard.detect.clutter_map import ClutterRemover
from radard.dsp.downconvert import DownConverter
from radard.pipeline import Pipeline
from radard.stream.ring import FrameRing
from tests.echo_references import baseband_echo
from tests.radar_helpers import BASEBAND, dwells_in, noise
from tests.sim_helpers import axis_with
from x2radar.recording.registry import open_recording

SPEED_OF_LIGHT_MPS = 299_792_458.0
AXIS = axis_with("baseband", 96, 0.0293, 0.6)
ALL = np.ones(147, np.bool_)
"""No frame of a dwell is lost."""
DATA = Path(__file__).parents[2] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here")


def db(power):
    return 10 * np.log10(power)


def calibration(floor=1.0, threshold_db=10.0, n_range=64):
    """The calibration of a stream in baseband, with one floor or one for every bin."""
    return Calibration(
        frame_rate_hz=60.0,
        bin_length_m=BASEBAND.bin_length_m,
        range_offset_m=BASEBAND.range_offset_m,
        floor=np.broadcast_to(np.asarray(floor, np.float64), (n_range,)).copy(),
        threshold_db=np.full(n_range, threshold_db),
    )


def jitter_of(n_slow, *, jitter_s=0.2e-12, gain=1e-3, seed=1):
    """Common delays and gains of every frame."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal(n_slow) * jitter_s, rng.standard_normal(n_slow) * gain


def room(n_slow=147, *, peak_db=57.0, jitter_s=0.2e-12, gain=1e-3, seed=1, target=0.0):
    """Clutter with jitter, noise of power one and a target, shape (n_slow, 96), complex64.

    Static echoes lie over the whole swath; the strongest bin is `peak_db` over the noise.
    """
    delay_s, gains = jitter_of(n_slow, jitter_s=jitter_s, gain=gain, seed=seed)
    rng = np.random.default_rng(2)
    range_m = np.sort(rng.uniform(0.5, 3.5, 60))
    amplitude = np.exp(-range_m) * rng.lognormal(0, 0.7, 60)
    still = baseband_echo(range_m[None], amplitude[None], AXIS)
    amplitude *= 10 ** (peak_db / 20) / np.abs(still).max()
    moved = range_m + delay_s[:, None] * SPEED_OF_LIGHT_MPS / 2
    # In float64: baseband_echo is exact to its complex64 output only.
    out = np.zeros((n_slow, AXIS.n_range), np.complex128)
    sigma_m = np.sqrt(np.log(10) / 2) / (np.pi * AXIS.bandwidth_hz / 2) * SPEED_OF_LIGHT_MPS / 2
    for k in range(60):
        envelope = np.exp(-((AXIS.range_m - moved[:, k, None]) ** 2) / (2 * sigma_m**2))
        turns = 2 * moved[:, k, None] * AXIS.carrier_hz / SPEED_OF_LIGHT_MPS
        out += amplitude[k] * envelope * np.exp(-2j * np.pi * (turns % 1))
    out = out * (1 + gains[:, None]) + noise(n_slow, AXIS.n_range, seed=seed + 50) + target
    return out.astype(np.complex64)


def body(range_m, level_db, axis=AXIS):
    """Points of `level_db` each along paths, shape (n_slow,) or (n_slow, n), in metres."""
    paths = np.asarray(range_m, np.float64).reshape(len(range_m), -1)
    return baseband_echo(paths, np.full(paths.shape, 10 ** (level_db / 20)), axis)


def dwells_of_recording(path, step):
    """The dwells of a recording without their clutter, every `step`-th bin of them."""
    reader = open_recording(str(path))
    converter = DownConverter(reader.stream.axis, step)
    shape = Pipeline(reader.stream, Config()).shape
    ring, remover = FrameRing(converter.axis, converter.convert, shape), ClutterRemover()
    return map(remover.remove, dwells_in(ring, reader.frames(0.0)))
