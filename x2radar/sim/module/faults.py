"""What can go wrong on request: kinds of faults, their text form, and their dice.

A plan is written ``kind:value[,kind:value...]``; `KINDS` is the one table of kinds. Every kind
draws from its own generator, seeded with the module's seed and the kind's name: faults on frames
draw once a frame, whatever else goes wrong, those on the line once a packet or byte that is sent.
None looks at a clock.
"""

import zlib
from collections import deque
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from x2radar.errors import SettingsError
from x2radar.sim.signal.receiver import MIDDLE
from x2radar.wire.messages import ErrorReply, Message, Ping, Pong, Reset
from x2radar.wire.wire_ids import ErrorCode, PongCode

_SPIKE = 900.0  # far beyond the 0 to 100 of a frame
_SPIKES = 3  # samples of a frame that it meets, as a chip's do
_MAX_JUNK, _NEVER_S = 40, float("inf")
_STALL_EVERY_S = 10.0  # junk of a packet's length (docs/research/simulated-module.md)
# Lateness of the frames of one second, in frame periods, by counter modulo 20: measured on a
# real X2M200 at 20 Hz as 190, 145, 100, 55 and about 50 ms (protocol notes, section 3.3).
_LATE_FRAMES = {0: 3.8, 1: 2.9, 2: 2.0, 3: 1.1, 10: 1.0}


class Kind(NamedTuple):
    """One kind of fault: unit of its value, its least and most, what it does."""

    unit: str
    least: float
    most: float
    meaning: str
    is_whole: bool = False


_SHARE = (0.0, 1.0)
_MAX_S = 1e6  # eleven days, beyond any run
KINDS: Mapping[str, Kind] = {
    # On the line.
    "drop_bytes": Kind("per byte", *_SHARE, "bytes vanish"),
    "flip_bits": Kind("per byte", *_SHARE, "one bit of a byte is inverted"),
    "junk": Kind("per packet", *_SHARE, "1 to 40 random bytes before a packet"),
    "split": Kind(
        "bytes", 1, 65536, "output comes in pieces of 1 to so many bytes", is_whole=True
    ),
    "merge": Kind("seconds", 0.001, 60, "output is held back and comes in lumps this far apart"),
    "stall": Kind("seconds", 0.001, 9, "nothing comes for so long, every 10 s"),
    "bursts": Kind("1", 1, 1, "frames come late and in bunches, as measured on a real X2M200"),
    "silent": Kind("seconds", 0.001, _MAX_S, "then nothing is sent; the port stays open"),
    "hang_up": Kind("seconds", 0.001, _MAX_S, "then the port closes"),
    # In the module: frames.
    "drop_frames": Kind("per frame", *_SHARE, "a frame is not sent; its number is counted"),
    "duplicate": Kind("per frame", *_SHARE, "a frame is sent twice"),
    "spike": Kind("per frame", *_SHARE, "up to 3 samples lie far above the converter's top"),
    "clip": Kind("share of full scale", 0.001, 1, "the converter clips there, on both sides"),
    "counter_restart": Kind("per frame", *_SHARE, "the frame counter begins again at 1"),
    "reboot": Kind("per frame", *_SHARE, "the module restarts and streams again by itself"),
    # In the module: answers.
    "slow_ack": Kind("seconds", 0.001, 60, "every command is obeyed and answered so late"),
    "error_reply": Kind("per command", *_SHARE, "refused (command failed); never a ping"),
    "not_ready": Kind("seconds", 0.001, 600, "after boot: not ready, and READY never said"),
    "safe_mode": Kind("1", 1, 1, "pings say fail-safe; commands but a reset are refused"),
}
"""Every kind of fault. Seconds are module time, from power-on unless they say otherwise."""


FaultPlan = Mapping[str, float]
"""Which faults to make: values by kind."""


def parse_faults(text: str) -> FaultPlan:
    """Read ``kind:value[,kind:value...]``, units as in `KINDS`; or SettingsError."""
    values: dict[str, float] = {}
    for item in text.split(","):
        name, _, number = item.strip().partition(":")
        fault = "given twice" if name in values else _fault(name, number)
        if fault:
            raise SettingsError(f"fault {name!r}: {fault}; kinds are {', '.join(KINDS)}")
        values[name] = float(number)
    return values


def _fault(name: str, number: str) -> str:
    """Return what is wrong with one item, or nothing."""
    kind = KINDS.get(name)
    if kind is None:
        return "unknown"
    if not number.strip():
        return f"has no value; write {name}:VALUE ({kind.unit})"
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if not kind.least <= value <= kind.most or (kind.is_whole and value % 1):
        what = "whole number" if kind.is_whole else "value"
        return f"{number!r} is no {what} from {kind.least:g} to {kind.most:g} ({kind.unit})"
    return ""


def describe_faults() -> str:
    """Return the table of kinds as text, a line each."""
    return "\n".join(f"  {name:<15} {k.unit:<20} {k.meaning}" for name, k in KINDS.items())


