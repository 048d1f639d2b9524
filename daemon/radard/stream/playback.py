"""Playback: play, pause, seek and speed of a replay, for the thread that reads it and others."""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

SLOWEST, FASTEST = 0.25, 64.0  # what a person can follow, and an hour in a minute
_REMIND_S = 2.0  # below the 5 s after which health calls a stream stale
TICK_S = 0.1
"""A paced replay hands out frames so often: each at most that late, all in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaybackState:
    """Position, length and speed of a replay."""

    position_s: float
    length_s: float
    is_playing: bool
    speed: float | None


class Playback:
    """Paces the frames of a recording; commands come from any thread.

    `on_pause` is called by the reading thread when it pauses, and every 2 s while it does.
    """

    def __init__(
        self, length_s: float, speed: float | None, on_pause: Callable[[], None] = lambda: None
    ) -> None:
        self._length_s = length_s
        self._on_pause = on_pause
        self._changed = threading.Condition()
        self._speed = speed
        self._is_playing = True
        self._is_closed = False
        self._position_s = 0.0
        self._seek_s: float | None = None
        self._anchor: tuple[float, float] | None = None

    @property
    def state(self) -> PlaybackState:
        """Position and speed at this moment; after a seek the place that was asked for."""
        with self._changed:
            return PlaybackState(
                position_s=self._position_s if self._seek_s is None else self._seek_s,
                length_s=self._length_s,
                is_playing=self._is_playing,
                speed=self._speed,
            )

    @property
    def is_paced(self) -> bool:
        """Whether frames come at a speed, so that the time of their arrival means something."""
        return self._speed is not None

    def play(self) -> None:
        """Go on after a pause."""
        self._set(is_playing=True)

    def pause(self) -> None:
        """Stand still before the next frame."""
        self._set(is_playing=False)

    def set_speed(self, speed: float | None) -> None:
        """Go faster or slower; raises ValueError outside of 0.25 to 64 (None: no limit)."""
        if speed is not None and not SLOWEST <= speed <= FASTEST:
            msg = f"speed {speed:g}: must be {SLOWEST:g} to {FASTEST:g}, or none for no limit"
            raise ValueError(msg)
        with self._changed:
            self._speed, self._anchor = speed, None
            self._changed.notify_all()

    def seek(self, position_s: float) -> None:
        """Go on from elsewhere; raises ValueError outside of the recording."""
        if not 0 <= position_s < self._length_s:
            msg = f"position {position_s:g} s: the recording has {self._length_s:.1f} s"
            raise ValueError(msg)
        with self._changed:
            self._seek_s = position_s
            self._changed.notify_all()

    def close(self) -> None:
        """Let the reading thread go; it stands still no more."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def pace(self, position_s: float) -> float | None:
        """Wait until the frame at a position on the recording's clock is due.

        Return where to read on instead, if somebody has asked for that.
        """
        with self._changed:
            if position_s < self._position_s:
                # A new round of a recording that loops.
                self._anchor = None
            self._position_s = position_s
            while not self._is_closed:
                if self._seek_s is not None:
                    target, self._seek_s, self._anchor = self._seek_s, None, None
                    return target
                wait_s = self._wait_s(position_s)
                if wait_s <= 0:
                    break
                if not self._is_playing:
                    self._on_pause()
                self._changed.wait(wait_s)
        return None

    def _wait_s(self, position_s: float) -> float:
        if not self._is_playing:
            return _REMIND_S
        if self._speed is None:
            return 0.0
        now_s = time.monotonic()
        if self._anchor is None:
            self._anchor = (now_s, position_s)
        begun_s, first_s = self._anchor
        after_s = (position_s - first_s) / self._speed
        return begun_s + TICK_S * math.ceil(after_s / TICK_S) - now_s

    def _set(self, *, is_playing: bool) -> None:
        with self._changed:
            self._is_playing, self._anchor = is_playing, None
            self._changed.notify_all()
