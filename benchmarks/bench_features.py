"""Cost and error of the live features, against the usual ways, in one run on one core.

The task is the spectrogram of one 2 s window of 768 complex bins, CPIs of 28 frames, a
column a frame. Four kinds of rivals:

- the per-column loop: mean off, taper, numpy FFT, power summed (complex64);
- scipy's ShortTimeFFT with its own removal of the mean, and torch.stft, which has none and
  is spared it;
- the best fair peer: whatever is fastest of those and of five ways to batch all columns
  (scipy.fft in two memory layouts, whole and in blocks that fit the cache; one matrix
  product), on every 8th bin, as ours is then;
- the copy of the input, below which nothing can come.

Rounds are interleaved and ratios taken within a round, so that a busy machine hits all of
them alike; printed are medians. `vs_best_peer_60hz` is the worse of two ratios: all columns
from a whole window, and the new columns of a hop.
"""

import argparse
import json
import os
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))  # for tests.dsp_reference

import numpy as np  # noqa: E402 - after the number of threads is set
import scipy.fft  # noqa: E402
import scipy.signal  # noqa: E402
from numpy.lib.stride_tricks import sliding_window_view  # noqa: E402

from radard.config.sections import GateSettings  # noqa: E402
from radard.detect.gate import Gate  # noqa: E402
from radard.dsp.cadence import (  # noqa: E402
    cadence_velocity_diagram,
    extent_profile,
    type1_vector,
)
from radard.dsp.columns import SharedSteps  # noqa: E402
from radard.dsp.doppler import (  # noqa: E402  # noqa: E402
    StreamingDoppler,
    centring,
    gaussian_taper,
    micro_doppler,
    step_operator,
)
from radard.dsp.downconvert import DownConverter  # noqa: E402
from radard.dsp.range_time import RangeTimeMap  # noqa: E402
from radard.dsp.velocity import VelocityTransform  # noqa: E402
from radard.judge.bundle import load_bundle  # noqa: E402
from radard.judge.classifier import Classifier  # noqa: E402
from radard.stream.ring import Dwell  # noqa: E402
from tests.dsp_reference import micro_doppler_direct  # noqa: E402
from x2radar.frame import FastTimeAxis  # noqa: E402

M = 28
N_RANGE = 768
DECIMATION = 8
TAPER = gaussian_taper(M).astype(np.float32)
AXIS = FastTimeAxis(
    kind="baseband",
    n_range=N_RANGE,
    bin_length_m=0.003656,
    range_offset_m=0.6,
    carrier_hz=6.8e9,
    bandwidth_hz=2.3e9,
    sample_rate_hz=41e9,
)
Spectrogram = Callable[[np.ndarray], np.ndarray]


def record(n_slow: int, n_range: int, clutter_db: float = 50.0) -> np.ndarray:
    """Return white motion over static clutter, complex64."""
    rng = np.random.default_rng(0)
    parts = rng.standard_normal((n_slow + 1, n_range, 2))
    y = parts[..., 0] + 1j * parts[..., 1]
    return (y[1:] + y[0] * 10 ** (clutter_db / 20)).astype(np.complex64)


def loop(y: np.ndarray) -> np.ndarray:
    """One FFT a column."""
    columns = []
    for i in range(len(y) - M + 1):
        cpi = y[i : i + M]
        g = np.fft.fft(TAPER[:, None] * (cpi - cpi.mean(axis=0)), axis=0)
        columns.append(np.fft.fftshift((g.real**2 + g.imag**2).sum(axis=1)))
    return np.stack(columns, axis=1)


def batched_last(y: np.ndarray, block: int = 1 << 30) -> np.ndarray:
    """All columns at once, slow time last in memory."""
    windows = sliding_window_view(y, M, axis=0)
    out = []
    for first in range(0, len(windows), block):
        part = windows[first : first + block]
        z = (part - part.mean(axis=-1, keepdims=True)) * TAPER
        g = scipy.fft.fft(z, axis=-1, overwrite_x=True)
        out.append((g.real**2 + g.imag**2).sum(axis=1))
    return np.fft.fftshift(np.concatenate(out), axes=1).T


