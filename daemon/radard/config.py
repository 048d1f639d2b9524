"""Configuration: one validated object from built-in values, files, environment, options.

Later ones win: built-in < /etc/radard/config.yaml < ./config.yaml < --config FILE <
RADARD_SECTION__KEY < command line. Files do not add up: the first one found in the order
--config, ./config.yaml, /etc/radard/config.yaml is the file. An unknown key is an error
that names file, line and the nearest right key.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from radard.config_read import Places, explain, put, read_environment, read_yaml
from radard.errors import ConfigError
from radard.quiet import parse_quiet, time_zone
from radard.sinks.options import SinkOptions

DEFAULT_FILES = (Path("config.yaml"), Path("/etc/radard/config.yaml"))


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def _check_quiet(text: str) -> str:
    parse_quiet(text)
    return text


def _check_zone(name: str | None) -> str | None:
    time_zone(name)
    return name


def _check_span(span: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= span[0] < span[1] < 1000:
        msg = "must be [from, to] in metres, from below to"
        raise ValueError(msg)
    return span


Span = Annotated[tuple[float, float], AfterValidator(_check_span)]


class SensorSection(_Section):
    """Which radar."""

    name: str = Field("radar", pattern=r"^[A-Za-z0-9_-]+$", description="name of this sensor")
    port: str | None = Field(None, description="what --port says")
    speed: str = Field("auto", description="realtime, max, a factor, or auto")
    wait: bool = Field(False, description="wait for a port that is absent at start")
    on_device_loss: Literal["wait", "quit"] = Field("wait", description="when the port goes")


class ModelSection(_Section):
    """Which classifier."""

    name: str = Field("balanced", description="installed bundle, file, or none for the gate alone")


class GateSection(_Section):
    """When something counts as moving."""

    threshold_db: float = Field(6.0, ge=0, le=60, description="over the noise floor")
    adapt_db: float = Field(40.0, ge=0, le=60, description="most that a bin may learn")
    memory_s: float = Field(60.0, ge=1, le=3600, description="how long a dwell is remembered")
    learn_s: float = Field(20.0, ge=1, le=3600, description="motion in place before learning")
    in_place_m: float = Field(0.2, gt=0, le=2, description="what counts as in place")
    calibration: str = Field("auto", min_length=1, description="file, none, or auto: if made")
    floor_rate_db_per_s: float = Field(0.5, gt=0, le=60, description="most a bin's floor moves")
    adaptive: bool = Field(False, description="the threshold follows how restless the room is")
    least_db: float = Field(3.0, ge=0, le=60, description="an adaptive threshold stays above")
    most_db: float = Field(15.0, ge=0, le=60, description="and below this")
    threshold_rate_db_per_s: float = Field(0.05, gt=0, le=60, description="and moves so slowly")

    @model_validator(mode="after")
    def _check_bounds(self) -> "GateSection":
        if self.least_db > self.most_db:
            msg = "least_db cannot be more than most_db"
            raise ValueError(msg)
        if self.adaptive and not self.least_db <= self.threshold_db <= self.most_db:
            msg = "an adaptive threshold_db must begin between least_db and most_db"
            raise ValueError(msg)
        return self


class DecisionSection(_Section):
    """When a motion is an alarm."""

    policy: Literal["window", "fused"] | None = Field(None, description="null: the bundle's own")
    pet_limit: float | None = Field(None, ge=0.5, le=1, description="null: the bundle's own (0.8)")
    decide_within_s: float = Field(
        3.0, ge=0, le=3, description="policy fused: wait for evidence at most so long"
    )


class AlarmSection(_Section):
    """When decisions become an alarm event, and for how long."""

    armed: bool = Field(True, description="at the first start; a command's word is kept")
    sensitivity: Literal["low", "normal", "high"] = Field("normal", description="see explain")
    confirm_k: int | None = Field(None, ge=1, le=16, description="so many alarm decisions")
    confirm_n: int | None = Field(None, ge=1, le=16, description="of so many")
    p_on: float | None = Field(None, ge=0, le=1, description="least p(human) that counts")
    p_off: float | None = Field(None, ge=0, le=1, description="below it, nobody is seen")
    entry_delay_s: float = Field(0.0, ge=0, le=600, description="time to disarm")
    latch_s: float = Field(15.0, ge=0, le=86_400, description="alarm stays on unseen so long")
    refractory_s: float = Field(10.0, ge=0, le=3600, description="no new alarm after one")
    quiet: tuple[Annotated[str, AfterValidator(_check_quiet)], ...] = Field(
        (), description="22:00-06:30, Mon-Fri 08:00-17:00: no alarm then"
    )
    timezone: Annotated[str | None, AfterValidator(_check_zone)] = Field(
        None, description="of the quiet periods; null: the machine's"
    )

    @model_validator(mode="after")
    def _check_confirmation(self) -> "AlarmSection":
        if self.confirm_k and self.confirm_n and self.confirm_k > self.confirm_n:
            msg = "confirm_k cannot be more than confirm_n"
            raise ValueError(msg)
        return self


class ZonesSection(_Section):
    """Ranges that alarm events heed, [from, to] in metres."""

    include: tuple[Span, ...] = Field((), description="only these; empty: all")
    exclude: tuple[Span, ...] = Field((), description="not these")


class TamperSection(_Section):
    """When the sensor counts as covered, moved or jammed."""

    enabled: bool = Field(True, description="whether to look for it")
    learn_s: float = Field(20.0, ge=1, le=3600, description="still echoes before judging")
    hold_s: float = Field(20.0, ge=1, le=3600, description="how long a change must last")
    covered_db: float = Field(6.0, ge=1, le=60, description="change of the still echoes' level")
    moved_coherence: float = Field(0.8, ge=0, le=1, description="echoes agree less than so")
    noise_db: float = Field(6.0, ge=1, le=60, description="change of the noise floor")


class ClipsSection(_Section):
    """What is kept of an alarm."""

    enabled: bool = Field(True, description="false: no frames are ever kept")
    dir: Path | None = Field(None, description="null: clips in the state directory, if any")
    pre_s: float = Field(12.0, ge=0, le=60, description="before the alarm")
    post_s: float = Field(5.0, ge=0, le=60, description="after somebody was last seen")
    longest_s: float = Field(60.0, ge=1, le=600, description="all in all")
    keep_mb: float = Field(500.0, ge=1, description="the oldest clips go beyond that")
    free_mb: float = Field(200.0, ge=0, description="space that is left on the disk")


class ServiceSection(_Section):
    """Folders of the daemon."""

    state_dir: Path | None = Field(None, description="null: $STATE_DIRECTORY, else the user's")
    runtime_dir: Path | None = Field(None, description="null: $RUNTIME_DIRECTORY, else the user's")


class RadarSections(_Section):
    """What concerns the radar and what is made of it."""

    sensor: SensorSection = SensorSection()
    model: ModelSection = ModelSection()
    gate: GateSection = GateSection()
    decision: DecisionSection = DecisionSection()
    alarm: AlarmSection = AlarmSection()
    zones: ZonesSection = ZonesSection()
    tamper: TamperSection = TamperSection()
    clips: ClipsSection = ClipsSection()
    service: ServiceSection = ServiceSection()


class Config(SinkOptions, RadarSections):
    """The whole configuration."""

    output: tuple[str, ...] = Field((), description="what -o/--output says, a list")

    def digest(self) -> str:
        """Return a hash, 16 hex digits, of what decisions and alarms depend on."""
        sections = {"model", "gate", "decision", "alarm", "zones", "tamper"}
        text = json.dumps(self.model_dump(mode="json", include=sections), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Loaded:
    """A configuration, and where every value that is not built in came from."""

    config: Config
    places: Places

    def origin(self, *where: str) -> str:
        """Return file and line, variable or 'command line' of a value; 'built-in' otherwise."""
        return self.places.get(where, "built-in")


def load_config(
    file: Path | None = None,
    *,
    environ: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Config:
    """Return the configuration that holds; see `load_with_origins`."""
    return load_with_origins(file, environ=environ, options=options).config


def load_with_origins(
    file: Path | None = None,
    *,
    environ: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Loaded:
    """Return the configuration that holds, and where its values came from.

    Parameters
    ----------
    file : Path, optional
        What --config names; must exist.
    environ : mapping, optional
        Instead of the process environment.
    options : mapping of section to mapping of key to value, optional
        From the command line.

    Returns
    -------
    Loaded
        Checked.

    Raises
    ------
    ConfigError
        With every fault, each with its place.
    """
    tree: dict[str, Any] = {}
    places: Places = {}
    path = file or next((p for p in DEFAULT_FILES if p.is_file()), None)
    if path is not None:
        tree, places = read_yaml(path)
    for (section, key), value, place in read_environment(
        os.environ if environ is None else environ
    ):
        put(tree, section, key, value)
        _came_from(place, (section, key) if key else (section,), value, places)
    for name, values in (options or {}).items():
        if not isinstance(values, Mapping):
            tree[name] = values
            places[name,] = "command line"
            continue
        for key, value in values.items():
            put(tree, name, key, value)
            places[name, key] = "command line"
    try:
        return Loaded(Config.model_validate(tree), places)
    except ValidationError as err:
        lines = [explain(fault, places, Config) for fault in err.errors()]
        raise ConfigError("; ".join(lines)) from err


def _came_from(place: str, where: tuple[str, ...], value: Any, places: Places) -> None:
    """Note where a value came from; a whole section takes those of its keys along."""
    for old in [w for w in places if w[: len(where)] == where]:
        del places[old]
    places[where] = place
    if isinstance(value, Mapping):
        places.update({(*where, str(key)): place for key in value})
