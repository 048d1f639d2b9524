"""A sink that drops everything."""

from radard.sinks.base import Record, SinkState


class NullSink:
    """Takes records and forgets them."""

    name = "null"
    waits = False
    state = SinkState()

    def write(self, record: Record) -> None:
        """Forget a record."""

    def finish(self, timeout_s: float | None = None) -> None:
        """Do nothing."""

    def close(self, timeout_s: float | None = None) -> None:
        """Do nothing."""
