"""A --port string becomes frames: serial, ``sim:`` or ``replay:``, live ones with recovery.

A source yields frames and, through `on_notice`, says when the device is lost and found. It
opens before the first frame is asked for, so that faults of the port come at start.
"""

import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Protocol

from radard.errors import UsageError
from radard.stream.playback import Playback
from x2radar.device.device import RadarStats, X2Radar
from x2radar.device.reconnect import ReconnectingRadar
from x2radar.device.transport import Transport
from x2radar.errors import RecordingError, TransportClosed
from x2radar.frame import Frame, StreamInfo
from x2radar.modules.modules import module_of
from x2radar.plugins import find_plugin
from x2radar.ports import Port, parse_port, parse_speed
from x2radar.radars import make_radar

Notify = Callable[[str, str], None]
# Not a Windows port, and not a URL of pyserial's.
_SCHEME = re.compile(r"([a-z][a-z0-9+._-]+):(?!//)")
PAUSE_S = 0.04  # at 614 kB/s (X2 RF, 200 Hz) 25 kB collect; a kernel's buffer holds 64
_FLOWS_BYTES = 512  # in a read: more than any reply to a command
_EARLY_S = 0.006  # more than a due frame was ever early: `FrameRing.due_s` errs by less
_LATE_S = 0.1  # a frame that late is lost
# A Linux terminal gives at most 4095 bytes to a read, whatever waits behind them: a read of
# about that many is followed by another one at once.
_FULL_BYTES = range(4000, 4097)
_MAX_READS = 16  # in a row: 64 kB, all that a kernel's buffer holds
_MAX_COALESCED = 2.0  # times real time: faster streams never let reads pause


class FrameSource(Protocol):
    """A live or recorded stream of frames, from a port or a file.

    An entry point of `radard.sources`, whose name is the port's scheme, is called with
    ``(target, options, *, speed)``: what stands behind the colon, up to the question mark and
    behind it, and stream seconds per real second for sources that can choose (None: as fast as
    possible). It returns one that is open, with its stream known, frames numbered from 0 and
    read-only, or raises a RadardError or X2RadarError of one line, with its exit code.
    """

    @property
    def stream(self) -> StreamInfo:
        """Axis and rate of the frames; a live one without a `run_id` is given one."""

    @property
    def is_live(self) -> bool:
        """Whether frames come from a device now (a simulated one is live)."""

    def frames(self) -> Iterator[Frame]:
        """Yield frames until the source ends."""

    def close(self) -> None:
        """Let go of the port or file; frames() then ends."""


def speed_factor(text: str, port: Port) -> float | None:
    """Return stream seconds per real second, None for all speed; or SettingsError."""
    if text == "auto":
        return None if port.kind == "replay" else 1.0
    return parse_speed(text)


def open_source(
    port: str,
    *,
    speed: str = "auto",
    wait: bool = False,
    quit_on_loss: bool = False,
    on_notice: Notify = lambda _kind, _reason: None,
    on_wait: Callable[[Callable[[], None]], object] = lambda _close: None,
    due_s: Callable[[], float] = lambda: math.inf,
) -> FrameSource:
    """Open what a port string names, as --port and --speed take them.

    With `wait` a port that is absent or denied is waited for, with `quit_on_loss` not one that
    goes away later. `on_notice` is called with ('lost' or 'found', reason) from the thread that
    reads frames; `on_wait`, before a device is waited for, is given what ends that wait, for any
    thread. `due_s` returns when the frame that completes a dwell should arrive
    (`FrameRing.due_s`): it is read in time. Raises X2RadarError or UsageError if it cannot be
    opened, or a plug-in is broken.
    """
    parsed = parse_port(port)
    factor = speed_factor(speed, parsed)
    scheme = _SCHEME.match(port) if parsed.kind == "live" else None
    if scheme and (plugin := find_plugin("radard.sources", scheme[1])) is not None:
        target = parsed.target.partition(":")[2]
        source: FrameSource = plugin.guard(
            lambda: plugin.made(target, parsed.options, speed=factor)
        )
        plugin.check(source, ("stream", "is_live", "frames", "close"))
        return source
    if parsed.kind == "replay":
        return ReplaySource(parsed, factor, on_notice)
    radar = make_radar(parsed, speed=factor)
    if factor is not None and factor <= _MAX_COALESCED:
        radar.wrap_transport(lambda inner: CoalescedReads(inner, due_s=due_s))
    device = ReconnectingRadar(radar, wait=wait, quit_on_loss=quit_on_loss)
    on_wait(device.close)
    return LiveSource(device, radar, on_notice)


