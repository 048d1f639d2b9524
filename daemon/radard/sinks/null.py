"""A sink that drops everything."""

from radard.output import Record


class NullSink:
    """Takes records and forgets them."""

    def write(self, record: Record) -> None:
        """Forget a record."""

    def close(self) -> None:
        """Do nothing."""
