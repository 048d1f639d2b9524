"""Configuration: one validated object from built-in values, files, environment, options.

Later ones win: built-in < the first of --config, ./config.yaml, /etc/radard/config.yaml < saved on
the dashboard (`radard.config.saved`) < RADARD_SECTION__KEY < command line. A profile
(`radard.config.profiles`) wins over what stands beside or before it.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, StringConstraints, ValidationError, model_validator

from radard.config import profiles
from radard.config.directories import saved_file
from radard.config.saved import SAVED, lay_over
from radard.config.sections import NAME, OWN_SECTIONS, RadarSections, SensorEntry, SensorSection
from radard.config.sink_table import SinkOptions
from radard.config.sources import Places, Where, explain, put, read_environment, read_yaml
from radard.errors import ConfigError, UsageError

DEFAULT_FILES = (Path("config.yaml"), Path("/etc/radard/config.yaml"))
_PROFILE = ("model", "profile")
SensorName = Annotated[str, StringConstraints(pattern=NAME)]


class Config(SinkOptions, RadarSections):
    """The whole configuration."""

    sensors: dict[SensorName, SensorEntry] = Field(
        default_factory=dict, description="several radars in one process, name: port and more"
    )
    output: tuple[str, ...] = Field((), description="what -o/--output says, a list")
    _taken: tuple[str, ...] = PrivateAttr(())

    @model_validator(mode="before")
    @classmethod
    def _fill_entries(cls, tree: Any) -> Any:
        """Complete the sections of every entry of `sensors` by the common ones."""
        if not (isinstance(tree, Mapping) and (entries := _section(tree, "sensors"))):
            return tree
        return {**tree, "sensors": {name: _filled(each, tree) for name, each in entries.items()}}

    @model_validator(mode="after")
    def _check_sensors(self) -> "Config":
        if self.sensors and self.sensor.port is not None:
            raise ValueError("sensor.port and sensors are both given; one radar or several")
        watched: dict[str, str] = {}
        for name, entry in self.sensors.items():
            # What is simulated or replayed may be so as often as one likes.
            port = entry.port.partition("?")[0]
            is_module = port == "auto" or port.startswith("/") or "://" in port
            if is_module and (other := watched.setdefault(port, name)) != name:
                raise ValueError(f"sensors.{other} and sensors.{name} have the same port, {port}")
        return self

    def each(self) -> tuple["Config", ...]:
        """Return the configuration of every radar: of all `sensors`, or this one."""
        return tuple(map(self.of_sensor, self.sensors)) if self.sensors else (self,)

    def of_sensor(self, name: str | None) -> "Config":
        """Return the configuration of one radar, None is the only one; UsageError if not clear."""
        if name is None and len(self.sensors) == 1:
            (name,) = self.sensors
        if not self.sensors and name in {None, self.sensor.name}:
            return self
        if name not in self.sensors:
            known = ", ".join(self.sensors) or self.sensor.name
            asked = "which sensor?" if name is None else f"no sensor '{name}';"
            raise UsageError(f"{asked} known are {known} (--sensor NAME)")
        entry = self.sensors[name]
        sensor = SensorSection(name=name, port=entry.port, speed=entry.speed)
        own = {key: value for key in OWN_SECTIONS if (value := getattr(entry, key)) is not None}
        return self.model_copy(update={"sensor": sensor, **own})

    @property
    def taken(self) -> tuple[str, ...]:
        """What comes from files that nobody named: the file and its keys, for people."""
        return self._taken

    @property
    def is_one_of_several(self) -> bool:
        """Whether this is, or is for, a run of several radars."""
        return bool(self.sensors)

    def named_output(self, *schemes: str) -> str | None:
        """Return the first output of these schemes; None without one."""
        return next((o for o in self.output if o.partition(":")[0] in schemes and ":" in o), None)

    def digest(self) -> str:
        """Return a hash, 16 hex digits, of what decisions and alarms depend on."""
        sections = {"model", "gate", "decision", "alarm", "zones", "tamper"}
        text = json.dumps(self.model_dump(mode="json", include=sections), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def found_file() -> Path | None:
    """Return the file that holds unless --config names one; None if there is none."""
    return next((path for path in DEFAULT_FILES if path.is_file()), None)


def load_config(file: Path | None = None, **given: Any) -> Config:
    """Return the configuration that holds; see `load_with_origins`."""
    return load_with_origins(file, **given)[0]


def load_with_origins(
    file: Path | None = None,
    *,
    environ: Mapping[str, str] = os.environ,
    options: Mapping[str, Any] | None = None,
    port: str | None = None,
) -> tuple[Config, Places]:
    """Return the configuration that holds, and where each value that is not built in came from.

    `file` is what --config names and must exist; `options` are those of the command line, section
    to key to value; `port` is listened to instead of the configured port. Raises ConfigError with
    every fault, each with its place.
    """
    path = file or found_file()
    tree, places = read_yaml(path) if path else ({}, {})
    _lay_profile(tree, places)
    for name, entry in _section(tree, "sensors").items():
        if isinstance(entry, dict):
            _lay_profile(entry, places, ("sensors", name))
    environment = sorted(read_environment(environ, Config), key=lambda e: e[0] != _PROFILE)
    given = [
        ((section, key), value, "command line")
        for section, values in (options or {}).items()
        for key, value in (values if isinstance(values, Mapping) else {None: values}).items()
    ]
    for (section, key), value, place in (*environment, *given):
        put(tree, section, key, value)
        where: Where = (section, key) if key else (section,)
        # A whole section takes those of its keys along.
        for old in [each for each in places if each[: len(where)] == where]:
            del places[old]
        places[where] = place
        if isinstance(value, Mapping):
            places.update({(*where, str(inner)): place for inner in value})
        if where == _PROFILE:
            _lay_profile(tree, places)
    if places.get(("sensor", "port")) == "command line":
        # One radar was asked for by hand: that is the whole run.
        tree.pop("sensors", None)
    config = _checked(tree, places)
    at = partial(saved_file, environ=environ, port=port)
    lay_over(partial(at, config), tree, places)
    for name in config.sensors:
        radar = tree["sensors"][name] = dict(tree["sensors"][name])
        lay_over(partial(at, config.of_sensor(name)), radar, places, ("sensors", name))
    config = _checked(tree, places)
    config._taken = _taken(config, places, path if file is None else None)
    return config, places


def _lay_profile(tree: dict[str, Any], places: Places, at: Where = ()) -> None:
    """Put what a radar's profile sets into its sections, over what is there."""
    profile = profiles.front().named(_section(tree, "model").get("profile"))
    if profile is not None:
        settings = ("name", profile.model), ("hop_s", profile.hop_s), ("bodies", profile.bodies)
        for section, (key, value) in zip(("model", "decision", "decision"), settings, strict=True):
            put(tree, section, key, value)
            places[*at, section, key] = f"profile {profile.name}"


