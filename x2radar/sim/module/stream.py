"""EchoStream: frames of a scene as a module's receiver sees them, one after another."""

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.modules.base import ModuleSettings
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import SEED_GAIN
from x2radar.sim.echo import frames as echo_frames
from x2radar.sim.place.room import Room
from x2radar.sim.scene.scene import Scene
from x2radar.sim.scene.stage import Stage
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power
from x2radar.sim.signal.receiver import Receiver

_BLOCK = 16  # frames made at a time: their arrays stay in a core's cache, and frames come soon
_UNSEEN = 0.1  # echoes under this share of a bin's noise, 20 dB below it, are not made
_NOISE, _ROOM = 0x4E01, 0x2001  # of generators, beside the seed: they must stay as they are


class EchoStream:
    """Frames of a scene, as the host configured them; draws and noise follow from the seed."""

    def __init__(self, scene: Scene, seed: int, settings: ModuleSettings) -> None:
        self.settings, self._scene = settings, scene
        self.axis = axis = settings.axis
        self._budget = budget = LinkBudget()
        # The sweep of other modules is taken to be that of an X2 at this frame rate.
        sweep = RadarSettings.for_frame_rate(min(max(1, round(settings.frame_rate_hz)), 1000))
        if isinstance(settings, RadarSettings):
            sweep = settings
        noise, room = (np.random.default_rng([seed, kind]) for kind in (_NOISE, _ROOM))
        self._receiver = Receiver(sweep, axis, budget, noise, effects=scene.receiver, seed=seed)
        self._stage = Stage(scene, seed, settings.frame_rate_hz)
        self._static: NDArray[Any] | None = None
        if scene.clutter:
            range_m, rcs_m2 = np.array(scene.clutter).T[:, None]
            amplitude = budget.amplitude(range_m, rcs_m2, axis)
            self._static = echo_frames(range_m, amplitude, axis, error_db=-90)[0]
        self._room = None if scene.room is None else Room(room, scene.room, axis)
        power = baseband_noise_power(axis, budget.noise_sigma)
        self._floor = _UNSEEN * float(np.sqrt(power))
        self._at = 0
        self._block: deque[NDArray[Any] | None] = deque()

    def next(self) -> NDArray[Any] | None:
        """Return the next frame, (n_range,), float32 RF or complex64; None for a lost one."""
        if not self._block:
            frames = self._frames()
            lost = self._receiver.draws.lost(self._at, len(frames))
            pairs = zip(frames, lost, strict=True)
            self._block.extend(None if is_lost else frame for frame, is_lost in pairs)
            self._at += len(frames)
        return self._block.popleft()

    def _frames(self) -> NDArray[Any]:
        times_s = self._receiver.draws.times_s(self._at, _BLOCK)
        block = self._stage.next_block(_BLOCK, times_s)
        # Physical cross sections get the module's integration gain here.
        frames: NDArray[Any] = echo_frames(
            block.rows.range_m,
            block.rows.amplitude(self._budget, self.axis) * np.sqrt(SEED_GAIN),
            self.axis,
            error_db=self._scene.error_db,
            floor=self._floor,
        )
        if self._static is not None:
            frames += self._static
        if self._room is not None:
            frames += self._room.echo(times_s[: block.n_slow], block.offset_m)
        is_rf = self.axis.kind == "rf"
        return self._receiver.rf(frames) if is_rf else self._receiver.baseband(frames)
