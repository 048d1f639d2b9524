"""What can go wrong on request: kinds of faults, their text form, and their dice.

A plan is written ``kind:value[,kind:value...]``; `KINDS` is the one table of kinds. Every kind
draws from its own generator, seeded with the module's seed and the kind's name: faults on frames
draw once a frame, whatever else goes wrong, those on the line once a packet or byte that is sent.
None looks at a clock. `ModuleFaults` is what goes wrong inside the module, `line` the rest.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from x2radar.errors import SettingsError
from x2radar.sim.signal.receiver import MIDDLE
from x2radar.wire.messages import ErrorReply, Message, Ping, Pong, Reset
from x2radar.wire.wire_ids import ErrorCode, PongCode

_SPIKE = 900.0  # far beyond the 0 to 100 of a frame
_SPIKES = 3  # samples of a frame that it meets, as a chip's do


@dataclass(frozen=True, slots=True)
class Kind:
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
        if fault := _fault(name, number, values):
            raise SettingsError(f"fault {name!r}: {fault}; kinds are {', '.join(KINDS)}")
        values[name] = float(number)
    return values


def _fault(name: str, number: str, values: Mapping[str, float]) -> str:
    """Return what is wrong with one item, or nothing."""
    kind = KINDS.get(name)
    if kind is None:
        return "unknown"
    if name in values:
        return "given twice"
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


class Dice:
    """Random generators, one for each kind of fault."""

    def __init__(self, plan: FaultPlan, seed: int) -> None:
        self.plan = plan
        self._generators = {
            kind: np.random.default_rng([seed, 0xFA17, zlib.crc32(kind.encode())]) for kind in plan
        }

    def generator(self, kind: str) -> np.random.Generator:
        """Return the generator of a kind that the plan has."""
        return self._generators[kind]

    def falls(self, kind: str) -> bool:
        """Draw once whether this fault happens now."""
        share = self.plan.get(kind, 0.0)
        return share > 0 and bool(self._generators[kind].random() < share)


_ON_FRAMES = {"drop_frames", "duplicate", "spike", "clip", "counter_restart", "reboot"}


class ModuleFaults:
    """Faults inside the module, frame by frame."""

    def __init__(self, dice: Dice) -> None:
        self._plan = plan = dice.plan
        self._dice = dice
        self._touches_frames = not _ON_FRAMES.isdisjoint(plan)
        # From a command's arrival until it is obeyed, and from boot until pings answer READY.
        self.reply_delay_s = plan.get("slow_ack", 0.0)
        self.not_ready_s = plan.get("not_ready", 0.0)
        self.announces_ready = not (self.not_ready_s or plan.get("safe_mode"))

    def frame(self, samples: np.ndarray) -> tuple[np.ndarray, int, bool, bool]:
        """Return a frame as the module makes it, and how often it is sent.

        And whether the counter begins again, and the module restarts.
        """
        if not self._touches_frames:
            return samples, 1, False, False
        falls = self._dice.falls
        restarts_counter, reboots = falls("counter_restart"), falls("reboot")
        n_copies = 1 + falls("duplicate")
        if falls("drop_frames"):
            n_copies = 0
        return self._converted(samples), n_copies, restarts_counter, reboots

    def refusal(self, command: Message, *, is_ready: bool) -> Message | None:
        """Return what a module in trouble answers, or None when it obeys."""
        if self._plan.get("safe_mode"):
            if isinstance(command, Ping):
                return Pong(PongCode.SAFE_MODE)
            return None if isinstance(command, Reset) else ErrorReply(ErrorCode.COMMAND_FAILED)
        if isinstance(command, Ping):
            return None if is_ready else Pong(PongCode.NOT_READY)
        return ErrorReply(ErrorCode.COMMAND_FAILED) if self._dice.falls("error_reply") else None

    def _converted(self, samples: np.ndarray) -> np.ndarray:
        """Put in what a misbehaving converter does."""
        if level := self._plan.get("clip"):
            middle = np.float32(MIDDLE if samples.dtype == np.float32 else 0.0)
            reach = np.float32(level * MIDDLE)
            parts = np.clip(samples.view(np.float32) - middle, -reach, reach) + middle
            samples = parts.view(samples.dtype)
        if self._dice.falls("spike"):
            at = self._dice.generator("spike").integers(0, samples.size, _SPIKES)
            samples = samples.copy()
            samples[at] += np.float32(_SPIKE)
        return samples
