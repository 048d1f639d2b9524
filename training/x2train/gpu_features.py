"""Features of many windows at a time, on any torch device.

The definitions are the daemon's: micro-Doppler spectrogram by the Gram matrix of frame
differences, range-time power without what stands still, and the wideband velocity map.
`feature_maps` goes from distances straight to features in pieces that fit the device, and
builds no more than the features ask for: a velocity map without noise needs no frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from radard.dsp.doppler import gaussian_taper
from x2radar.errors import SceneError
from x2radar.settings import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo import SpectralGrid
from x2train.gpu import BatchEcho, Levels, Ranges

NAMES = ("micro_doppler", "range_time", "velocity")


@dataclass(frozen=True, slots=True)
class MapSettings:
    """How the maps are made.

    Attributes
    ----------
    frame_rate_hz : float
        Frames per second.
    n_cpi : int
        Frames in a CPI, of micro-Doppler and velocity alike.
    velocity_hop : int
        Frames from one column of the velocity map to the next.
    fastest_mps : float
        The velocity axis runs from minus this to this.
    n_velocity : int
        Rows of the velocity map. A CPI of 28 frames at 60 Hz resolves 0.07 m/s: rows
        further apart than that let a target fall between two of them.
    half_band_hz : float
        Baseband frequencies up to here go into the velocity map.
    """

    frame_rate_hz: float
    n_cpi: int = 28
    velocity_hop: int = 8
    fastest_mps: float = 4.0
    n_velocity: int = 161
    half_band_hz: float = 1.3e9

    @property
    def velocity_mps(self) -> NDArray[np.float64]:
        """Radial velocity of every row, approaching positive: shape (n_velocity,)."""
        return np.linspace(-self.fastest_mps, self.fastest_mps, self.n_velocity)


class BatchFeatures:
    """Maps of batches of windows.

    Parameters
    ----------
    grid : SpectralGrid
        Frequencies of the velocity map: those of `BatchEcho.grid` within the band.
    range_m : ndarray, shape (n_range,)
        Range axis of the frames.
    settings : MapSettings
        How.
    device : torch.device or str
        Where.
    """

    def __init__(
        self,
        grid: SpectralGrid,
        range_m: NDArray[np.float64],
        settings: MapSettings,
        *,
        device: torch.device | str = "cpu",
    ) -> None:
        self.settings = settings
        device = torch.device(device)
        n_cpi = settings.n_cpi
        if n_cpi < 2:
            msg = f"n_cpi {n_cpi}: a CPI has at least 2 frames"
            raise SceneError(msg)
        self._doppler = torch.tensor(_difference_operator(n_cpi), device=device)
        band = np.abs(grid.offset_hz) <= settings.half_band_hz
        self._band = torch.tensor(np.flatnonzero(band), device=device)
        turns = np.outer(2 * (range_m - grid.reference_m) / SPEED_OF_LIGHT_MPS, grid.offset_hz)
        to_lines = np.exp(-2j * np.pi * (turns % 1.0)) / grid.n_fft
        self._to_lines = torch.tensor(to_lines[:, band].astype(np.complex64), device=device)
        steering = _steering(grid.absolute_hz[band], settings)
        self._steering = torch.tensor(steering.astype(np.complex64), device=device)

    def micro_doppler(self, frames: Tensor) -> Tensor:
        """Return the micro-Doppler spectrograms mu.

        Parameters
        ----------
        frames : Tensor, shape (n_batch, n_slow, n_range), complex64
            Baseband, static clutter and all.

        Returns
        -------
        Tensor, shape (n_batch, n_cpi, n_slow - n_cpi + 1), float32
            As `radard.dsp.doppler.micro_doppler` gives it for each window.

        Raises
        ------
        SceneError
            If the windows are shorter than a CPI.
        """
        n_batch, n_slow, _ = frames.shape
        width = self.settings.n_cpi - 1
        n_columns = self._columns(n_slow)
        steps = torch.diff(frames, dim=1)
        gram = steps @ steps.mH
        stride = gram.stride()
        windows = gram.as_strided(
            (n_batch, n_columns, width, width),
            (stride[0], stride[1] + stride[2], stride[1], stride[2]),
        )
        half = self._doppler @ windows
        mu = (half * self._doppler.conj()).sum(dim=-1).real
        return mu.clamp(min=0).mT.contiguous()

    def range_time(self, frames: Tensor) -> Tensor:
        """Return the power of what moves, over range and time.

        Returns
        -------
        Tensor, shape (n_batch, n_slow, n_range), float32
            ``|y - mean over the window|^2``.
        """
        moving = frames - frames.mean(dim=1, keepdim=True)
        return torch.view_as_real(moving).square().sum(dim=-1)

    def lines(self, frames: Tensor) -> Tensor:
        """Return X(f, t) in the velocity map's band, shape (n_batch, n_slow, n_line)."""
        return frames @ self._to_lines

    def velocity(self, lines: Tensor) -> Tensor:
        """Return wideband velocity maps.

        Parameters
        ----------
        lines : Tensor, shape (n_batch, n_slow, n_line), complex64
            From `lines`, or `BatchEcho.spectrum` cut to `band`.

        Returns
        -------
        Tensor, shape (n_batch, n_velocity, n_columns), float32
            ``sum_f |sum_t w(t - t0) (X - mean) exp(-j 4 pi f v (t - t0) / c)|^2`` for an
            approaching velocity v, a column every `velocity_hop` frames. The mean is the
            whole window's: a CPI's own would take blind speeds (1.3 m/s at 60 Hz) with it.

        Raises
        ------
        SceneError
            If the windows are shorter than a CPI.
        """
        s = self.settings
        self._columns(lines.shape[1])
        # What stands still goes first: float32 would round it into the rest.
        moving = lines - lines.mean(dim=1, keepdim=True)
        cpis = moving.unfold(1, s.n_cpi, s.velocity_hop)
        n_batch, n_columns, n_line, _ = cpis.shape
        rows = cpis.permute(2, 0, 1, 3).reshape(n_line, n_batch * n_columns, s.n_cpi)
        focused = torch.view_as_real(rows @ self._steering).square().sum(dim=(0, 3))
        return focused.reshape(n_batch, n_columns, s.n_velocity).mT.contiguous()

    def band(self, spectrum: Tensor) -> Tensor:
        """Return the lines of a whole spectrum that lie in the velocity map's band."""
        return spectrum.index_select(-1, self._band)

    def _columns(self, n_slow: int) -> int:
        n_columns = n_slow - self.settings.n_cpi + 1
        if n_columns < 1:
            msg = f"windows of {n_slow} frames cannot fill a CPI of {self.settings.n_cpi}"
            raise SceneError(msg)
        return n_columns


