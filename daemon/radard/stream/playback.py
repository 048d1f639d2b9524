"""Playback: play, pause, seek and speed of a replay, for the thread that reads it and others.

It says when a frame is due and never waits for that itself, so that one thread can read many.
"""

import math
import threading
import time
from collections.abc import Callable

SLOWEST, FASTEST = 0.25, 64.0  # what a person can follow, and an hour in a minute
_REMIND_S = 2.0  # below the 5 s after which health calls a stream stale
TICK_S = 0.1  # a paced replay hands out frames so often: each at most that late, all in order


class Playback:
    """Paces the frames of a recording; the reading thread calls `on_pause` while it pauses."""

    def __init__(
        self, length_s: float, speed: float | None, on_pause: Callable[[], None] = lambda: None
    ) -> None:
        self._length_s = length_s
        self._on_pause = on_pause
        self._lock = threading.Lock()
        self.speed = speed  # None: no limit
        self._is_playing, self.is_closed = True, False
        self._position_s = 0.0
        self._seek_s: float | None = None
        self._anchor: tuple[float, float] | None = None
        self.begin_s = 0.0  # no frame is due before, monotonic
        self.on_change: Callable[[], object] = lambda: None
        """Called whenever what `wait_s` said may hold no more; from any thread."""
        self.due_s = 0.0  # monotonic, of the frame last asked for; 0: arrival means nothing

    @property
    def state(self) -> dict[str, float | None]:
        """What holds now, as pages have it; after a seek the place that was asked for."""
        with self._lock:
            position_s = self._position_s if self._seek_s is None else self._seek_s
            times = {"position_s": round(position_s, 2), "length_s": round(self._length_s, 2)}
            return {**times, "is_playing": self._is_playing, "speed": self.speed}

    def play(self, *, is_playing: bool = True) -> None:
        """Go on after a pause; or stand still before the next frame."""
        with self._lock:
            self._is_playing, self._anchor = is_playing, None
        self.on_change()

    def set_speed(self, speed: float | None) -> None:
        """Go faster or slower; raises ValueError outside of 0.25 to 64 (None: no limit)."""
        if speed is not None and not SLOWEST <= speed <= FASTEST:
            msg = f"speed {speed:g}: must be {SLOWEST:g} to {FASTEST:g}, or none for no limit"
            raise ValueError(msg)
        with self._lock:
            self.speed, self._anchor = speed, None
        self.on_change()

    def seek(self, position_s: float) -> None:
        """Go on from elsewhere; raises ValueError outside of the recording."""
        if not 0 <= position_s < self._length_s:
            msg = f"position {position_s:g} s: the recording has {self._length_s:.1f} s"
            raise ValueError(msg)
        self._seek_s = position_s
        self.on_change()

    def close(self) -> None:
        """Let the reading thread go; it stands still no more."""
        self.is_closed = True
        self.on_change()

    def wait_s(self, position_s: float) -> float:
        """Return in how many seconds a frame may be due; 0 now, to go elsewhere, or closed."""
        with self._lock:
            if position_s < self._position_s and self._anchor is not None and self.speed:
                # A new round of a recording that loops: it follows on the last, however late.
                begun_s, first_s = self._anchor
                begun_s += (self._position_s - first_s) / self.speed
                self._anchor = begun_s, position_s
            self._position_s = position_s
            if self.is_closed or self._seek_s is not None:
                return 0.0
            if self._is_playing:
                return self._left_s(position_s)
        self._on_pause()
        return _REMIND_S

    def take_seek(self) -> float | None:
        """Return where to read on instead, if somebody has asked for that since."""
        if self._seek_s is None:
            return None
        with self._lock:
            target, self._seek_s, self._anchor = self._seek_s, None, None
            return target

    def _left_s(self, position_s: float) -> float:
        if self.speed is None:
            self.due_s = 0.0
            return 0.0
        now_s = time.monotonic()
        if self._anchor is None:
            self._anchor = (max(now_s, self.begin_s), position_s)
        begun_s, first_s = self._anchor
        after_s = (position_s - first_s) / self.speed
        self.due_s = begun_s + TICK_S * math.ceil(after_s / TICK_S)
        return max(0.0, self.due_s - now_s)