class LiveSource:
    """Frames of a device, which is opened again when it was lost."""

    is_live = True

    def __init__(self, device: ReconnectingRadar, radar: X2Radar, on_notice: Notify) -> None:
        self._device = device
        self._on_notice = on_notice
        frames = self._read()
        if (first := next(frames, None)) is None:
            raise TransportClosed("closed before the first frame")
        self._frames = chain([first], frames)
        assert device.stream is not None  # noqa: S101 - known with the first frame
        self.stream: StreamInfo = device.stream
        self.module = module_of(radar.settings).name  # what sends the frames, by its maker

    def frames(self) -> Iterator[Frame]:
        """Yield frames, the first after a loss marked; raises if it is not waited for."""
        return self._frames

    @property
    def stats(self) -> RadarStats:
        """What the driver has counted up to now; for any thread."""
        return self._device.stats

    def close(self) -> None:
        self._device.close()

    def _read(self) -> Iterator[Frame]:
        for item in self._device.items():
            if isinstance(item, Frame):
                yield item
            elif item.kind in {"lost", "found"}:
                # Frames themselves carry gaps and restarts; repeats are dropped.
                self._on_notice(item.kind, item.reason)


class ReplaySource:
    """Frames of a recording, paced by their stream time."""

    is_live = False

    def __init__(
        self, port: Port, speed: float | None, on_notice: Notify = lambda _kind, _reason: None
    ) -> None:
        port.check_keys()
        self._start_s = port.number("start", 0.0)
        if self._start_s < 0:
            raise UsageError(f"port key 'start': {self._start_s:g} is negative")
        self._loop = port.number("loop", 0.0) > 0
        # Late: live sources must not wait for h5py at start.
        from x2radar.recording.registry import open_recording  # noqa: PLC0415

        self._reader = open_recording(port.target, kind=port.options.get("from"))
        self.stream = replace(self._reader.stream, run_id=self._reader.run_id)
        self._on_notice = on_notice
        self.warning = self._reader.warning
        self.started_utc = self._reader.started_utc
        end_s = self._reader.n_frames / self._reader.stream.frame_rate_hz
        if self._start_s >= end_s:
            msg = f"{port.target}: start={self._start_s:g} is behind its end ({end_s:.1f} s)"
            raise RecordingError(msg)
        self.playback = Playback(end_s, speed, lambda: on_notice("paused", "the replay is paused"))

    def frames(self) -> Iterator[Frame]:
        """Yield the recording's frames, again and again with loop=1."""
        for item in self.items():
            if isinstance(item, Frame):
                yield item
            else:
                time.sleep(item)

    def items(self) -> Iterator[Frame | float]:
        """Yield frames that are due; and while none is, in how many seconds one may be."""
        rate_hz, playback = self.stream.frame_rate_hz, self.playback
        start_s, offset, index = self._start_s, 0, -1
        while True:
            seek_s: float | None = None
            for n, frame in enumerate(self._reader.frames(start_s)):
                while wait_s := playback.wait_s(frame.index / rate_hz):
                    yield wait_s
                if playback.is_closed:
                    return
                if (seek_s := playback.take_seek()) is not None:
                    break
                # Where one round ends and the next begins, time does not go on smoothly.
                is_jump = n == 0 and index >= 0
                index = frame.index + offset
                if is_jump:
                    at_s = frame.index / rate_hz
                    self._on_notice("moved", f"the replay goes on at {at_s:.1f} s")
                lost = 0 if offset or is_jump else frame.lost
                is_new, due_s = is_jump or frame.restarted, playback.due_s
                # By itself: `replace` takes longer than the ring does.
                yield Frame(frame.samples, frame.counter, index, lost, is_new, frame.axis, due_s)
            if seek_s is not None:
                start_s = seek_s
                continue
            if not self._loop:
                return
            start_s, offset = 0.0, index + 1

    def close(self) -> None:
        self.playback.close()


class CoalescedReads:
    """A transport that is read less often, so that one wake-up takes many bytes.

    While a stream flows, reading pauses for `PAUSE_S`. Replies to commands never wait, and neither
    does the frame that completes a dwell: people wait for the decision.
    """

    def __init__(
        self,
        inner: Transport,
        *,
        due_s: Callable[[], float] = lambda: math.inf,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._inner = inner
        self._due_s = due_s
        self._clock = clock
        self._sleep = sleep
        self._next_s = 0.0
        self.is_usb = bool(getattr(inner, "is_usb", False))
        self.write, self.close = inner.write, inner.close

    def read(self, timeout_s: float) -> bytes:
        """Read from the inner transport; once a stream was found, only after the pause."""
        now_s = self._clock()
        wait_s, to_due_s = self._next_s - now_s, self._due_s() - now_s
        # A frame that does not come is lost; nothing is gained then by looking all the time.
        if to_due_s > -_LATE_S:
            wait_s = min(wait_s, to_due_s - _EARLY_S)
        if wait_s > 0:
            self._sleep(wait_s)
        data = part = self._inner.read(timeout_s)
        for _ in range(_MAX_READS):
            if len(part) not in _FULL_BYTES:
                break
            try:
                part = self._inner.read(timeout_s)
            except TransportClosed:
                # What was read counts; the next read meets the end again.
                break
            data += part
        flows = len(data) >= _FLOWS_BYTES
        self._next_s = self._clock() + PAUSE_S if flows else 0.0
        return data
