"""A line that changes while a command works, on a terminal; nothing elsewhere."""

from typing import TextIO

_WIDTH = 30  # of the bar
_LINE = 78  # of it all: a terminal has 80


class ProgressLine:
    """One line on a terminal, usually of stderr: stdout carries data only."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._is_on = out.isatty()

    def show(self, share: float, text: str) -> None:
        """Show a bar that is filled to `share`, 0 to 1, and a few words."""
        if self._is_on:
            line = f"[{bar(share)}] {text}"[:_LINE]
            self._out.write(f"\r{line:<{_LINE}}")
            self._out.flush()

    def clear(self) -> None:
        """Take the line away, before something else is printed."""
        if self._is_on:
            self._out.write(f"\r{'':<{_LINE}}\r")
            self._out.flush()


def bar(share: float, width: int = _WIDTH) -> str:
    """Return a bar of `width` characters, filled to `share`, which is kept in 0 to 1."""
    n = round(min(max(share, 0.0), 1.0) * width)
    return "#" * n + "." * (width - n)
