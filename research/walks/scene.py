"""The recorded walk once more: a simulated person before two simulated radars.

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

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.room import Room
from x2radar.sim.scene.cast import SEED_GAIN
from x2radar.sim.scene.scene import Scene, parse_scene
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.noise import matched_noise
from x2radar.sim.signal.pulse import LinkBudget

DELAY_M = 1.75
RADARS_X_M = (0.0, 4.0)
WAYPOINTS_M = ((2.9, 2.9), (2.9, 0.95), (1.2, 0.92), (1.12, 1.1), (2.85, 2.65))
SPEED_MPS = 0.30
FRAMES = (30, 740)
"""The recorded frames in which somebody walks."""
_ERROR_DB = -80.0  # of echoes: chosen, far under the tail

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


def walk_scene(radar_x_m: float) -> Scene:
    """Return the scene as the radar at `radar_x_m` on the room's wall has it before itself."""
    waypoints = [[round(x - radar_x_m, 3), y] for x, y in WAYPOINTS_M]
    # The antennas hang on the other two walls.
    wall_m = max(RADARS_X_M, key=lambda x_m: abs(x_m - radar_x_m)) - radar_x_m
    text = _SCENE.format(waypoints=waypoints, speed=SPEED_MPS, wall=wall_m)
    return parse_scene(text, "walk", "walk")


def without_delay(axis: FastTimeAxis) -> FastTimeAxis:
    """Return a recording's axis with its ranges those in the room."""
    return replace(axis, range_offset_m=axis.range_offset_m - DELAY_M)


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
    frames += Room(rng, scene.room, axis, budget).still.astype(np.complex64)
    frames += matched_noise(n_frames, axis, rng, budget.noise_sigma)
    return np.asarray(frames, np.complex64)
