"""What every part that a scene may name costs, against a person who walks, in one run.

A part costs what a second of the stream takes with it, less what it takes without it. Both are
played side by side, part after part, in rounds, each with draws of its own; printed are medians of
the rounds. CPU time of one thread, as Markdown.
"""

import argparse
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory

# Before numpy loads: the matrices are small.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np

from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.skins import SKINS
from x2radar.sim.module.cost import cpu_ms, echoes
from x2radar.sim.scene.cast import BODIES
from x2radar.sim.scene.scene import parse_scene
from x2radar.sim.signal.receiver import ReceiverEffects
from x2radar.sim.things.kinds import THINGS

_IQ = RadarSettings.for_frame_rate(60, output="iq")
_FAST = RadarSettings.for_frame_rate(200, output="iq")
_NOTHING = "steps: [{duration_s: 9}]\n"
# In the swath for longer than it is timed.
_WAY = "waypoints_m: [[0.2, 3.0], [0.2, 0.8]], speed_mps: 0.8"
_PERSON = f"steps: [{{body: human, {_WAY}, duration_s: 9}}]\n"
_WALKERS = ("human", "dog", "cat", "rabbit")
KEYS = {
    "clutter: one point": "clutter: [{range_m: 1, rcs_m2: 9}]",
    "antenna's pattern": "antenna: {}",
    "multipath: a floor": "surfaces: [{axis: z}]",
    "multipath: floor and wall": "surfaces: [{axis: z}, {axis: y, at_m: 4}]",
    "multipath: tail": "tail: {}",
    "room": "room: {objects_db: 50, diffuse_db: 33, leakage_db: 55, drift_m: 2.0e-5}",
    "mount": "mount: {}",
}
"""Keys of a scene beside a person who walks."""
_EFFECTS = {
    "noise_figure_db": 10,
    "jitter_s": 1.5e-13,
    "gain_noise": 5e-4,
    "frame_jitter": 0.01,
    "burst_rate_hz": 0.5,
    "clip": 0.5,
    "spike_share": 0.01,
    "lost_share": 0.01,
}


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table: two scenes, and how the stream is made of either."""

    part: str
    played: str
    without: str = _NOTHING
    settings: RadarSettings = _IQ
    usual: RadarSettings = _IQ


def rows(folder: Path) -> Iterator[Row]:
    """Yield every part, the person first; a recorded motion is written into a folder."""
    yield Row("body: human, skin surface", _PERSON)
    for body in BODIES:
        way = f", {_WAY}" if body in _WALKERS else ""
        if body == "motion":
            way = f", file: {_recorded(folder / 'motion.npz')}, up: z, label: human"
        for skin in () if body.startswith("thesis") else SKINS:
            if (body, skin) != ("human", "surface"):
                text = f"steps: [{{body: {body}{way}, skin: {skin}, duration_s: 9}}]\n"
                yield Row(f"body: {body}, skin {skin}", text)
        if body.startswith("thesis"):
            yield Row(f"body: {body}", f"steps: [{{body: {body}, duration_s: 9}}]\n")
    for thing in THINGS:
        there = f"background: [{{thing: {thing}, position_m: [0.3, 1.6]}}]\n"
        yield Row(f"thing: {thing}", there + _NOTHING)
    for part, key in KEYS.items():
        yield Row(part, f"{_PERSON}{key}\n", _PERSON)
    for name, value in _EFFECTS.items():
        yield Row(f"receiver: {name}", f"{_PERSON}receiver: {{{name}: {value}}}\n", _PERSON)
    yield Row("person at 200 Hz instead of 60", _PERSON, _PERSON, _FAST)
    yield Row("person as RF instead of baseband", _PERSON, _PERSON, replace(_IQ, output="rf"))


def unnamed() -> set[str]:
    """Return settings of the receiver that have no line: they say how bursts are drawn."""
    return {field.name for field in fields(ReceiverEffects)} - set(_EFFECTS)


def _recorded(path: Path) -> Path:
    """Write a chain of 16 joints that comes nearer and swings."""
    t_s = np.arange(300)[:, None] / 60
    joint = np.arange(16)[None]
    swing_m = 0.2 * np.sin(2 * np.pi * t_s + joint)
    position_m = np.stack([swing_m, 3 - 0.4 * t_s + 0 * joint, 0.1 * joint + 0 * t_s], axis=-1)
    np.savez(path, position_m=position_m, parent=np.arange(-1, 15), frame_rate_hz=60.0)
    return path


def measured(wanted: list[Row], n_rounds: int) -> Mapping[str, float]:
    """Return the milliseconds of a second of the stream that each part takes."""
    took: dict[str, list[float]] = {row.part: [] for row in wanted}
    for seed in range(n_rounds):
        for row in wanted:
            played = parse_scene(row.played, "with", "with")
            without = parse_scene(row.without, "without", "without")
            spent = cpu_ms(played, seed, row.settings)
            took[row.part].append(spent - cpu_ms(without, seed, row.usual))
    return {part: float(np.median(ms)) for part, ms in took.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        wanted = list(rows(Path(folder)))
        ms = measured(wanted, args.rounds)
    unit = ms[wanted[0].part]
    noise = [cpu_ms(parse_scene(_NOTHING, "t", "t"), k, _IQ) for k in range(args.rounds)]
    share = {part: f"{max(spent / unit, 0):.2f}" for part, spent in ms.items()}
    print(f"| body by skin | {' | '.join(SKINS)} |\n|---|{'---|' * len(SKINS)}")
    for body in BODIES:
        if not body.startswith("thesis"):
            found = (share.pop(f"body: {body}, skin {skin}") for skin in SKINS)
            print(f"| {body} | {' | '.join(found)} |")
    share = {"noise of the receiver": f"{np.median(noise) / unit:.2f}", **share}
    print("\n| part | cost |\n|---|---|")
    for part, text in share.items():
        print(f"| {part} | {text} |")
    print("\n| echoes of a person within | cost | error measured |\n|---|---|---|")
    lines = [list(echoes(parse_scene(_PERSON, "t", "t"), k, _IQ)) for k in range(args.rounds)]
    for same in zip(*lines, strict=True):
        spent = float(np.median([line.cpu_ms for line in same]))
        worst = max(line.error_db for line in same if line.error_db is not None)
        bound = same[0].part.removeprefix("echoes within ")
        print(f"| {bound} | {spent / unit:.2f} | {worst:.0f} dB |")
    load = os.getloadavg()[0]
    print(
        f"\n1.00 is {unit:.1f} ms; {args.rounds} rounds, {os.cpu_count()} cores, load {load:.0f}"
    )


if __name__ == "__main__":
    main()
