"""What every switch costs and loses, on simulated scenes.

Cost is the CPU time of one hop of the whole chain (`research.tradeoff.maps`). Loss is
how far its pictures are from those of the switch's finest value, all other switches the
same, in decibels: rms over all that either of the two shows, in dwells with an open gate.
"""

import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.config.sections import GateSettings
from radard.detect.gate import Gate
from radard.errors import UsageError
from research.tradeoff.maps import Chain, MapPictures, MapSetting, Picture, Samples
from x2radar.frame import FastTimeAxis
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene

_SHIPPED = MapSetting()


@dataclass(frozen=True, slots=True)
class Switch:
    """One switch: its values, the finest first, and what the others stand at."""

    name: str
    title: str
    values: tuple[str | float, ...]
    base: MapSetting = _SHIPPED


SWITCHES = (
    Switch("decimation", "range decimation", (1, 2, 4, 8, 16)),
    Switch("stride", "column stride", (1, 2, 3, 4, 6, 8)),
    Switch("step_mps", "velocity step, m/s", (0.025, 0.05, 0.1, 0.2, 0.4)),
    Switch("cpis", "velocity-time maps", (3, 2, 1)),
    Switch("precision", "bits of the maps", (64, 32)),
    Switch("source", "module sends", ("rf", "baseband")),
    Switch("bands", "range bands of the spectrogram", (8, 4, 2, 1), MapSetting(bands=8)),
)


@dataclass(frozen=True, slots=True)
class SwitchRow:
    """One value of one switch."""

    switch: str
    value: str | float
    is_default: bool  # whether the shipped bundles have it there
    ms_per_hop: float  # CPU time in milliseconds: median over hops, best of the rounds
    ratio: float  # to the switch's finest value, in the same round; median over rounds
    loss_db: dict[str, float]  # by picture; 0 for the finest


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A scene's frames, in both kinds."""

    scene: str
    seed: int  # of its draws
    frame_rate_hz: float
    frames: dict[str, Samples]  # (n_frames, n_range): by what the module sends
    axes: dict[str, FastTimeAxis]  # likewise


def record(scene: str, frame_rate_hz: float, duration_s: float, seed: int) -> Recording:
    """Simulate a scene as RF and as baseband; a lost frame repeats the one before."""
    frames: dict[str, Samples] = {}
    axes = {}
    for kind in ("rf", "baseband"):
        spec = Port("sim", scene, {"rate": f"{frame_rate_hz:g}", "kind": kind})
        settings = port_settings(spec)
        assert not callable(settings)  # noqa: S101 - only device=auto needs a module
        stream = EchoStream(load_scene(scene), seed, settings)
        rows: list[NDArray[np.generic]] = []
        for _ in range(round(duration_s * frame_rate_hz)):
            row = stream.next()
            rows.append(row if row is not None else rows[-1])
        frames[kind], axes[kind] = np.stack(rows), stream.axis
    return Recording(scene, seed, frame_rate_hz, frames, axes)


def measure(
    recordings: list[Recording], rounds: int, switches: tuple[Switch, ...] = SWITCHES
) -> Iterator[int | list[SwitchRow]]:
    """Measure switches on recordings, timed in rounds; yield settings done, then the table."""
    open_hops = _some_open(recordings)
    rows: list[SwitchRow] = []
    n_done = 0
    for switch in switches:
        settings = [switch.base.but(switch.name, value) for value in switch.values]
        seconds: list[list[float]] = [[] for _ in settings]
        shows: list[list[MapPictures]] = [[] for _ in settings]
        for _ in range(rounds):
            # The values of a switch take turns, so that a busy machine is busy for all.
            for k, setting in enumerate(settings):
                hops_s, shows[k] = _run(recordings, setting, open_hops)
                seconds[k].append(statistics.median(hops_s))
                n_done += 1
                yield n_done
        rows += _rows(switch, seconds, shows)
    yield rows


def n_steps(rounds: int, switches: tuple[Switch, ...] = SWITCHES) -> int:
    """Return how far `measure` counts."""
    return rounds * sum(len(switch.values) for switch in switches)


