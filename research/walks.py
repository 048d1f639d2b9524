"""The recorded walk of a person beside simulated ones: same processing, same numbers.

The recordings (IR-UWB P4xx modules 101 and 102, docs/research/scenes.md) hold *one* walk, seen by
two radars: their stamps agree to 8 ms. Two ranges give a place on the floor but for two numbers,
the delay of the cables and the distance between the radars. With 4.0 m between the radars,
the width of the 4 x 4 m room, and a delay of 1.75 m, the walk becomes what somebody would
walk on purpose: along one wall, along the next, both a metre off, and straight back. Over
the ranges without it the echo's power falls with the powers 3.1 and 3.7, near the radar
equation's 4; a delay of 2.6 m would make it 2. Speed, way and room are all that is taken from
the recordings; bodies are drawn as in any scene.

The room, from what follows the body in the recordings. In both, 0.8 to 1.4 m behind it, runs
an echo whose distance depends on the body's range alone, so what mirrors it is level: half the
way by an image 3.3 to 3.9 m over or under the body. With antennas and trunk at 1.0 and 1.1 m
that is a ceiling at 2.7 to 3.0 m; -7 to -10 dB is what concrete gives. The walls (4 x 4 m)
leave no line above the rest, 16 to 20 dB under the body, where smooth concrete would be at
-10: they keep a third of the amplitude at most. The floor is free 0.9 m about the way, and we
take the same about the antennas. The tail's energy is the one measured (`TailSettings`); with
it and all mirrors, 0.4 to 3 m behind the body lies 4.1 dB less than in the body; recorded are
3.4 and 4.7. Things reach as far as the swath.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from scene import draw_range_time, draw_velocity_time, pictures
from study import check_within, run_script, save, say, script_parser
from walk_numbers import BEHIND_M, Array, Walk, follow, measure
from x2radar.errors import RecordingError
from x2radar.frame import FastTimeAxis
from x2radar.recording.registry import open_recording
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.room import Room
from x2radar.sim.scene.scene import Scene, parse_scene
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.pulse import LinkBudget, matched_noise
from x2train.commands import counted
from x2train.sets.workers import Tell

DELAY_M = 1.75
RADARS_X_M = (0.0, 4.0)
WAYPOINTS_M = ((2.9, 2.9), (2.9, 0.95), (1.2, 0.92), (1.12, 1.1), (2.85, 2.65))
SPEED_MPS = 0.30
FRAMES = (30, 740)
"""The recorded frames in which somebody walks."""
WITHIN = 0.2  # see docs/research/scenes.md
_ERROR_DB = -80.0  # of echoes: far under the tail
_SHOWN_MPS = 1.5  # what 30 frames a second leave
_SCENE = """
description: The recorded walk, a simulated person.
antenna: {{height_m: 1.0, shape: isotropic}}
room: {{objects_db: 50, diffuse_db: 35}}
surfaces:
  - {{axis: z}}
  - {{axis: z, at_m: 2.8, permittivity: 5.3}}
  - {{axis: y, at_m: 4, permittivity: 5.3, smoothness: 0.35}}
  - {{axis: x, at_m: {wall}, permittivity: 5.3, smoothness: 0.35}}
tail: {{energy_db: -5, reach_m: 5.3, free_m: 0.9}}
steps:
  - body: human
    style: walk
    waypoints_m: {waypoints}
    speed_mps: {speed}
    total_rcs_dbsm: 0
    duration_s: 60
