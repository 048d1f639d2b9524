"""PictureThread: makes pictures of the running stream, on a thread of its own, while asked to.

It reads the ring (`FrameRing.recent`) instead of being called, so the reader and the worker do
not depend on it; what it is too slow for is left out and shows as a gap.
"""

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

from radard.dsp.pictures import Spectrograms
from radard.stream.ring import FrameRing, Recent
from radard.web.pictures.wire import axes, encode_columns, encode_gait

log = logging.getLogger("radard")
_EVERY_S = 0.125  # pictures move smoothly enough
_GAIT_EVERY_S = 0.5  # the gait picture spans two seconds
_MAX_BUSY = 0.5  # of a core: decisions come first

Emit = Callable[[bytes], None]
Announce = Callable[[dict[str, Any]], None]


class PictureThread:
    """Make pictures of the frames in a ring.

    Parameters
    ----------
    ring : callable
        Returns the ring, None before there is one.
    announce : callable
        Takes the axes (`radard.web.pictures.wire.axes`) of a stream before its first picture.
    emit : callable
        Takes every message.
    """

    def __init__(
        self, ring: Callable[[], FrameRing | None], announce: Announce, emit: Emit
    ) -> None:
        self._ring = ring
        self._announce = announce
        self._emit = emit
        self._is_wanted = threading.Event()
        self._is_ended = False
        self._thread: threading.Thread | None = None
        self._shown_ring: FrameRing | None = None
        self._spectrograms: Spectrograms | None = None
        self._end = self._begun_at = self._first = self._epoch = 0
        self._gait_s = 0.0

    def want(self, *, is_wanted: bool) -> None:
        """Start or stop to make pictures; returns at once."""
        if is_wanted and not self._is_ended:
            self._is_wanted.set()
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
                self._thread.start()
        else:
            self._is_wanted.clear()

    def close(self) -> None:
        """End the thread, soon."""
        self._is_ended = True
        self._is_wanted.set()

    def _run(self) -> None:
        while True:
            if not self._is_wanted.is_set():
                # What was shown last is stale when a page shows pictures again.
                self._shown_ring = None
                self._is_wanted.wait()
            if self._is_ended:
                return
            begun_s = time.monotonic()
            try:
                self._make_pictures()
            except Exception:
                # Pictures are a help; without them everything else goes on.
                log.exception("a picture could not be made")
                self._shown_ring = None
                time.sleep(5.0)
            spent_s = time.monotonic() - begun_s
            time.sleep(max(_EVERY_S - spent_s, spent_s * (1 - _MAX_BUSY) / _MAX_BUSY, 0.01))

    def _make_pictures(self) -> None:
        ring = self._ring()
        if ring is None:
            return
        if ring is not self._shown_ring or self._spectrograms is None:
            self._shown_ring = ring
            self._spectrograms = Spectrograms(ring.axis, ring.frame_rate_hz)
            self._end, self._begun_at = 0, -1
            self._announce(axes(self._spectrograms))
        recent = ring.recent(self._end)
        n = len(recent.frames)
        if n == 0:
            return
        if recent.begun_at != self._begun_at or recent.end_frame - n > self._end:
            self._spectrograms.restart()
            self._begun_at = recent.begun_at
            self._epoch, self._first = self._epoch + 1, 0
        self._end = recent.end_frame
        self._show(self._spectrograms, recent)

    def _show(self, spectrograms: Spectrograms, recent: Recent) -> None:
        n = len(recent.frames)
        rate_hz = self._shown_ring.frame_rate_hz if self._shown_ring else 1.0
        for at in range(0, n, spectrograms.longest_push):
            until = min(n, at + spectrograms.longest_push)
            t_s = recent.t_s - (n - until) / rate_hz
            columns = spectrograms.push(recent.frames[at:until], recent.valid[at:until], t_s)
            if columns is None:
                continue
            self._emit(
                encode_columns(
                    columns, first=self._first, epoch=self._epoch, column_s=spectrograms.column_s
                )
            )
            self._first += len(columns.valid)
            if abs(columns.t_s - self._gait_s) >= _GAIT_EVERY_S:
                self._gait_s = columns.t_s
                picture = spectrograms.gait()
                if picture is not None:
                    step = spectrograms.gait_step_hz
                    self._emit(
                        encode_gait(picture, epoch=self._epoch, step_hz=step, t_s=columns.t_s)
                    )
