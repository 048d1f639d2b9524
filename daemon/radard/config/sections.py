"""Sections of the configuration that concern a radar and what is made of it."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from radard.config.profiles import Bodies, check_profile
from radard.config.quiet_hours import parse_quiet, time_zone
from x2radar.ports import Kind, parse_port

NAME = r"^[A-Za-z0-9_-]+$"  # of a sensor: it becomes a part of topics and of file names
AUTO_MODEL, DEFAULT_MODEL = "auto", "accurate"  # left to `radard.judge.model_choice`; usual
_NULLS = ("", "~", "null", "Null", "NULL")
_HEADED = (tuple, dict, BaseModel)  # what a file has a heading for, and lines below it


def path_at_home(text: str) -> Path:
    """Return the path that a text names, with `~/` for the home folder where there is one."""
    return Path(os.path.expanduser(text))  # noqa: PTH111 - that of Path fails without a home


class Section(BaseModel):
    """A section: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _read_texts(cls, tree: Any) -> Any:
        """Take the texts of a file: `null`, a heading with nothing below it, `~/` for the home."""
        if not isinstance(tree, Mapping):
            return tree
        read: dict[str, Any] = {}
        for key, value in tree.items():
            field = cls.model_fields.get(key)
            kinds = get_args(field.annotation) if field else ()
            if field is None or not (value is None or value in _NULLS):
                is_path = Path in kinds and isinstance(value, str)
                read[key] = path_at_home(value) if is_path else value
            elif type(None) in kinds:
                read[key] = None
            elif not isinstance(field.get_default(call_default_factory=True), _HEADED):
                read[key] = value
        return read


def _read_by(read: Callable[[Any], object]) -> AfterValidator:
    return AfterValidator(lambda value: (read(value), value)[1])