def feature_maps(
    echo: BatchEcho,
    features: BatchFeatures,
    range_m: Ranges,
    amplitude: Levels,
    *,
    names: Sequence[str] = NAMES,
    sigma_rf: float = 0.0,
    generator: torch.Generator | None = None,
    clutter: Tensor | None = None,
    piece: int = 512,
) -> dict[str, Tensor]:
    """Return features of a batch, from distances; frames live only in between.

    Parameters
    ----------
    echo : BatchEcho
        Makes the echoes.
    features : BatchFeatures
        Makes the maps, on the same device.
    range_m, amplitude
        As in `BatchEcho.frames`.
    names : sequence of str
        Out of `NAMES`; nothing is computed for the others.
    sigma_rf : float
        Standard deviation of the receiver's noise per RF sample; 0 for none.
    generator : torch.Generator, optional
        For the noise, on the device; needed if there is any.
    clutter : Tensor, shape (n_batch, n_range), complex64, optional
        What stands still.
    piece : int
        Windows that are worked on at a time.

    Returns
    -------
    dict of str to Tensor
        The maps by name, float32.

    Raises
    ------
    SceneError
        If a name is unknown, or noise has no generator.
    """
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        msg = f"feature map '{unknown[0]}': unknown; there are {', '.join(NAMES)}"
        raise SceneError(msg)
    parts: dict[str, list[Tensor]] = {name: [] for name in names}
    frameless = tuple(names) == ("velocity",) and sigma_rf == 0
    for at in range(0, len(range_m), piece):
        r, a = range_m[at : at + piece], amplitude[at : at + piece]
        if frameless:
            lines = features.band(echo.spectrum(r, a))
            parts["velocity"].append(features.velocity(lines))
            continue
        frames = echo.frames(r, a)
        if sigma_rf > 0:
            frames += echo.noise(len(r), frames.shape[1], sigma_rf, generator)
        if clutter is not None:
            frames += clutter[at : at + piece, None]
        for name in names:
            parts[name].append(_map(features, name, frames))
    return {name: torch.cat(maps) for name, maps in parts.items()}


def _map(features: BatchFeatures, name: str, frames: Tensor) -> Tensor:
    if name == "micro_doppler":
        return features.micro_doppler(frames)
    if name == "range_time":
        return features.range_time(frames)
    return features.velocity(features.lines(frames))


def _difference_operator(n_cpi: int) -> NDArray[np.complex64]:
    """Return what takes a CPI's frame differences to its Doppler lines, (n_cpi, n_cpi - 1).

    Column m is the tapered transform of a unit step behind frame m, less the step's mean.
    """
    step = (np.arange(n_cpi)[:, None] > np.arange(n_cpi - 1)).astype(np.float64)
    tapered = gaussian_taper(n_cpi)[:, None] * (step - step.mean(axis=0))
    return np.fft.fftshift(np.fft.fft(tapered, axis=0), axes=0).astype(np.complex64)


def _steering(absolute_hz: NDArray[np.float64], s: MapSettings) -> NDArray[np.complex128]:
    """Return taper and focusing, shape (n_line, n_cpi, n_velocity)."""
    since_s = (np.arange(s.n_cpi) - (s.n_cpi - 1) / 2) / s.frame_rate_hz
    per_line = 2 * absolute_hz[:, None, None] / SPEED_OF_LIGHT_MPS
    turns = per_line * since_s[:, None] * -s.velocity_mps
    return np.asarray(gaussian_taper(s.n_cpi)[:, None] * np.exp(2j * np.pi * turns))
