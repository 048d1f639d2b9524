"""SensorState: what people may want to know of a running sensor at one moment.

Control, dashboard, MQTT, metrics and the status file read it; none of them can change it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from radard.alarm.panel import ArmMode, PanelState
from radard.judge.decision import GateState, Label
from radard.stream.frame_timing import Drift


@dataclass(frozen=True, slots=True)
class CalibrationProgress:
    """How far the calibration of a room is."""

    phase: str  # leave, listen, made or failed
    left_s: int = 0
    text: str = ""

    @property
    def is_over(self) -> bool:
        """Whether it has ended, well or not."""
        return self.phase in {"made", "failed"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorState:
    """One moment between two decisions of a sensor that has a stream."""

    armed: bool = True  # whether hits can raise an alarm, now or once the exit delay is over
    mode: ArmMode = "away"
    panel: PanelState = "armed"
    delay_left_s: float | None = None  # of the exit or entry delay; None while none runs
    sensitivity: str = "normal"
    alarm_id: str | None = None  # of the alarm that is on
    open: Mapping[str, str] = field(default_factory=dict)  # reasons of events that are on, by kind
    t_s: float = 0.0  # of the last decision
    seq: int = 0  # and its number; 0: none yet
    gate: GateState | None = None
    label: Label | None = None
    clock_drift: Drift | None = None  # None until it is known
    calibration: CalibrationProgress | None = None  # the last one that was asked for

    def as_record(self, mark: str = "") -> dict[str, Any]:
        """Return it as status files and pages have it, marked as the stream's records are."""
        return {**asdict(self), **({mark: True} if mark else {})}
