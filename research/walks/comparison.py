"""The recorded walk against simulated ones: same processing, same numbers, side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radard.dsp.downconvert import DownConverter
from research.walks.follow import Array, Walk, follow
from research.walks.measure import BEHIND_M, measure
from research.walks.scene import FRAMES, RADARS_X_M, simulated_walk, without_delay
from x2radar.errors import RecordingError
from x2radar.recording.registry import open_recording

WITHIN = 0.2  # chosen, see docs/research/scenes.md
_ROWS = (
    ("range rate, mean", "m/s", 1.0),
    ("range rate, spread along straight stretches", "m/s", 1.0),
    ("range rate, spread within steps (range)", "m/s", 1.0),
    ("torso oscillation, Doppler line, rms", "m/s", 1.0),
    ("torso oscillation, range, rms", "cm", 100.0),
    ("bursts of limb velocity", "Hz", 1.0),
    ("near edge (-6 dB), oscillation, rms", "cm", 100.0),
    ("limbs ahead of the way (-15 dB), median", "cm", 100.0),
    ("limbs ahead of the way, 90 %", "cm", 100.0),
    ("limbs' edge, oscillation, rms", "cm", 100.0),
    ("limb velocity about the body, rms", "m/s", 1.0),
    ("coherence from frame to frame", "", 1.0),
    ("body extent (-6 dB), median", "cm", 100.0),
)


@dataclass(frozen=True, slots=True)
class MeasureRow:
    """One measure, recorded and simulated."""

    name: str
    unit: str
    recorded: tuple[float, ...]
    # of the simulated people, each averaged over the same radars
    mean: float
    sd: float
    is_level: bool = False  # in decibels: judged by difference

    @property
    def against(self) -> float:
        """Simulated over recorded; the difference, for levels."""
        recorded = float(np.mean(self.recorded))
        return self.mean - recorded if self.is_level else self.mean / recorded

    @property
    def is_within(self) -> bool:
        """Whether it is within 20 %; for levels, within 2 dB."""
        return abs(self.against) <= 2.0 if self.is_level else abs(self.against - 1) <= WITHIN


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Recorded and simulated walks."""

    rows: tuple[MeasureRow, ...]
    # one for each radar; the simulated are those of the first seed
    recorded: tuple[Walk, ...]
    simulated: tuple[Walk, ...]

    def table(self) -> str:
        """Return the numbers as a table in Markdown."""
        n = len(self.recorded)
        lines = [
            "| | " + " | ".join(f"radar {k + 1}" for k in range(n)) + " | simulated | against |",
            "|---|" + "---|" * (n + 2),
        ]
        for row in self.rows:
            digits = 1 if row.unit in {"cm", "dB"} else 2
            recorded = " | ".join(f"{x:.{digits}f}" for x in row.recorded)
            against = f"{row.against:+.1f} dB" if row.is_level else f"x{row.against:.2f}"
            mark = "" if row.is_within else " *"
            name = f"{row.name}, {row.unit}" if row.unit else row.name
            lines.append(
                f"| {name} | {recorded} | {row.mean:.{digits}f} +- {row.sd:.{digits}f} "
                f"| {against}{mark} |"
            )
        return "\n".join(lines)


def recorded_walk(path: Path) -> Walk:
    """Return the walk in one of the recordings."""
    with open_recording(path) as recording:
        axis, rate_hz = recording.stream.axis, recording.stream.frame_rate_hz
        if axis.kind != "rf" or recording.n_frames < FRAMES[1] or not rate_hz:
            msg = f"{path}: not the recorded walk: {FRAMES[1]} or more timed RF frames"
            raise RecordingError(msg)
        scans = np.stack([frame.samples for frame in recording.frames()])
    converter = DownConverter(axis)
    frames = converter.convert(scans[slice(*FRAMES)])
    return follow(frames, without_delay(converter.axis), rate_hz)


def compare(paths: Sequence[Path], n_seeds: int) -> Iterator[int | Comparison]:
    """Measure recordings, and as many simulated people before the same radars.

    `paths` are recordings of modules 101 and 102, in this order, or the first alone. Yields people
    done, then the comparison. Raises RecordingError as `recorded_walk`.
    """
    recorded = tuple(recorded_walk(path) for path in paths)
    places = tuple(zip(recorded, RADARS_X_M, strict=False))
    simulated: list[Walk] = []
    numbers = np.zeros((n_seeds, len(_ROWS) + len(BEHIND_M)))
    for seed in range(n_seeds):
        walks = [
            follow(simulated_walk(seed, w.axis, w.frame_rate_hz, x_m), w.axis, w.frame_rate_hz)
            for w, x_m in places
        ]
        numbers[seed] = np.mean([measure(walk).row() for walk in walks], axis=0)
        simulated = simulated or walks
        yield seed + 1
    rows = _rows(np.array([measure(walk).row() for walk in recorded]), numbers)
    yield Comparison(rows, recorded, tuple(simulated))


def _rows(recorded: Array, simulated: Array) -> tuple[MeasureRow, ...]:
    """Return the table's rows from numbers of shape (n_radars, n) and (n_seeds, n)."""
    levels = tuple((f"power {away:g} m behind the body", "dB", 1.0) for away in BEHIND_M)
    mean, sd = simulated.mean(axis=0), simulated.std(axis=0, ddof=1)
    return tuple(
        MeasureRow(
            name=name,
            unit=unit,
            recorded=tuple((recorded[:, k] * factor).tolist()),
            mean=float(mean[k] * factor),
            sd=float(sd[k] * factor),
            is_level=unit == "dB",
        )
        for k, (name, unit, factor) in enumerate((*_ROWS, *levels))
    )
