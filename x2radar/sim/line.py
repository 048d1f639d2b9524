"""The line between module and port: it damages, delays, cuts and lumps what is sent.

Packets go in with the time they were made, bytes come out when they are due. Order is
always kept: what is held back holds back everything behind it.
"""

from collections import deque

import numpy as np

from x2radar.sim.faults import Dice, FaultPlan

_JUNK_MOST = 40
_STALL_EVERY_S = 10.0
# Lateness of the frames of one second, in frame periods, by counter modulo 20: measured on a
# real X2M200 at 20 Hz as 190, 145, 100, 55 and about 50 ms (protocol notes, section 3.3).
_LATE_FRAMES = {0: 3.8, 1: 2.9, 2: 2.0, 3: 1.1, 10: 1.0}


class Line:
    """A faulty line.

    Parameters
    ----------
    plan : FaultPlan
        What it does.
    dice : Dice
        Its draws.
    """

    def __init__(self, plan: FaultPlan, dice: Dice) -> None:
        self._plan = plan
        self._dice = dice
        self._queue: deque[tuple[float, bytes]] = deque()
        self._last_due_s = 0.0

    @property
    def next_due_s(self) -> float:
        """When the next bytes are due, in seconds of module time; inf for nothing."""
        return self._queue[0][0] if self._queue else float("inf")

    def put(self, packet: bytes, now_s: float, *, late_s: float = 0.0) -> None:
        """Take a packet that was made at `now_s` and leaves `late_s` later."""
        data = self._damaged(packet)
        due_s = max(self._held_s(now_s + late_s), self._last_due_s)
        self._last_due_s = due_s
        most = int(self._plan.value("split"))
        if not most:
            self._queue.append((due_s, data))
            return
        rng = self._dice.generator("split")
        while data:
            n = int(rng.integers(1, most + 1))
            self._queue.append((due_s, data[:n]))
            data = data[n:]

    def take(self, now_s: float) -> bytes:
        """Return the next piece that is due, or nothing."""
        return self._queue.popleft()[1] if self.next_due_s <= now_s else b""

    def frame_lateness_s(self, counter: int, frame_rate_hz: float) -> float:
        """Return how late a frame leaves, in seconds."""
        if not self._plan.value("bursts"):
            return 0.0
        return _LATE_FRAMES.get(counter % 20, 0.0) / frame_rate_hz

    def _held_s(self, due_s: float) -> float:
        if stall_s := self._plan.value("stall"):
            into_s = due_s % _STALL_EVERY_S
            if due_s >= _STALL_EVERY_S and into_s < stall_s:
                due_s += stall_s - into_s
        if lump_s := self._plan.value("merge"):
            due_s = float(np.ceil(due_s / lump_s) * lump_s)
        return due_s

    def _damaged(self, packet: bytes) -> bytes:
        dice = self._dice
        if dice.falls("junk"):
            rng = dice.generator("junk")
            packet = rng.bytes(int(rng.integers(1, _JUNK_MOST + 1))) + packet
        if share := self._plan.value("flip_bits"):
            rng = dice.generator("flip_bits")
            hit = rng.random(len(packet)) < share
            if hit.any():
                data = np.frombuffer(packet, np.uint8).copy()
                data[hit] ^= np.left_shift(1, rng.integers(0, 8, int(hit.sum()))).astype(np.uint8)
                packet = data.tobytes()
        if share := self._plan.value("drop_bytes"):
            kept = dice.generator("drop_bytes").random(len(packet)) >= share
            if not kept.all():
                packet = np.frombuffer(packet, np.uint8)[kept].tobytes()
        return packet
