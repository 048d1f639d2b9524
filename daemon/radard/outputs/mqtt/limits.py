"""PacketLimits: which messages a broker does not take, so that they hold up no others.

MQTT 5 lets a broker state its largest packet. One of 3.1.1 drops the line instead, and says
nothing: then the largest message in flight is to blame, and after the second time it is left out.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from radard.outputs.mqtt.topics import Publication

_HEAD = 12  # bytes of a packet beside topic and payload, at most
_MIN_SUSPECT = 1024  # no broker limits packets to less; events and states are below it
_BREAKS = 2  # one may have had another cause
_FORGOTTEN_S = 86_400.0  # a broker may have been set right since


@dataclass(slots=True)
class _Suspect:
    """The largest message of a topic that was in flight when a line broke."""

    size: int
    n: int
    at_s: float


class PacketLimits:
    """Learn what a broker takes; any thread may ask. `say` is told what is left out, once."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._flying: list[tuple[str, int, Callable[[], bool]]] = []
        self._suspects: dict[str, _Suspect] = {}
        self._said: set[str] = set()
        self.max_bytes: int | None = None
        """The largest packet that the broker states; None: it states none."""

    @property
    def is_idle(self) -> bool:
        """Whether everything that was sent is confirmed."""
        self._flying = [each for each in self._flying if not each[2]()]
        return not self._flying

    def takes(self, message: Publication) -> bool:
        """Return whether to send a message."""
        size, suspect = _size_of(message), self._suspects.get(message.topic)
        if self.max_bytes is not None and size > self.max_bytes:
            self._leave_out(message.topic, f"{size} bytes, and the broker takes {self.max_bytes}")
            return False
        is_bad = suspect is not None and suspect.n >= _BREAKS and size >= suspect.size
        return not is_bad

    def sent(self, message: Publication, is_done: Callable[[], bool]) -> None:
        """Note a message in flight, until `is_done` says that it is confirmed."""
        self._flying = [each for each in self._flying if not each[2]()]
        self._flying.append((message.topic, _size_of(message), is_done))

    def broke(self) -> bool:
        """Note that the line broke; return whether a message is to blame."""
        flying, self._flying = [each for each in self._flying if not each[2]()], []
        topic, size, _ = max(flying, key=lambda each: each[1], default=("", 0, None))
        if size < _MIN_SUSPECT:
            return False
        now_s, before = time.monotonic(), self._suspects.get(topic)
        is_again = before is not None and now_s - before.at_s < _FORGOTTEN_S
        n = before.n + 1 if before is not None and is_again else 1
        self._suspects[topic] = _Suspect(size, n, now_s)
        if n >= _BREAKS:
            self._leave_out(topic, f"the line broke {n} times while its {size} bytes were sent")
        return True

    def _leave_out(self, topic: str, why: str) -> None:
        if topic not in self._said:
            self._said.add(topic)
            self._say(f"{topic} is left out: {why}")


def _size_of(message: Publication) -> int:
    payload = message.payload
    n = len(payload.encode() if isinstance(payload, str) else payload)
    return len(message.topic.encode()) + n + _HEAD
