"""Closing: whatever has a `close` is a context manager that calls it."""

from typing import Self


class Closing:
    """Base of what is closed at the end of its `with` block."""

    def __enter__(self) -> Self:
        """Return the object itself, for `with ... as`."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it, whatever happened in the block."""
        self.close()

    def close(self) -> None:
        """Let go of what is held; a second call does nothing."""
        raise NotImplementedError
