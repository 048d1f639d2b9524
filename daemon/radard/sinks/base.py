"""The contract of a sink."""

from typing import Protocol

from radard.output import Record


class Sink(Protocol):
    """Takes records in order."""

    def write(self, record: Record) -> None:
        """Take one record; raises OutputError when it cannot be kept."""
        ...

    def close(self) -> None:
        """Write what is left and let go; a second call does nothing."""
        ...