"""
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
    *((f"power {away:g} m behind the body", "dB", 1.0) for away in BEHIND_M),
)
"""Of `WalkNumbers.row`, in order: name, unit, and the factor to it."""


@dataclass(frozen=True, slots=True)
class MeasureRow:
    """One measure, recorded and simulated."""

    name: str
    unit: str
    recorded: tuple[float, ...]
    # of the simulated people, each averaged over the same radars
    mean: float
    sd: float

    @property
    def is_level(self) -> bool:
        """Whether it is in decibels: judged by difference."""
        return self.unit == "dB"

    @property
    def against(self) -> float:
        """Simulated over recorded; the difference, for levels."""
        recorded = float(np.mean(self.recorded))
        return self.mean - recorded if self.is_level else self.mean / recorded

    @property
    def is_within(self) -> bool:
        """Whether it is within 20 %; for levels, within 2 dB."""
        return abs(self.against) <= 2.0 if self.is_level else abs(self.against - 1) <= WITHIN


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; draw recorded and simulated walks beside each other."""
    parser = script_parser(
        "walks",
        "Compare simulated walkers with the two recorded P4xx walks.",
        "p410_walk_101.mat p410_walk_102.mat --out walks/",
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings, 101 first")
    add("--out", type=Path, required=True, metavar="DIR", help="where scene_walks.png goes")
    add("--seeds", type=int, default=12, metavar="N", help="simulated people (12)")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    if len(args.files) > len(RADARS_X_M):
        msg = f"{len(args.files)} files: the walk was recorded by {len(RADARS_X_M)} radars"
        raise UsageError(msg)
    check_within(args, seeds=(2, 1000))
    recorded = [recorded_walk(path) for path in args.files]
    with counted("people") as tell:
        rows, simulated = compare(recorded, args.seeds, tell)
    say("\n".join([*table(rows), "* not within 20 %, or 2 dB"]))
    save(drawn(recorded, simulated), args.out / "scene_walks.png", 72)


def recorded_walk(path: Path) -> Walk:
    """Return the walk in one of the recordings; RecordingError if it is another one."""
    with open_recording(path) as recording:
        axis, rate_hz = recording.stream.axis, recording.stream.frame_rate_hz
        if axis.kind != "rf" or recording.n_frames < FRAMES[1] or not rate_hz:
            msg = f"{path}: not the recorded walk: {FRAMES[1]} or more timed RF frames"
            raise RecordingError(msg)
        scans = np.stack([frame.samples for frame in recording.frames()])
    converter = DownConverter(axis)
    offset_m = converter.axis.range_offset_m - DELAY_M
    in_room = replace(converter.axis, range_offset_m=offset_m)
    return follow(converter.convert(scans[slice(*FRAMES)]), in_room, rate_hz)


def walk_scene(radar_x_m: float) -> Scene:
    """Return the scene as the radar at `radar_x_m` on the room's wall has it before itself."""
    waypoints = [[round(x - radar_x_m, 3), y] for x, y in WAYPOINTS_M]
    # The antennas hang on the other two walls.
    wall_m = max(RADARS_X_M, key=lambda x_m: abs(x_m - radar_x_m)) - radar_x_m
    text = _SCENE.format(waypoints=waypoints, speed=SPEED_MPS, wall=wall_m)
    return parse_scene(text, "walk", "walk")


def simulated_walk(
    seed: int, axis: FastTimeAxis, frame_rate_hz: float, radar_x_m: float
) -> NDArray[np.complex64]:
    """Return the frames of the recorded walk with a simulated person, shape (n_slow, n_range).

    The seed draws person, room and noise: one seed is one person for both radars, at `RADARS_X_M`
    on the wall. Ranges of the axis are those in the room.
    """
    scene = walk_scene(radar_x_m)
    n_frames, budget = FRAMES[1] - FRAMES[0], LinkBudget()
    rows = Stage(scene, seed, frame_rate_hz).next_block(n_frames).rows
    amplitude = rows.amplitude(budget, axis) * np.sqrt(SEED_GAIN)
    frames = echo_frames(rows.range_m, amplitude, axis, error_db=_ERROR_DB)
    rng = np.random.default_rng([seed, round(1000 * radar_x_m)])
    assert scene.room is not None  # noqa: S101 - the text above names one
    frames += Room(rng, scene.room, axis).still.astype(np.complex64)
    frames += matched_noise(n_frames, axis, rng, budget.noise_sigma)
    return np.asarray(frames, np.complex64)


def compare(
    recorded: Sequence[Walk], n_seeds: int, tell: Tell
) -> tuple[tuple[MeasureRow, ...], list[Walk]]:
    """Measure recordings, and as many simulated people before the same radars.

    `recorded` are of modules 101 and 102, in this order, or the first alone. Returns the table's
    rows, and the walks of the first seed.
    """
    simulated: list[Walk] = []
    numbers: list[Array] = []
    for seed in range(n_seeds):
        walks = [
            follow(simulated_walk(seed, w.axis, w.frame_rate_hz, x_m), w.axis, w.frame_rate_hz)
            for w, x_m in zip(recorded, RADARS_X_M, strict=False)
        ]
        numbers.append(np.mean([measure(walk).row() for walk in walks], axis=0))
        simulated = simulated or walks
        tell(seed + 1, n_seeds)
    known = np.array([measure(walk).row() for walk in recorded])
    mean, sd = np.mean(numbers, axis=0), np.std(numbers, axis=0, ddof=1)
    rows = tuple(
        MeasureRow(name, unit, tuple((known[:, k] * by).tolist()), mean[k] * by, sd[k] * by)
        for k, (name, unit, by) in enumerate(_ROWS)
    )
    return rows, simulated


def table(rows: Sequence[MeasureRow]) -> list[str]:
    """Return the numbers as a table in Markdown."""
    n = len(rows[0].recorded)
    radars = " | ".join(f"radar {k + 1}" for k in range(n))
    lines = [f"| | {radars} | simulated | against |", "|---|" + "---|" * (n + 2)]
    for row in rows:
        digits = 1 if row.unit in {"cm", "dB"} else 2
        recorded = " | ".join(f"{x:.{digits}f}" for x in row.recorded)
        against = f"{row.against:+.1f} dB" if row.is_level else f"x{row.against:.2f}"
        mark = "" if row.is_within else " *"
        name = f"{row.name}, {row.unit}" if row.unit else row.name
        simulated = f"{row.mean:.{digits}f} +- {row.sd:.{digits}f}"
        lines.append(f"| {name} | {recorded} | {simulated} | {against}{mark} |")
    return lines


def drawn(recorded: Sequence[Walk], simulated: Sequence[Walk]) -> Figure:
    """Draw range over time and velocity over time of every walk."""
    columns = [
        (walk, f"radar {k + 1}, {what}")
        for k, pair in enumerate(zip(recorded, simulated, strict=True))
        for walk, what in zip(pair, ("recorded", "simulated"), strict=True)
    ]
    figure = Figure(figsize=(3.6 * len(columns), 6.4), layout="tight")
    axes = figure.subplots(2, len(columns), squeeze=False)
    for k, (walk, title) in enumerate(columns):
        shown = pictures(walk.frames, walk.axis, walk.frame_rate_hz)
        draw_range_time(axes[0, k], shown)
        draw_velocity_time(axes[1, k], shown)
        axes[0, k].set_title(title)
        axes[1, k].set(title="", ylim=(-_SHOWN_MPS, _SHOWN_MPS))
    return figure


if __name__ == "__main__":
    sys.exit(main())
