"""Streams, dwells and pipelines that several test files build."""

import io
import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from importlib import resources
from pathlib import Path

import jsonschema
import numpy as np

from radard.cli import main as radard_main
from radard.stream.ring import Dwell, DwellShape, FrameRing
from tests.sim_helpers import axis_with
from x2radar.frame import FastTimeAxis, Frame

BASEBAND = axis_with("baseband", 64, 0.0293, 0.6)

SCHEMA = json.loads((resources.files("radard") / "output.schema.json").read_text())


def faults(records):
    """What of these records does not keep the contract of the output."""
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [fault for record in records for fault in validator.iter_errors(record)]


def noise(n_slow: int, n_range: int = 64, *, seed: int = 0, sigma: float = 1.0) -> np.ndarray:
    """Complex white noise of power sigma**2, shape (n_slow, n_range), complex64."""
    rng = np.random.default_rng(seed)
    parts = rng.standard_normal((n_slow, n_range, 2)) * (sigma / np.sqrt(2))
    return (parts[..., 0] + 1j * parts[..., 1]).astype(np.complex64)


def walker(n_slow: int, rate_hz: float, *, speed_mps: float, start_m: float, level: float):
    """A point that approaches at `speed_mps`, shape (n_slow, 64), complex64."""
    range_m = start_m - speed_mps * np.arange(n_slow) / rate_hz
    envelope = np.exp(-0.5 * ((BASEBAND.range_m - range_m[:, None]) / 0.045) ** 2)
    phase = np.exp(-4j * np.pi * range_m[:, None] * 6.8e9 / 299_792_458.0)
    return (level * envelope * phase).astype(np.complex64)


def dwell_of(
    frames: np.ndarray,
    rate_hz: float = 60.0,
    *,
    lost: Sequence[int] = (),
    axis: FastTimeAxis = BASEBAND,
    end: int = 0,
) -> Dwell:
    """A dwell of frames up to a number; those in `lost` repeat the row before, and are invalid."""
    rows = frames.copy()
    valid = np.ones(len(rows), np.bool_)
    for k in sorted(lost):
        valid[k] = False
        if k:
            rows[k] = rows[k - 1]
    runs = "".join("x" if not v else " " for v in valid).split()
    longest = max((len(run) for run in runs), default=0)
    axis, t_s = replace(axis, n_range=rows.shape[1]), (end or len(rows)) / rate_hz
    return Dwell(rows, valid, axis, rate_hz, t_s, len(lost), longest / rate_hz, end_frame=end)


def frames_of(samples: np.ndarray, axis: FastTimeAxis = BASEBAND) -> Iterator[Frame]:
    """Frames without losses."""
    for k, row in enumerate(samples):
        yield Frame(row, k + 1, k, 0, False, axis)


def lossy(samples: np.ndarray, lost: Collection[int]) -> Iterator[Frame]:
    """Frames of `samples` without those in `lost`."""
    missing = 0
    for frame in frames_of(samples):
        if frame.index in lost:
            missing += 1
        else:
            yield replace(frame, lost=missing)
            missing = 0


def dwells_in(ring: FrameRing, frames: Iterable[Frame]) -> Iterator[Dwell]:
    """The dwells that a ring makes of frames, each good until the next is asked for."""
    return (item for frame in frames for item in ring.items(frame) if isinstance(item, Dwell))


def copy_ring(n_slow: int, rate_hz: float, hop_s: float = 1.0) -> FrameRing:
    """A ring that takes baseband as it is."""
    shape = DwellShape(n_slow=n_slow, hop_s=hop_s, frame_rate_hz=rate_hz)

    def copy(samples, out):
        out[...] = samples

    return FrameRing(BASEBAND, copy, shape)


def run_radard(*argv: str) -> tuple[int, list[dict], str]:
    """Run the command in this process: exit code, JSON records, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = radard_main(list(argv))
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
    records = [json.loads(line) for line in out.getvalue().splitlines() if line.startswith("{")]
    return code, records, err.getvalue()


def decisions(records: Sequence[dict]) -> list[dict]:
    return [r for r in records if r["type"] == "decision"]


def events(records: Sequence[dict], *kinds: str) -> list[dict]:
    """Records of events, of these kinds or all."""
    return [r for r in records if r["type"] == "event" and (not kinds or r["kind"] in kinds)]


def states(records: Sequence[dict]) -> list[tuple[str, str]]:
    """What the records of status say, each with its reason."""
    return [(r["state"], r["reason"]) for r in records if r["type"] == "status"]


def records_in(path: Path) -> list[dict]:
    """The records of a file of JSON Lines."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def stable(records: Sequence[dict]) -> list[dict]:
    """The records without their wall-clock fields."""
    wall = {"time", "latency_ms"}
    told = [record for record in records if record["type"] != "hello"]
    return [{k: v for k, v in record.items() if k not in wall} for record in told]