def chain_ms(
    recordings: list[Recording], settings: Sequence[MapSetting], rounds: int
) -> Iterator[int | dict[MapSetting, float]]:
    """Time the chain at several settings, in turn; yield settings done, then the result.

    That is the CPU time of a hop with an open gate, in milliseconds, of the best round.
    """
    open_hops = _some_open(recordings)
    best: dict[MapSetting, float] = {}
    for k in range(rounds):
        for n, setting in enumerate(settings, 1 + k * len(settings)):
            hops_s, _ = _run(recordings, setting, open_hops)
            taken_ms = 1e3 * statistics.median(hops_s)
            best[setting] = min(taken_ms, best.get(setting, taken_ms))
            yield n
    yield best


def picture_loss_db(ours: Picture, finest: Picture, depth_db: float) -> float:
    """Return the rms difference of two pictures of one kind over what either shows, in dB."""
    if len(ours) != len(finest):
        at = np.linspace(0, len(ours) - 1, len(finest))
        low = np.minimum(at.astype(int), len(ours) - 2)
        share = (at - low)[:, None]
        ours = ours[low] * (1 - share) + ours[low + 1] * share
    seen = (ours > 0) | (finest > 0)
    if not seen.any():
        return 0.0
    return depth_db * float(np.sqrt(np.mean((ours[seen] - finest[seen]) ** 2, dtype=np.float64)))


def _rows(
    switch: Switch, seconds: list[list[float]], shows: list[list[MapPictures]]
) -> Iterator[SwitchRow]:
    for k, value in enumerate(switch.values):
        setting = switch.base.but(switch.name, value)
        ratios = [a / b for a, b in zip(seconds[k], seconds[0], strict=True)]
        yield SwitchRow(
            switch.name,
            value,
            is_default=setting == _SHIPPED,
            ms_per_hop=min(seconds[k]) * 1e3,
            ratio=statistics.median(ratios),
            loss_db=_losses(shows[k], shows[0], setting.bands),
        )


def _losses(ours: list[MapPictures], finest: list[MapPictures], n_bands: int) -> dict[str, float]:
    losses: dict[str, list[float]] = {}
    for mine, best in zip(ours, finest, strict=True):
        for name, picture in mine.maps.items():
            reference, depth_db = best.maps[name], best.depth_db[name]
            mine_fine = picture
            if name == "spectrogram":
                # Every fine band is taken to show what the band around it does.
                bands = picture.reshape(n_bands, -1, picture.shape[1])
                bands = np.repeat(bands, len(reference) // len(picture), axis=0)
                mine_fine = bands.reshape(reference.shape)
            losses.setdefault(name, []).append(picture_loss_db(mine_fine, reference, depth_db))
    return {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in losses.items()}


def _run(
    recordings: list[Recording], setting: MapSetting, open_hops: list[list[bool]]
) -> tuple[list[float], list[MapPictures]]:
    hops_s, found = [], []
    for recording, is_open in zip(recordings, open_hops, strict=True):
        chain = Chain(recording.axes[setting.source], recording.frame_rate_hz, setting)
        for k, samples in enumerate(_hops(recording, setting.source)):
            started_s = time.thread_time()
            pictures = chain.hop(samples)
            duration_s = time.thread_time() - started_s
            if pictures is not None and is_open[k]:
                found.append(pictures)
                hops_s.append(duration_s)
    return hops_s, found


def _some_open(recordings: list[Recording]) -> list[list[bool]]:
    open_hops = [_open_hops(r) for r in recordings]
    if not any(map(any, open_hops)):
        msg = "nothing moves in these scenes: the gate never opens"
        raise UsageError(msg)
    return open_hops


def _open_hops(recording: Recording) -> list[bool]:
    """Return in which hops the daemon's gate is open, at the default setting."""
    setting = MapSetting()
    chain = Chain(recording.axes[setting.source], recording.frame_rate_hz, setting)
    gate = Gate(GateSettings())
    is_open = []
    for samples in _hops(recording, setting.source):
        shows = chain.hop(samples) is not None and chain.moving is not None
        is_open.append(bool(shows and chain.moving and gate.read(chain.moving).is_open))
    # The first dwell is not timed: it is made from nothing.
    if True in is_open:
        is_open[is_open.index(True)] = False
    return is_open


def _hops(recording: Recording, source: str) -> Iterator[Samples]:
    frames = recording.frames[source]
    n_hop = round(recording.frame_rate_hz)
    for first in range(0, len(frames) - n_hop + 1, n_hop):
        yield frames[first : first + n_hop]
