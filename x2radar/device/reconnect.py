"""ReconnectingRadar: a radar that comes back, and says so; time is never stitched silently."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from x2radar import errors
from x2radar.backoff import Backoff
from x2radar.device.device import RadarStats, X2Radar
from x2radar.frame import Closing, Frame, StreamInfo

EventKind = Literal["lost", "found", "gap", "repeat", "restart"]
_LOSSES = (errors.PortError, errors.TransportClosed, errors.ReadTimeout, errors.DeviceError)


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamEvent:
    """Something that happened to a stream between two frames."""

    kind: EventKind
    """The device is away ('lost'), for `reason`. It is back ('found'). Frames are missing before
    the next one ('gap'). Frames came twice and were dropped ('repeat'). The counter or the module
    restarted ('restart'): how much time passed is unknown, as it is after 'found'."""
    reason: str
    n_frames: int = 0
    """Frames missing or repeated, else 0."""
    t_mono_s: float = 0.0
    """Host's monotonic clock, in seconds."""


_FIRST_S, _LONGEST_S = 0.25, 2.0
"""Pauses between attempts to open a device: a module that is back must not be blind for longer;
to look for a port costs nothing."""
_STABLE_S = 10.0
"""After a stream of so many seconds the pauses are short again; a device that is lost sooner again
and again is left alone longer and longer."""


class ReconnectingRadar(Closing):
    """Frames of a device that is opened again whenever it was lost.

    `radar` is not opened yet; it is opened, reopened and closed here, when the first item is
    asked for. `wait` waits also for a device that is absent at first; `quit_on_loss` raises when
    it is lost later. Tests give their own `clock` (seconds) and `sleep`, which by default `close`
    ends at once.
    """

    def __init__(
        self,
        radar: X2Radar,
        *,
        wait: bool = False,
        quit_on_loss: bool = False,
        backoff: Backoff | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        self._radar = radar
        self._wait = wait
        self._quit_on_loss = quit_on_loss
        self._backoff = backoff or Backoff(_FIRST_S, _LONGEST_S, radar.name)
        self._clock = clock
        self._halt = threading.Event()
        self._sleep = sleep or self._halt.wait
        self._n_repeated = 0
        self._is_found = False
        self._told = ""

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over `frames`."""
        return self.frames()

    @property
    def stats(self) -> RadarStats:
        """Counts up to now: a snapshot."""
        return self._radar.stats

    @property
    def stream(self) -> StreamInfo | None:
        """What holds for every frame; known with the first one."""
        return self._radar.stream

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of `items` alone; `restarted` and `lost` still say where time jumps."""
        for item in self.items():
            if isinstance(item, Frame):
                yield item

    def items(self) -> Iterator[Frame | StreamEvent]:
        """Open the device; yield its frames, and in between what happened, until `close`.

        In order; frame numbers go on over a loss. Every frame with `restarted` stands behind a
        'found' or a 'restart', every frame with `lost` behind a 'gap'. To be called once. Raises
        what went wrong: at first unless `wait`, later with `quit_on_loss`.
        """
        was_there = False
        try:
            while not self._halt.is_set():
                try:
                    if not was_there:
                        self._radar.open(halt=self._halt)
                        was_there = True
                    yield from self._streamed()
                except _LOSSES as err:
                    if self._halt.is_set():
                        return
                    is_refused = not self._wait or isinstance(err, errors.NoPort)
                    if self._quit_on_loss if was_there else is_refused:
                        raise
                    yield from self._found_again(err)
                    was_there = True
        finally:
            self._radar.close()

    def close(self) -> None:
        """Close the device, or end the wait for it, at once; from any thread."""
        self._halt.set()
        self._radar.close()

    def _found_again(self, err: errors.X2RadarError) -> Iterator[StreamEvent]:
        """Say that the device is lost, and open it again."""
        while True:
            # First, because a listener to the loss may look at the port.
            self._radar.close()
            if (reason := str(err)) != self._told:
                self._told = reason
                yield self._event("lost", reason)
            self._sleep(self._backoff.next_s())
            if self._halt.is_set():
                return
            try:
                self._radar.reopen(halt=self._halt)
            except _LOSSES as again:
                err = again
            else:
                self._is_found = True
                return

    def _streamed(self) -> Iterator[Frame | StreamEvent]:
        begun_s = self._clock()
        try:
            for frame in self._radar.frames():
                yield from self._said(frame)
                yield frame
        finally:
            if self._clock() - begun_s >= _STABLE_S:
                self._backoff.reset()

    def _said(self, frame: Frame) -> Iterator[StreamEvent]:
        """Yield what there is to say before `frame`."""
        repeated = self._radar.stats.repeated
        if more := repeated - self._n_repeated:
            self._n_repeated = repeated
            yield self._event("repeat", f"{more} frames came twice", more)
        if self._is_found:
            # Only now: a device that answers but sends nothing is not back.
            self._is_found, self._told = False, ""
            yield self._event("found", f"{self._radar.name} sends frames again")
        elif frame.restarted:
            yield self._event("restart", f"the frame counter restarts at {frame.counter}")
        if frame.lost:
            yield self._event("gap", f"{frame.lost} frames lost", frame.lost)

    def _event(self, kind: EventKind, reason: str, n_frames: int = 0) -> StreamEvent:
        return StreamEvent(kind=kind, reason=reason, n_frames=n_frames, t_mono_s=self._clock())