class Faults:
    """What goes wrong by a plan: inside the module, frame by frame, and on the line to the host.

    The line damages, delays, cuts and lumps what is sent. Packets go in with the time they were
    made, bytes come out when they are due, in their order: what is held back holds back everything
    behind it.
    """

    def __init__(self, plan: FaultPlan, seed: int) -> None:
        self._plan = plan
        seeds = {kind: [seed, 0xFA17, zlib.crc32(kind.encode())] for kind in plan}
        self._rng = {kind: np.random.default_rng(own) for kind, own in seeds.items()}
        # From a command's arrival until it is obeyed, and from boot until pings answer READY.
        self.reply_delay_s = plan.get("slow_ack", 0.0)
        self.not_ready_s = plan.get("not_ready", 0.0)
        self.announces_ready = not (self.not_ready_s or plan.get("safe_mode"))
        self.max_piece = int(plan.get("split", 0))  # bytes that are sent at a time; 0: all
        self.hang_up_s = plan.get("hang_up", _NEVER_S)
        self._last_s = min(self.hang_up_s, plan.get("silent", _NEVER_S))
        self._queue: deque[tuple[float, bytes]] = deque()
        self._last_due_s = 0.0

    def frame(self, samples: np.ndarray) -> tuple[np.ndarray, int, bool, bool]:
        """Return a frame, how often it is sent, and whether counter and module begin again."""
        falls = self._falls
        restarts_counter, reboots = falls("counter_restart"), falls("reboot")
        n_copies = 1 + falls("duplicate")
        if falls("drop_frames"):
            n_copies = 0
        if level := self._plan.get("clip"):
            middle = np.float32(MIDDLE if samples.dtype == np.float32 else 0.0)
            reach = np.float32(level * MIDDLE)
            parts = np.clip(samples.view(np.float32) - middle, -reach, reach) + middle
            samples = parts.view(samples.dtype)
        if falls("spike"):
            samples = samples.copy()
            at = self._rng["spike"].integers(0, samples.size, _SPIKES)
            samples[at] += np.float32(_SPIKE)
        return samples, n_copies, restarts_counter, reboots

    def refusal(self, command: Message, *, is_ready: bool) -> Message | None:
        """Return what a module in trouble answers, or None when it obeys."""
        if self._plan.get("safe_mode"):
            if isinstance(command, Ping):
                return Pong(PongCode.SAFE_MODE)
            return None if isinstance(command, Reset) else ErrorReply(ErrorCode.COMMAND_FAILED)
        if isinstance(command, Ping):
            return None if is_ready else Pong(PongCode.NOT_READY)
        return ErrorReply(ErrorCode.COMMAND_FAILED) if self._falls("error_reply") else None

    @property
    def next_due_s(self) -> float:
        """When the next bytes are due, in seconds of module time; inf for nothing."""
        return self._queue[0][0] if self._queue else _NEVER_S

    def put(self, packet: bytes, made_s: float, *, late_s: float = 0.0) -> None:
        """Take a packet that was made at `made_s` and leaves `late_s` later."""
        due_s = max(self._held_s(made_s + late_s), self._last_due_s)
        self._last_due_s = due_s
        if due_s < self._last_s:
            self._queue.extend((due_s, piece) for piece in self._pieces(self._damaged(packet)))

    def due_bytes(self, now_s: float) -> bytes:
        """Return what is due, or nothing; of a line that splits, the next piece that is due."""
        due: list[bytes] = []
        while self._queue and self._queue[0][0] <= now_s and not (due and self.max_piece):
            due.append(self._queue.popleft()[1])
        return b"".join(due)

    def frame_lateness_s(self, counter: int, frame_rate_hz: float) -> float:
        """Return how late a frame leaves, in seconds."""
        late = _LATE_FRAMES.get(counter % 20, 0.0) if "bursts" in self._plan else 0.0
        return late / frame_rate_hz

    def _falls(self, kind: str) -> bool:
        """Draw once whether this fault happens now."""
        share = self._plan.get(kind, 0.0)
        return share > 0 and bool(self._rng[kind].random() < share)

    def _held_s(self, due_s: float) -> float:
        if lump_s := self._plan.get("merge"):
            due_s = float(np.ceil(due_s / lump_s) * lump_s)
        if stall_s := self._plan.get("stall"):
            into_s = due_s % _STALL_EVERY_S
            if due_s >= _STALL_EVERY_S and into_s < stall_s:
                due_s += stall_s - into_s
        return due_s

    def _pieces(self, data: bytes) -> Iterator[bytes]:
        most = self.max_piece
        while data:
            n = int(self._rng["split"].integers(1, most + 1)) if most else len(data)
            yield data[:n]
            data = data[n:]

    def _damaged(self, packet: bytes) -> bytes:
        if self._falls("junk"):
            rng = self._rng["junk"]
            packet = rng.bytes(int(rng.integers(1, _MAX_JUNK + 1))) + packet
        if share := self._plan.get("flip_bits"):
            rng = self._rng["flip_bits"]
            data = np.frombuffer(packet, np.uint8).copy()
            hit = rng.random(len(packet)) < share
            data[hit] ^= np.left_shift(1, rng.integers(0, 8, int(hit.sum()))).astype(np.uint8)
            packet = data.tobytes()
        if share := self._plan.get("drop_bytes"):
            is_kept = self._rng["drop_bytes"].random(len(packet)) >= share
            packet = np.frombuffer(packet, np.uint8)[is_kept].tobytes()
        return packet