def _check_span(span: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= span[0] < span[1] < 1000:
        raise ValueError("must be [from, to] in metres, from below to")
    return span


Span = Annotated[tuple[float, float], AfterValidator(_check_span)]


class SensorSection(Section):
    """Which radar."""

    name: str = Field("radar", pattern=NAME, description="name of this sensor")
    port: str | None = Field(None, description="what --port says")
    speed: str = Field("auto", description="realtime, max, a factor, or auto")
    wait: bool = Field(False, description="wait for a port that is absent at start")
    on_device_loss: Literal["wait", "quit"] = Field("wait", description="when the port goes")

    @property
    def kind(self) -> Kind | None:
        """What the port names; None without one. Raises SettingsError if it makes no sense."""
        return None if self.port is None else parse_port(self.port).kind


class MountSection(Section):
    """How the radar hangs, as far as it is known: what is evidence besides the motion."""

    height_m: float | None = Field(None, ge=0.1, le=5, description="over the floor; null: unknown")
    tilt_deg: float | None = Field(None, ge=-30, le=60, description="down from level, likewise")
    level_db: float | None = Field(
        None, ge=-20, le=100, description="what an adult shows at 1 m, from `radard walktest`"
    )


class ModelSection(Section):
    """Which classifier."""

    name: str = Field(
        AUTO_MODEL, description="installed bundle, file, none for the gate alone, or auto"
    )
    profile: Annotated[str | None, AfterValidator(check_profile)] = Field(
        None, description="bundle and settings at one go: eco, fast, balanced or accurate"
    )


class GateSettings(Section):
    """How the gate (`radard.detect.gate`) decides whether something moves.

    `false_alarms_per_day` sets the threshold of range-Doppler cells
    (`radard.dsp.cfar.cell_factor`): 8.7 dB over the noise for an X2 at 60 Hz; ten times
    as many, 0.25 dB less. Its price, measured (`benchmarks/bench_gate.py --weak 30`): of people
    who come in 6 dB over the noise of a bin, 10 % have not opened the gate after 3 s, of those at
    2 dB 27 %; ten times as many false alarms win one weak person in a hundred.
    """

    false_alarms_per_day: float = Field(
        0.01, gt=0, le=86_400, description="decisions that noise opens; a calibration overrides it"
    )
    adapt_db: float = Field(40.0, ge=0, le=60, description="most that a bin may learn")
    memory_s: float = Field(60.0, ge=1, le=3600, description="how long a dwell is remembered")
    learn_s: float = Field(20.0, ge=1, le=3600, description="motion in place before learning")
    in_place_m: float = Field(0.2, gt=0, le=2, description="what counts as in place")
    floor_rate_db_per_s: float = Field(0.5, gt=0, le=60, description="most a bin's floor moves")


class GateSection(GateSettings):
    """When something moves, and where the calibration comes from."""

    calibration: str = Field("auto", min_length=1, description="file, none, or auto: if made")
    calibrate_after_s: float = Field(
        30.0, ge=0, le=3600, description="time to leave the room when a command calibrates"
    )
    calibrate_s: float = Field(60.0, ge=25, le=3600, description="and how long it then listens")


class DecisionSection(Section):
    """When a motion is an alarm."""

    policy: Literal["window", "fused"] | None = Field(None, description="null: the bundle's own")
    pet_limit: float | None = Field(None, ge=0.5, le=1, description="null: the bundle's own (0.8)")
    decide_within_s: float = Field(
        3.0, ge=0, le=8, description="policy fused: wait so long, by what it leans to"
    )
    hop_s: float = Field(1.0, ge=0.25, le=2, description="from one decision to the next")
    bodies: Bodies = Field(
        "apart", description="several: each judged by itself, too; followed alone; not even that"
    )


class AlarmChoices(Section):
    """What of the alarm can be set on the dashboard."""

    sensitivity: Literal["low", "normal", "high"] = Field("normal", description="see explain")
    entry_delay_s: float = Field(0.0, ge=0, le=600, description="time to disarm")
    exit_delay_s: float = Field(0.0, ge=0, le=600, description="time to leave, once it is armed")


class AlarmSection(AlarmChoices):
    """When decisions become an alarm event, and for how long."""

    armed: bool = Field(True, description="at the first start; a command's word is kept")
    confirm_k: int | None = Field(None, ge=1, le=16, description="so many alarm decisions")
    confirm_n: int | None = Field(None, ge=1, le=16, description="of so many")
    p_on: float | None = Field(None, ge=0, le=1, description="least p(human) that counts")
    p_off: float | None = Field(None, ge=0, le=1, description="below it, nobody is seen")
    arm_with_tamper: Literal["warn", "refuse"] = Field(
        "warn", description="arming while a tamper event is on"
    )
    latch_s: float = Field(15.0, ge=0, le=86_400, description="alarm stays on unseen so long")
    refractory_s: float = Field(10.0, ge=0, le=3600, description="no new alarm after one")
    quiet: tuple[Annotated[str, _read_by(parse_quiet)], ...] = Field(
        (), description="22:00-06:30, Mon-Fri 08:00-17:00: no alarm then"
    )
    timezone: Annotated[str | None, _read_by(time_zone)] = Field(
        None, description="of the quiet periods; null: the machine's"
    )

    @model_validator(mode="after")
    def _check_confirmation(self) -> "AlarmSection":
        if self.confirm_k and self.confirm_n and self.confirm_k > self.confirm_n:
            raise ValueError("confirm_k cannot be more than confirm_n")
        return self


class ZonesSection(Section):
    """Ranges that alarm events heed, [from, to] in metres."""

    include: tuple[Span, ...] = Field((), description="only these; empty: all")
    exclude: tuple[Span, ...] = Field((), description="not these")
    away: tuple[Span, ...] = Field((), description="not these while armed at home")


class TamperSection(Section):
    """When the sensor counts as covered, moved or jammed."""

    enabled: bool = Field(True, description="whether to look for it")
    learn_s: float = Field(20.0, ge=1, le=3600, description="still echoes before judging")
    hold_s: float = Field(20.0, ge=1, le=3600, description="how long a change must last")
    covered_db: float = Field(6.0, ge=1, le=60, description="change of the still echoes' level")
    moved_coherence: float = Field(0.8, ge=0, le=1, description="echoes agree less than so")
    noise_db: float = Field(6.0, ge=1, le=60, description="change of the noise floor")


class ClipsSection(Section):
    """What is kept of an alarm."""

    enabled: bool = Field(True, description="false: no frames are ever kept")
    dir: Path | None = Field(None, description="null: clips in the state directory, if any")
    pre_s: float = Field(12.0, ge=0, le=60, description="before the alarm")
    post_s: float = Field(5.0, ge=0, le=60, description="after somebody was last seen")
    longest_s: float = Field(60.0, ge=1, le=600, description="all in all")
    keep_mb: float = Field(500.0, ge=1, description="the oldest clips go beyond that")
    free_mb: float = Field(200.0, ge=0, description="space that is left on the disk")


class ServiceSection(Section):
    """Folders of the daemon."""

    state_dir: Path | None = Field(None, description="null: $STATE_DIRECTORY, else the user's")
    runtime_dir: Path | None = Field(None, description="null: $RUNTIME_DIRECTORY, else the user's")


class RadarSections(Section):
    """What concerns the radar and what is made of it."""

    sensor: SensorSection = SensorSection()
    mount: MountSection = MountSection()
    model: ModelSection = ModelSection()
    gate: GateSection = GateSection()
    decision: DecisionSection = DecisionSection()
    alarm: AlarmSection = AlarmSection()
    zones: ZonesSection = ZonesSection()
    tamper: TamperSection = TamperSection()
    clips: ClipsSection = ClipsSection()
    service: ServiceSection = ServiceSection()


class SensorEntry(Section):
    """One of several radars; a section of its own holds what differs from the common one."""

    port: str = Field(description="what --port says")
    speed: str = Field("auto", description="realtime, max, a factor, or auto")
    mount: MountSection | None = Field(None, description="null: as all the others")
    model: ModelSection | None = None
    gate: GateSection | None = None
    decision: DecisionSection | None = None
    alarm: AlarmSection | None = None
    zones: ZonesSection | None = None
    tamper: TamperSection | None = None
    clips: ClipsSection | None = None


OWN_SECTIONS = tuple(n for n in RadarSections.model_fields if n in SensorEntry.model_fields)
"""Sections that an entry of `sensors` may have."""
