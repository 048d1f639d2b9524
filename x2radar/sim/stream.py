"""EchoStream: frames of a scene as a module's receiver sees them, one after another."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from x2radar.frame import FastTimeAxis
from x2radar.module_settings import ModuleSettings
from x2radar.settings import SPEED_OF_LIGHT_MPS, RadarSettings
from x2radar.sim.pulse import LinkBudget, baseband_echo, rf_echo
from x2radar.sim.receiver import Receiver
from x2radar.sim.scene import Scene, SceneClock, StaticPoint

_BLOCK = 16


def stream_axis(settings: ModuleSettings) -> FastTimeAxis:
    """Return the axis of the frames that a module with these settings sends."""
    return FastTimeAxis(
        kind=settings.kind,
        n_range=settings.n_range,
        bin_length_m=settings.bin_length_m,
        range_offset_m=settings.range_offset_m,
        carrier_hz=settings.carrier_hz,
        bandwidth_hz=settings.bandwidth_hz,
        sample_rate_hz=settings.sample_rate_hz,
    )


class EchoStream:
    """Frames of a scene.

    Parameters
    ----------
    scene : Scene
        What is in front of the radar.
    seed : int
        Draws and noise follow from it.
    settings : RadarSettings, X4Settings or ProfileSettings
        As the host configured them.
    """

    def __init__(self, scene: Scene, seed: int, settings: ModuleSettings) -> None:
        self.settings = settings
        self.axis = stream_axis(settings)
        # Modules that decimate do so behind the filter, so noise is made on the fine axis.
        rf_bin_m = SPEED_OF_LIGHT_MPS / (2 * self.axis.sample_rate_hz)
        self._every = round(self.axis.bin_length_m / rf_bin_m)
        self._fine = replace(
            self.axis,
            n_range=(self.axis.n_range - 1) * self._every + 1,
            bin_length_m=self.axis.bin_length_m / self._every,
        )
        self._budget = LinkBudget()
        rng = np.random.default_rng([seed, 0x4E01])
        # The converter's steps are modelled for RF frames of the X2 only.
        sweep = settings if isinstance(settings, RadarSettings) else RadarSettings()
        self._receiver = Receiver(sweep, self._fine, self._budget, rng)
        self._clock = SceneClock(scene, seed, settings.frame_rate_hz)
        self._static = self._static_echo(scene.clutter)
        self._block: deque[np.ndarray[Any, Any]] = deque()

    def next(self) -> np.ndarray[Any, Any]:
        """Return the next frame: shape (n_range,), float32 RF or complex64 baseband."""
        if not self._block:
            block = self._clock.next_block(_BLOCK)
            amplitude = self._budget.amplitude(block.range_m, block.rcs_m2, self._fine)
            if self.axis.kind == "rf":
                frames = rf_echo(block.range_m, amplitude, self._fine)
                frames += self._static
                self._block.extend(self._receiver.rf(frames))
            else:
                echo = baseband_echo(block.range_m, amplitude, self._fine) + self._static
                self._block.extend(self._receiver.baseband(echo)[:, :: self._every])
        return self._block.popleft()

    def _static_echo(self, points: tuple[StaticPoint, ...]) -> np.ndarray[Any, Any]:
        range_m = np.array([[p.range_m for p in points]])
        amplitude = self._budget.amplitude(
            range_m, np.array([p.rcs_m2 for p in points]), self._fine
        )
        echo = rf_echo if self.axis.kind == "rf" else baseband_echo
        return np.asarray(echo(range_m, amplitude, self._fine)[0])
