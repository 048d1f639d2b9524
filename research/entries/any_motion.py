"""A plain motion detector: whatever moves is an alarm.

Source: this project's gate, without any network. It says what the task is without classification.
"""

from collections.abc import Iterator

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.judge.evidence import HOP_S
from radard.stream.ring import Dwell

TITLE = "any motion"


def alarms(windows: Iterator[Dwell]) -> Iterator[bool]:
    """Yield whether anything moves, for every window."""
    remover, gate = ClutterRemover(), Gate(GateSettings(), HOP_S)
    for window in windows:
        yield gate.read(remover.remove(window)).is_open