def batched_middle(y: np.ndarray, block: int = 1 << 30) -> np.ndarray:
    """All columns at once, range last in memory."""
    windows = sliding_window_view(y, M, axis=0).swapaxes(1, 2)
    out = []
    for first in range(0, len(windows), block):
        part = windows[first : first + block]
        z = (part - part.mean(axis=1, keepdims=True)) * TAPER[:, None]
        g = scipy.fft.fft(z, axis=1, overwrite_x=True)
        out.append((g.real**2 + g.imag**2).sum(axis=2))
    return np.fft.fftshift(np.concatenate(out), axes=1).T


OPERATOR = (step_operator(gaussian_taper(M)) @ np.linalg.pinv(centring(M))).astype(np.complex64)


def matrix_product(y: np.ndarray) -> np.ndarray:
    """All columns as one batched product with the centred, tapered DFT matrix."""
    g = OPERATOR @ sliding_window_view(y, M, axis=0).swapaxes(1, 2)
    return np.einsum("ikn,ikn->ki", g.real, g.real) + np.einsum("ikn,ikn->ki", g.imag, g.imag)


SFT = scipy.signal.ShortTimeFFT(TAPER, 1, 1.0, fft_mode="centered")


def short_time_fft(y: np.ndarray) -> np.ndarray:
    """Return scipy.signal.ShortTimeFFT's power, whole windows only."""
    first = SFT.lower_border_end[1]
    last = SFT.upper_border_begin(len(y))[1]
    s = SFT.stft_detrend(y.T, "constant", p0=first, p1=last)
    return (s.real**2 + s.imag**2).sum(axis=0)


def torch_stft() -> Spectrogram | None:
    """Return torch.stft's power as a function, None where there is no torch."""
    try:
        import torch  # noqa: PLC0415
    except ImportError:
        return None
    torch.set_num_threads(1)
    window = torch.tensor(TAPER)

    def power(y: np.ndarray) -> np.ndarray:
        x = torch.from_numpy(np.ascontiguousarray(y.T))
        s = torch.stft(x, M, 1, M, window, center=False, onesided=False, return_complex=True)
        return np.fft.fftshift((s.real**2 + s.imag**2).sum(dim=0).numpy(), axes=0)

    return power


class Hop:
    """A stream that gets the next second of a long record at every call."""

    def __init__(self, y: np.ndarray, n_hop: int, push: Callable[[np.ndarray], object]) -> None:
        self._y, self._n, self._push, self._at = y, n_hop, push, 0

    def __call__(self) -> None:
        """Give the next frames."""
        if self._at + self._n > len(self._y):
            self._at = 0
        self._push(self._y[self._at : self._at + self._n])
        self._at += self._n


def stream_hop(y: np.ndarray, n_hop: int, n_columns: int) -> Hop:
    """Return the live path of the spectrogram: push a hop, take the window's columns."""
    stream = StreamingDoppler(M, n_keep=n_columns)
    stream.push(y[: n_columns + M])

    def push(frames: np.ndarray) -> None:
        stream.push(frames)
        stream.columns(n_columns)

    return Hop(y, n_hop, push)


