"""PictureThread: makes pictures of the running stream, on a thread of its own, while asked to.

It reads the ring (`FrameRing.recent`) instead of being called, so the reader and the worker do
not depend on it; what it is too slow for is left out and shows as a gap. While nobody looks it
only keeps the frames of the last half minute, which a page gets first when it opens.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from radard.dsp.pictures import Spectrograms
from radard.stream.ring import FrameRing, Recent
from radard.web.pictures.wire import axes, encode_columns, encode_gait

log = logging.getLogger("radard")
_EVERY_S = 0.125  # pictures move smoothly enough
_KEEP_EVERY_S = 1.0  # less than a ring holds
_KEPT_S = 30.0  # as much as a page shows
_GAIT_EVERY_S = 0.5  # the gait picture spans two seconds
_AFTER_FAULT_S = 5.0
_MAX_BUSY = 0.5  # of a core: decisions come first


@dataclass(eq=False)
class PictureThread:
    """Make pictures of a `ring`'s frames; `announce` takes their axes, `emit` messages."""

    ring: Callable[[], FrameRing | None]
    announce: Callable[[dict[str, Any]], None]
    emit: Callable[[bytes], None]

    def __post_init__(self) -> None:
        self._changed = threading.Event()
        # Each wish is another object: who opens the page again begins again.
        self._wish: object | None = None
        self._shown_wish: object | None = None
        self._is_ended = False
        self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
        self._shown_ring: FrameRing | None = None
        self._spectrograms: Spectrograms | None = None
        self._kept: deque[Recent] = deque()
        self._waiting: deque[Recent] = deque()
        self._end = self._shown_to = self._begun_at = self._first = self._epoch = 0
        self._gait_s = 0.0

    def start(self) -> None:
        """Begin to keep frames; returns at once."""
        self._thread.start()

    def want(self, *, is_wanted: bool) -> None:
        """Start or stop to make pictures; returns at once."""
        self._wish = object() if is_wanted else None
        self._changed.set()

    def close(self) -> None:
        """End the thread, soon."""
        self._is_ended = True
        self._changed.set()

    def _run(self) -> None:
        pause_s = 0.0
        while True:
            self._changed.wait(pause_s)
            self._changed.clear()
            if self._is_ended:
                return
            wish = self._wish
            begun_s = time.monotonic()
            try:
                self._look(wish)
            except Exception:
                # Pictures are a help; without them everything else goes on.
                log.exception("a picture could not be made")
                self._shown_ring = None
                self._waiting.clear()
                begun_s += _AFTER_FAULT_S  # go on that much later
            spent_s = time.monotonic() - begun_s
            every_s = 0.0 if self._waiting else _EVERY_S if wish else _KEEP_EVERY_S
            pause_s = max(every_s - spent_s, spent_s * (1 - _MAX_BUSY) / _MAX_BUSY, 0.01)

    def _look(self, wish: object | None) -> None:
        """Keep what has come since; of what a page is still to see, show the next part."""
        ring = self.ring()
        if ring is None:
            return
        if ring is not self._shown_ring:
            self._shown_ring, self._end = ring, 0
            self._kept.clear()
            self._shown_wish = None
        if wish is not self._shown_wish:
            self._waiting.clear()
        if not self._waiting:
            recent = ring.recent(self._end, is_live=wish is not None)
            self._end = recent.end_frame
            if len(recent.frames):
                self._kept.append(recent)
                self._waiting.append(recent)
            while self._kept and self._kept[0].t_s < recent.t_s - _KEPT_S:
                self._kept.popleft()
        if wish is None:
            self._waiting.clear()
        elif wish is not self._shown_wish or self._spectrograms is None:
            self._spectrograms = Spectrograms(ring.axis, ring.frame_rate_hz)
            self._waiting = deque(self._kept)
            self._shown_to, self._begun_at = 0, -1
            self.announce(axes(self._spectrograms))
        self._shown_wish = wish
        if self._waiting and self._spectrograms is not None:
            self._show(self._spectrograms, self._waiting.popleft(), ring.frame_rate_hz)

    def _show(self, spectrograms: Spectrograms, recent: Recent, rate_hz: float) -> None:
        n = len(recent.frames)
        if recent.begun_at != self._begun_at or recent.end_frame - n > self._shown_to:
            spectrograms.restart()
            self._begun_at = recent.begun_at
            self._epoch, self._first = self._epoch + 1, 0
        self._shown_to = recent.end_frame
        for at in range(0, n, spectrograms.longest_push):
            until = min(n, at + spectrograms.longest_push)
            t_s = recent.t_s - (n - until) / rate_hz
            columns = spectrograms.push(recent.frames[at:until], recent.valid[at:until], t_s)
            if columns is None:
                continue
            which = {"first": self._first, "epoch": self._epoch}
            self.emit(encode_columns(columns, **which, column_s=spectrograms.column_s))
            self._first += len(columns.valid)
            # Of what was before, only the last gait is shown.
            if not self._waiting and abs(columns.t_s - self._gait_s) >= _GAIT_EVERY_S:
                self._gait_s = columns.t_s
                if (picture := spectrograms.gait()) is not None:
                    step = {"step_hz": spectrograms.gait_step_hz, "t_s": columns.t_s}
                    self.emit(encode_gait(picture, epoch=self._epoch, **step))
