"""Echoes of many windows at a time, on any torch device.

The same sum as the simulator's spectral tier, over a batch: the carrier's and the delay's
phases are reduced to one turn in float64, everything behind that is float32. A device
without float64 gets the reduced phases from the host. The result is the NumPy tier's
within the rounding of float32; which numbers the noise is made of depends on the device.
"""

from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from x2radar.errors import SceneError
from x2radar.frame import FastTimeAxis
from x2radar.settings import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo import Pulse, SpectralGrid, noise_colour
from x2radar.sim.echo.common import FAINTEST
from x2radar.sim.echo.spectral_grid import grid_for

Ranges: TypeAlias = Tensor | NDArray[np.float64]
Levels: TypeAlias = Tensor | NDArray[np.float64] | NDArray[np.float32] | NDArray[np.complex128]

_NO_FLOAT64 = frozenset({"mps"})


class BatchEcho:
    """Baseband echoes and noise of batches of windows.

    Parameters
    ----------
    axis : FastTimeAxis
        A baseband axis; short frames (every eighth bin) are what training wants.
    pulse : Pulse, optional
        The axis' own by default.
    device : torch.device or str
        Where to compute.
    error_db : float
        Largest error of a bin over the sum of a frame's amplitudes, down to -100 dB.

    Raises
    ------
    SceneError
        If the axis is RF or has no bandwidth.
    """

    def __init__(
        self,
        axis: FastTimeAxis,
        pulse: Pulse | None = None,
        *,
        device: torch.device | str = "cpu",
        error_db: float = -80.0,
    ) -> None:
        if axis.kind != "baseband":
            msg = f"axis of kind '{axis.kind}': batches are made at baseband"
            raise SceneError(msg)
        self.axis = axis
        self.device = torch.device(device)
        self._exact = torch.device("cpu") if self.device.type in _NO_FLOAT64 else self.device
        pulse = pulse or Pulse.of(axis)
        self.grid: SpectralGrid = grid_for(axis, pulse, error_db)
        self._pulse = pulse
        self._weight = torch.tensor(self.grid.weight, device=self.device)
        line = np.arange(self.grid.n_freq) - self.grid.n_freq // 2
        bins = (axis.range_m - self.grid.reference_m) / self.grid.period_m
        turns = np.outer(line, bins) % 1.0
        self._to_bins = torch.tensor(
            np.exp(2j * np.pi * turns).astype(np.complex64), device=self.device
        )
        self._colour: Tensor | None = None

    def spectrum(self, range_m: Ranges, amplitude: Levels) -> Tensor:
        """Return X(f, t) of every window, without any frame.

        Parameters
        ----------
        range_m : Tensor or ndarray, shape (n_batch, n_slow, n_points), float64
            Distances, in metres. A tensor should lie on `device`; float32 is refused,
            since its rounding would turn the carrier's phase.
        amplitude : Tensor or ndarray, same shape, real or complex
            Peak amplitudes, with no NaN among them.

        Returns
        -------
        Tensor, shape (n_batch, n_slow, n_freq), complex64
            As `x2radar.sim.echo.spectrum` gives it: echoes whose centre is outside the
            swath do not count.

        Raises
        ------
        SceneError
            If the shapes differ, are not three-dimensional, or ranges are not float64.
        """
        return self._lines(range_m, amplitude, reach_m=self.axis.bin_length_m / 2)

    def frames(self, range_m: Ranges, amplitude: Levels) -> Tensor:
        """Return noise-free baseband frames of every window.

        Parameters
        ----------
        range_m, amplitude
            As in `spectrum`.

        Returns
        -------
        Tensor, shape (n_batch, n_slow, n_range), complex64
            As the spectral tier of `x2radar.sim.echo.frames` gives them: within 2e-6 of
            the sum of a frame's amplitudes.
        """
        return self._lines(range_m, amplitude, reach_m=self.grid.reach_m) @ self._to_bins

    def noise(
        self,
        n_batch: int,
        n_slow: int,
        sigma_rf: float,
        generator: torch.Generator | None = None,
        *,
        white: Tensor | None = None,
    ) -> Tensor:
        """Return receiver noise as the matched filter leaves it.

        Parameters
        ----------
        n_batch, n_slow : int
            Windows, and frames in each.
        sigma_rf : float
            Standard deviation of one RF sample.
        generator : torch.Generator
            Source of the numbers, on `device`; needed unless `white` is given.
        white : Tensor, shape (n_batch, n_slow, 2, n_white), float32, optional
            The numbers themselves, normal with variance 1: the order in which
            `NoiseColour.draw` takes them.

        Returns
        -------
        Tensor, shape (n_batch, n_slow, n_range), complex64
            Noise; see `x2radar.sim.echo.NoiseColour`.

        Raises
        ------
        SceneError
            If neither generator nor numbers are given, or the axis has no sampling rate.
        """
        if self._colour is None:
            colour = noise_colour(self.axis, self._pulse)
            self._colour = torch.tensor(colour.matrix, device=self.device)
        if white is None:
            if generator is None:
                msg = "noise needs a generator, or the white numbers themselves"
                raise SceneError(msg)
            shape = (n_batch, n_slow, 2, len(self._colour))
            white = torch.randn(shape, generator=generator, device=self.device)
        mixed = (white * sigma_rf) @ self._colour
        return torch.complex(mixed[..., 0, :], mixed[..., 1, :])

    def _lines(self, range_m: Ranges, amplitude: Levels, *, reach_m: float) -> Tensor:
        range_m = torch.as_tensor(range_m)
        amplitude = torch.as_tensor(amplitude)
        if range_m.ndim != 3 or range_m.shape != amplitude.shape:
            msg = (
                f"ranges of shape {tuple(range_m.shape)} and amplitudes of shape "
                f"{tuple(amplitude.shape)}; both must be (n_batch, n_slow, n_points)"
            )
            raise SceneError(msg)
        if range_m.dtype != torch.float64:
            msg = f"ranges are {range_m.dtype}; phases need torch.float64"
            raise SceneError(msg)
        n_batch, n_slow, _ = range_m.shape
        level, start, far_step, near_step = self._reduced(range_m, amplitude, reach_m)
        grid = self.grid
        slow = _powers(level * _phasor(start), _phasor(far_step), grid.n_slow_power)
        unit = torch.ones(near_step.shape, dtype=torch.complex64, device=self.device)
        fast = _powers(unit, _phasor(near_step), grid.n_fast_power)
        # One product a frame: (Q, n_points) times (n_points, r).
        lines = slow.flatten(0, 1).mT @ fast.flatten(0, 1)
        return lines.reshape(n_batch, n_slow, grid.n_freq) * self._weight

    def _reduced(
        self, range_m: Tensor, amplitude: Tensor, reach_m: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return amplitudes of what counts, and three phases in turns, -0.5 to 0.5, float32."""
        axis, grid = self.axis, self.grid
        r = range_m.to(self._exact)
        first_m = axis.range_offset_m
        last_m = first_m + (axis.n_range - 1) * axis.bin_length_m
        seen = (r > first_m - reach_m) & (r < last_m + reach_m)
        seen &= amplitude.to(self._exact).abs() > FAINTEST
        r = torch.where(seen, r, first_m)
        ramp = (r - grid.reference_m) * (-1 / grid.period_m)
        carrier = r * (axis.phase_sign * 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS)
        carrier = carrier - torch.round(carrier)
        turns = (carrier - (grid.n_freq // 2) * ramp, ramp * grid.n_fast_power, ramp)
        start, far, near = ((t - torch.round(t)).float().to(self.device) for t in turns)
        kind = torch.complex64 if amplitude.is_complex() else torch.float32
        level = torch.where(seen, amplitude.to(self._exact), 0.0).to(kind).to(self.device)
        return level, start, far, near


def _phasor(turns: Tensor) -> Tensor:
    """Return exp(2j pi turns), complex64."""
    angle = turns * (2 * np.pi)
    return torch.complex(torch.cos(angle), torch.sin(angle))


def _powers(first: Tensor, ratio: Tensor, n: int) -> Tensor:
    """Return a geometric sequence along a new last axis, shape (..., n)."""
    terms = [first.to(torch.complex64)]
    for _ in range(n - 1):
        terms.append(terms[-1] * ratio)
    return torch.stack(terms, dim=-1)