def time_all(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Return each task's seconds in every round, the better of two calls a round."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for task in tasks.values():
        task()
    for _ in range(rounds):
        for name, task in tasks.items():
            best = float("inf")
            for _ in range(2):
                started = time.thread_time()
                task()
                best = min(best, time.thread_time() - started)
            seconds[name].append(best)
    return seconds


def ratio(seconds: dict[str, list[float]], slow: str, fast: str) -> float:
    """Return the median over rounds of how many times faster one is."""
    pairs = zip(seconds[slow], seconds[fast], strict=True)
    return statistics.median(a / b for a, b in pairs)


def spectrogram(rate_hz: int, rounds: int) -> dict[str, object]:
    """Return ratios and times of one window at a frame rate."""
    n_columns = 2 * rate_hz
    y = record(10 * rate_hz, N_RANGE)
    less = np.ascontiguousarray(y[:, ::DECIMATION])
    window, window_less = y[: n_columns + M - 1], less[: n_columns + M - 1]
    hop_less = less[: rate_hz + M - 1]
    peers: dict[str, Spectrogram] = {
        "loop": loop,
        "short_time_fft": short_time_fft,
        "batched_last": batched_last,
        "batched_last_blocks": lambda x: batched_last(x, 16),
        "batched_middle": batched_middle,
        "batched_middle_blocks": lambda x: batched_middle(x, 16),
        "matrix_product": matrix_product,
    }
    wanted = micro_doppler_direct(window_less, M)
    for name, peer in peers.items():
        assert np.allclose(peer(window_less), wanted, rtol=0.2, atol=1e-3 * wanted.max()), name
    stft = torch_stft()
    if stft is not None:
        peers["torch_stft"] = stft
    tasks: dict[str, Callable[[], object]] = {
        "copy": window.copy,
        "loop": lambda: loop(window),
        "short_time_fft": lambda: short_time_fft(window),
        "cold": lambda: micro_doppler(window, M),
        "hop": stream_hop(y, rate_hz, n_columns),
        "cold_less": lambda: micro_doppler(window_less, M),
        "hop_less": stream_hop(less, rate_hz, n_columns),
    }
    if stft is not None:
        tasks["torch_stft"] = lambda: stft(window)
    for name, peer in peers.items():
        tasks[f"peer_{name}"] = lambda peer=peer: peer(window_less)
        tasks[f"peer_hop_{name}"] = lambda peer=peer: peer(hop_less)
    seconds = time_all(tasks, rounds)
    ms = {name: statistics.median(s) * 1e3 for name, s in seconds.items()}
    best = min(peers, key=lambda name: ms[f"peer_{name}"])
    best_hop = min(peers, key=lambda name: ms[f"peer_hop_{name}"])
    return {
        "speedup": ratio(seconds, "loop", "hop"),
        "cold_speedup": ratio(seconds, "loop", "cold"),
        "cold_vs_short_time_fft": ratio(seconds, "short_time_fft", "cold"),
        "cold_vs_torch_stft": ratio(seconds, "torch_stft", "cold") if stft else None,
        "vs_best_peer": min(
            ratio(seconds, f"peer_{best}", "cold_less"),
            ratio(seconds, f"peer_hop_{best_hop}", "hop_less"),
        ),
        "best_peer": best,
        "best_peer_hop": best_hop,
        "ms": {name: round(value, 4) for name, value in ms.items()},
    }


def frame_by_frame(rounds: int) -> dict[str, float]:
    """Return the microseconds of one frame: RF to baseband, and into the spectrogram."""
    y = record(1000, N_RANGE)
    stream = StreamingDoppler(M)
    stream.push(y[:100])
    one = Hop(y, 1, lambda frame: stream.push(frame[0]))
    rf_axis = FastTimeAxis(
        kind="rf",
        n_range=N_RANGE,
        bin_length_m=AXIS.bin_length_m,
        range_offset_m=AXIS.range_offset_m,
        carrier_hz=AXIS.carrier_hz,
        bandwidth_hz=AXIS.bandwidth_hz,
        sample_rate_hz=AXIS.sample_rate_hz,
    )
    rf = np.ascontiguousarray(y.real)
    converter = DownConverter(rf_axis, DECIMATION)
    row = np.empty(converter.axis.n_range, np.complex64)
    convert = Hop(rf, 1, lambda frame: converter.convert(frame[0], row))
    seconds = time_all({"push": one, "convert": convert}, 100 * rounds)
    return {name: statistics.median(s) * 1e6 for name, s in seconds.items()}


def errors() -> dict[str, float]:
    """Return the worst relative error of window and stream, by clutter in dB."""
    found = {}
    for clutter_db in (0, 60, 80, 100, 120, 140):
        worst = 0.0
        for n_range in (96, N_RANGE):
            y = record(147, n_range, clutter_db)
            wanted = micro_doppler_direct(y, M)
            stream = StreamingDoppler(M)
            for frame in y:
                stream.push(frame)
            for ours in (micro_doppler(y, M), stream.columns()):
                worst = max(worst, np.linalg.norm(ours - wanted) / np.linalg.norm(wanted))
        found[f"err_{clutter_db}db"] = float(worst)
    return found


def whole_hop(rounds: int, step: int = 1) -> dict[str, float]:
    """Return the milliseconds of all that one hop at 60 Hz computes, and of its parts.

    Three maps of every so manieth of the 768 bins (spectrogram, velocity, range-time), the
    gate, the cadence diagram and range profile that the shipped network wants, the network.
    """
    rate_hz, n_columns = 60, 120
    y = np.ascontiguousarray(record(20 * rate_hz, N_RANGE)[:, ::step])
    axis = replace(AXIS, n_range=y.shape[1], bin_length_m=AXIS.bin_length_m * step)
    doppler = StreamingDoppler(M, n_keep=n_columns)
    velocity = VelocityTransform(axis, rate_hz)
    ranges = RangeTimeMap(axis, M)
    gate = Gate(GateSettings())
    classifier = Classifier(load_bundle("thesis"))
    seconds: dict[str, list[float]] = {}

    def part(name: str, work: Callable[[], object]) -> object:
        started = time.thread_time()
        result = work()
        seconds.setdefault(name, []).append(time.thread_time() - started)
        return result

    maps = SharedSteps(doppler, velocity, ranges)
    maps.push(y[:rate_hz])
    for k in [n % 17 for n in range(20 * rounds)]:
        frames = y[k * rate_hz : k * rate_hz + n_columns + M - 1]
        new = frames[-rate_hz:]
        valid = np.ones(len(frames), np.bool_)
        dwell = Dwell(frames, valid, axis, float(rate_hz), float(k))
        part("maps", lambda new=new: maps.push(new))
        part("range_time_cells", lambda: ranges.cells(60.0))
        part("gate", lambda dwell=dwell: gate.read(dwell))
        if doppler.n_columns < n_columns:
            continue
        mu = doppler.columns(n_columns).astype(np.float32)
        cvd = part("cadence", lambda mu=mu: cadence_velocity_diagram(mu))
        profile = part("profile", lambda frames=frames: extent_profile(frames, M, 392))
        vector = np.concatenate([profile, type1_vector(cvd, M)])
        features = {"thesis_type2": vector}
        part("classifier", lambda features=features: classifier.answer(features))
    ms = {name: statistics.median(s) * 1e3 for name, s in seconds.items()}
    return {"total": sum(ms.values()), **ms}


def memory() -> dict[str, float]:
    """Return the peak KiB that one window takes beyond its input."""
    y = record(147, N_RANGE)
    stream = StreamingDoppler(M, n_keep=120)
    stream.push(y)
    found = {}
    tasks = {
        "loop": lambda: loop(y),
        "batched": lambda: batched_last(y),
        "cold": lambda: micro_doppler(y, M),
        "hop": lambda: stream.push(y[:60]),
    }
    for name, task in tasks.items():
        task()
        tracemalloc.start()
        task()
        found[name] = tracemalloc.get_traced_memory()[1] / 1024
        tracemalloc.stop()
    return found


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    args = parser.parse_args()
    slow, fast = spectrogram(60, args.rounds), spectrogram(200, args.rounds)
    less = whole_hop(args.rounds, DECIMATION)
    frame, hop, kib = frame_by_frame(args.rounds), whole_hop(args.rounds), memory()
    result = {
        "speedup_60hz": slow["speedup"],
        "speedup_200hz": fast["speedup"],
        "cold_speedup_60hz": slow["cold_speedup"],
        "cold_speedup_200hz": fast["cold_speedup"],
        "vs_best_peer_60hz": slow["vs_best_peer"],
        "vs_best_peer_200hz": fast["vs_best_peer"],
        "cold_vs_short_time_fft_60hz": slow["cold_vs_short_time_fft"],
        "cold_vs_torch_stft_60hz": slow["cold_vs_torch_stft"],
        "us_per_frame_60hz": frame["push"],
        "us_per_frame_of_a_hop_60hz": slow["ms"]["hop"] / 60 * 1e3,
        "us_per_frame_down_conversion": frame["convert"],
        **errors(),
        "hop_ms": hop.pop("total"),
        "hop_ms_every_8th_bin": less.pop("total"),
        "copy_floor_ms": slow["ms"]["copy"],
    }
    result = {k: float(f"{v:.4g}") if v is not None else None for k, v in result.items()}
    result["hop_parts_ms"] = {name: round(value, 3) for name, value in hop.items()}
    result["hop_parts_ms_every_8th_bin"] = {k: round(value, 3) for k, value in less.items()}
    result["peak_kib"] = {name: round(value) for name, value in kib.items()}
    result["best_peer_60hz"] = [slow["best_peer"], slow["best_peer_hop"]]
    result["ms_60hz"], result["ms_200hz"] = slow["ms"], fast["ms"]
    print(json.dumps(result))


if __name__ == "__main__":
    main()
