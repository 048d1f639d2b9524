"""Which records an output wants, and the body that far ends get of them."""

import json
from collections.abc import Callable, Sequence

from radard.sinks.base import Record


def wants_events(
    kinds: Sequence[str], phases: Sequence[str], others: Sequence[str] = ()
) -> Callable[[Record], bool]:
    """Return a function that says whether a record is wanted.

    Parameters
    ----------
    kinds, phases : sequence of str
        Events of these.
    others : sequence of str
        Further types of records.
    """

    def wants(record: Record) -> bool:
        if record["type"] == "event":
            return record["kind"] in kinds and record["phase"] in phases
        return record["type"] in others

    return wants


def body_of(sensor: str, record: Record) -> bytes:
    """Return the JSON of a record with the key `sensor` in front, for who knows no topics."""
    return json.dumps({"sensor": sensor, **record}, separators=(",", ":")).encode("ascii")