def _taken(config: Config, places: Places, found: Path | None) -> tuple[str, ...]:
    """Return what nobody named: keys of a file that was `found`, and those saved on the page."""
    keys: dict[str, list[str]] = {}
    built_in = Config()
    for where, place in places.items():
        file = place.rpartition(":")[0] or place
        now: Any = config
        usual: Any = built_in
        for key in where:
            now, usual = getattr(now, key, now), getattr(usual, key, usual)
        is_found = file == str(found) and len(where) > 1 and now != usual
        if is_found or place.endswith(SAVED):
            keys.setdefault(file, []).append(".".join(where))
    return tuple(f"{file}: {', '.join(sorted(names))}" for file, names in keys.items())


def _checked(tree: Mapping[str, Any], places: Places) -> Config:
    """Return a configuration whose ports ask for the frame rates of their radars' profiles."""
    try:
        config = Config.model_validate(tree)
    except ValidationError as err:
        lines = [explain(fault, places, Config) for fault in err.errors()]
        raise ConfigError("; ".join(lines)) from err
    sensors = {}
    for name, entry in config.sensors.items():
        own = profiles.rated(entry.port, (entry.model or config.model).profile)
        sensors[name] = entry.model_copy(update={"port": own})
    port = profiles.rated(config.sensor.port, config.model.profile)
    sensor = config.sensor.model_copy(update={"port": port})
    return config.model_copy(update={"sensor": sensor, "sensors": sensors})


def _filled(entry: Any, tree: Mapping[str, Any]) -> Any:
    """Return an entry of `sensors` whose own sections have the common one's further keys."""
    if not isinstance(entry, Mapping):
        return entry
    own = [name for name in OWN_SECTIONS if isinstance(entry.get(name), Mapping)]
    sections = {name: {**_section(tree, name), **entry[name]} for name in own}
    speed = _section(tree, "sensor").get("speed")
    return {**({} if speed is None else {"speed": speed}), **entry, **sections}


def _section(tree: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = tree.get(name)
    return found if isinstance(found, Mapping) else {}
