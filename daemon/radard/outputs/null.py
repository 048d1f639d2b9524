"""A sink that drops everything."""

from radard.config.sink_table import SinkOptions
from radard.outputs.base import Record, SinkContext, SinkState


def open_from_url(_url: str, _options: SinkOptions, _context: SinkContext) -> "NullSink":
    """Return the sink of `null`."""
    return NullSink()


class NullSink:
    """Takes records and forgets them."""

    name = "null"
    waits = False
    state = SinkState()

    def write(self, record: Record) -> None:
        """Drop a record."""

    def finish(self, timeout_s: float | None = None) -> None:
        """Do nothing."""

    def close(self, timeout_s: float | None = None) -> None:
        """Do nothing."""
