"""Backoff: how long to wait before the next attempt."""

import zlib


class Backoff:
    """Waits that double, from `first_s` up to `longest_s` seconds, shifted by `name`."""

    def __init__(self, first_s: float, longest_s: float, name: str) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self._factor = 1.0 - zlib.crc32(name.encode(errors="surrogateescape")) % 1000 / 3000
        self._next_s = first_s

    def next_s(self) -> float:
        """Return the wait after one more failure, in seconds."""
        wait_s = self._next_s
        self._next_s = min(2 * wait_s, self._longest_s)
        return wait_s * self._factor

    def reset(self) -> None:
        """Start again with the first wait, after a success."""
        self._next_s = self._first_s
