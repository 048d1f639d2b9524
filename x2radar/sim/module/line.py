"""The line between module and port: it damages, delays, cuts and lumps what is sent.

Packets go in with the time they were made, bytes come out when they are due. Order is
always kept: what is held back holds back everything behind it.
"""

from collections import deque
from collections.abc import Iterator

import numpy as np

from x2radar.sim.module.faults import Dice

_ON_LINE = {
    *("drop_bytes", "flip_bits", "junk"),
    *("split", "merge", "stall", "bursts", "silent", "hang_up"),
}
_MAX_JUNK, _NEVER_S = 40, float("inf")
_STALL_EVERY_S = 10.0  # junk of a packet's length (docs/research/simulated-module.md)
# Lateness of the frames of one second, in frame periods, by counter modulo 20: measured on a
# real X2M200 at 20 Hz as 190, 145, 100, 55 and about 50 ms (protocol notes, section 3.3).
_LATE_FRAMES = {0: 3.8, 1: 2.9, 2: 2.0, 3: 1.1, 10: 1.0}


class Line:
    """The serial line from the simulated module to the host, with its faults."""

    def __init__(self, dice: Dice) -> None:
        self._plan = plan = dice.plan
        self._dice = dice
        self._is_clean = _ON_LINE.isdisjoint(plan)
        self.max_piece = int(plan.get("split", 0))  # bytes that are sent at a time; 0: all
        self._hang_up_s = plan.get("hang_up", _NEVER_S)
        self._last_s = min(self._hang_up_s, plan.get("silent", _NEVER_S))
        self._queue: deque[tuple[float, bytes]] = deque()
        self._last_due_s = 0.0

    @property
    def next_due_s(self) -> float:
        """When the next bytes are due, in seconds of module time; inf for nothing."""
        return self._queue[0][0] if self._queue else _NEVER_S

    def is_closed(self, now_s: float) -> bool:
        """Return whether the line has been cut."""
        return now_s >= self._hang_up_s

    def put(self, packet: bytes, made_s: float, *, late_s: float = 0.0) -> None:
        """Take a packet that was made at `made_s` and leaves `late_s` later."""
        if self._is_clean:
            self._queue.append((made_s, packet))
            return
        due_s = max(self._held_s(made_s + late_s), self._last_due_s)
        self._last_due_s = due_s
        if due_s < self._last_s:
            self._queue.extend((due_s, piece) for piece in self._pieces(self._damaged(packet)))

    def due_bytes(self, now_s: float) -> bytes:
        """Return what is due, or nothing; of a line that splits, the next piece that is due."""
        queue = self._queue
        if not queue or queue[0][0] > now_s:
            return b""
        first = queue.popleft()[1]
        if self.max_piece or not queue or queue[0][0] > now_s:
            return first
        due = [first]
        while queue and queue[0][0] <= now_s:
            due.append(queue.popleft()[1])
        return b"".join(due)

    def frame_lateness_s(self, counter: int, frame_rate_hz: float) -> float:
        """Return how late a frame leaves, in seconds."""
        if not self._plan.get("bursts"):
            return 0.0
        return _LATE_FRAMES.get(counter % 20, 0.0) / frame_rate_hz

    def _held_s(self, due_s: float) -> float:
        if lump_s := self._plan.get("merge"):
            due_s = float(np.ceil(due_s / lump_s) * lump_s)
        if stall_s := self._plan.get("stall"):
            into_s = due_s % _STALL_EVERY_S
            if due_s >= _STALL_EVERY_S and into_s < stall_s:
                due_s += stall_s - into_s
        return due_s

    def _pieces(self, data: bytes) -> Iterator[bytes]:
        if not self.max_piece:
            yield data
            return
        rng = self._dice.generator("split")
        at = 0
        while at < len(data):
            n = int(rng.integers(1, self.max_piece + 1))
            yield data[at : at + n]
            at += n

    def _damaged(self, packet: bytes) -> bytes:
        dice = self._dice
        if dice.falls("junk"):
            rng = dice.generator("junk")
            packet = rng.bytes(int(rng.integers(1, _MAX_JUNK + 1))) + packet
        if share := self._plan.get("flip_bits"):
            rng = dice.generator("flip_bits")
            hit = rng.random(len(packet)) < share
            if hit.any():
                data = np.frombuffer(packet, np.uint8).copy()
                data[hit] ^= np.left_shift(1, rng.integers(0, 8, int(hit.sum()))).astype(np.uint8)
                packet = data.tobytes()
        if share := self._plan.get("drop_bytes"):
            kept = dice.generator("drop_bytes").random(len(packet)) >= share
            if not kept.all():
                packet = np.frombuffer(packet, np.uint8)[kept].tobytes()
        return packet
