"""What can go wrong on request: kinds of faults, their text form, and their dice.

A plan is written ``kind:value[,kind:value...]``. `KINDS` is the one table of kinds, with
unit and meaning. Every kind draws from its own generator, seeded with the module's seed and
the kind, so one fault's draws do not depend on another's, nor on how the host reads.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from x2radar.errors import SettingsError


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault: unit of its value, its least and most, what it does."""

    unit: str
    least: float
    most: float
    meaning: str


_SHARE = (0.0, 1.0)
KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "drop_bytes": Kind("per byte", *_SHARE, "bytes vanish"),
        "flip_bits": Kind("per byte", *_SHARE, "one bit of a byte is inverted"),
        "junk": Kind("per packet", *_SHARE, "1 to 40 random bytes before a packet"),
        "split": Kind("bytes", 1, 65536, "output comes in pieces of 1 to so many bytes"),
        "merge": Kind(
            "seconds", 0.001, 60, "output is held back and comes in lumps this far apart"
        ),
        "stall": Kind("seconds", 0.001, 9, "nothing comes for so long, every 10 s"),
        "bursts": Kind("1", 1, 1, "frames come late and in bunches, as measured on a real X2M200"),
        "slow_ack": Kind("seconds", 0.001, 60, "every answer takes so long"),
        "drop_frames": Kind("per frame", *_SHARE, "a frame is not sent; its number is counted"),
        "duplicate": Kind("per frame", *_SHARE, "a frame is sent twice"),
        "spike": Kind("per frame", *_SHARE, "some samples lie far above the converter's top"),
        "clip": Kind("share of full scale", 0.001, 1, "the converter clips there"),
        "counter_restart": Kind("per frame", *_SHARE, "the frame counter begins again at 1"),
        "reboot": Kind("per frame", *_SHARE, "the module restarts and streams again by itself"),
        "error_reply": Kind("per command", *_SHARE, "a command is refused (command failed)"),
        "not_ready": Kind("seconds", 0.001, 600, "after boot: not ready, and READY never said"),
        "safe_mode": Kind("1", 1, 1, "fail-safe mode: pings say so, commands are refused"),
        "silent": Kind(
            "seconds", 0.001, 1e6, "of streaming, then nothing is sent; the port stays open"
        ),
        "hang_up": Kind("seconds", 0.001, 1e6, "of streaming, then the port closes"),
    }
)
"""Every kind of fault. Seconds are module time."""


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Which faults to make, by kind; none by default."""

    values: Mapping[str, float] = field(default_factory=dict)

    def value(self, kind: str) -> float:
        """Return a kind's value, 0 when it is not asked for."""
        return self.values.get(kind, 0.0)


def parse_faults(text: str) -> FaultPlan:
    """Read ``kind:value[,kind:value...]``.

    Raises
    ------
    SettingsError
        If a kind is unknown or given twice, or its value is missing or out of range.
    """
    values: dict[str, float] = {}
    for item in text.split(","):
        name, _, number = item.strip().partition(":")
        if name not in KINDS:
            msg = f"fault '{name}': unknown; known are {', '.join(KINDS)}"
            raise SettingsError(msg)
        kind = KINDS[name]
        try:
            value = float(number)
        except ValueError:
            value = float("nan")
        if not kind.least <= value <= kind.most:
            msg = (
                f"fault '{name}': '{number}' is no value from {kind.least:g} to {kind.most:g} "
                f"({kind.unit})"
            )
            raise SettingsError(msg)
        if name in values:
            msg = f"fault '{name}': given twice"
            raise SettingsError(msg)
        values[name] = value
    return FaultPlan(values)


def describe_faults() -> str:
    """Return the table of kinds as text, a line each."""
    return "\n".join(f"  {name:<15} {k.unit:<20} {k.meaning}" for name, k in KINDS.items())


class Dice:
    """One generator a kind of fault.

    Parameters
    ----------
    plan : FaultPlan
        What to make.
    seed : int
        Of the module.
    """

    def __init__(self, plan: FaultPlan, seed: int) -> None:
        self._plan = plan
        self._generators = {
            kind: np.random.default_rng([seed, 0xFA17, number])
            for number, kind in enumerate(KINDS)
        }

    def generator(self, kind: str) -> np.random.Generator:
        """Return the generator of a kind."""
        return self._generators[kind]

    def falls(self, kind: str) -> bool:
        """Draw once whether this fault happens now."""
        share = self._plan.value(kind)
        return share > 0 and bool(self._generators[kind].random() < share)
