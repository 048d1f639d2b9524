"""What was saved on the dashboard: files of its own over the configuration's sections.

They lie in the state directory, two for each sensor (`KINDS`), and come after the configuration's
file, before environment and command line; `radard.config.directories.saved_file` says where.
"""

import contextlib
import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError, model_validator

from radard.config.sections import AlarmChoices, MountSection, Section, Span, ZonesSection
from radard.config.sources import ENV_PREFIX, Places, Where, explain, put, read_yaml, texts_of
from radard.errors import ConfigError
from x2radar import wall_clock
from x2radar.atomic import write_atomically

Kind = Literal["zones", "settings"]
Sections = Mapping[str, Mapping[str, Any]]
MAX_ZONES = 32  # the body of a request holds so many, and no room has more
_MIN_ZONE_M = 0.01  # a third of the finest range bin, 0.029 m
_STRONGER = (ENV_PREFIX, "command line")
SAVED = ", saved on the dashboard"  # stands behind the place of a key that comes from there
_lock = threading.Lock()


class DrawnZones(ZonesSection):
    """Zones that were drawn on the page: it says both what counts and what does not."""

    include: tuple[Span, ...]
    exclude: tuple[Span, ...]

    @model_validator(mode="after")
    def _check_spans(self) -> "DrawnZones":
        spans = (*self.include, *self.exclude, *self.away)
        if len(spans) > MAX_ZONES:
            raise ValueError(f"more than {MAX_ZONES} zones")
        if any(to - start < _MIN_ZONE_M for start, to in spans):
            raise ValueError(f"a zone is at least {_MIN_ZONE_M:g} m long")
        return self


class SavedZones(Section):
    """The file of the zones."""

    zones: DrawnZones = DrawnZones(include=(), exclude=())


class SavedSettings(Section):
    """The file of the settings."""

    alarm: AlarmChoices = AlarmChoices()
    mount: MountSection = MountSection()


KINDS: dict[Kind, type[Section]] = {"zones": SavedZones, "settings": SavedSettings}


def lay_over(
    path_of: Callable[[Kind], Path], tree: dict[str, Any], places: Places, at: Where = ()
) -> None:
    """Put what was saved into a radar's sections, which stand `at` these keys, and into places."""
    for kind in KINDS:
        saved, lines = _read(path_of(kind), kind)
        for section, values in saved.items():
            for key, value in values.items():
                if not places.get((*at, section, key), "").startswith(_STRONGER):
                    put(tree, section, key, value)
                    places[*at, section, key] = f"{lines[section, key]}{SAVED}"


def check_saved(kind: Kind, sections: Sections) -> dict[str, dict[str, Any]]:
    """Return the keys that are given, checked; raises ValueError with the first fault."""
    model = KINDS[kind]
    try:
        return model.model_validate(sections).model_dump(exclude_unset=True)
    except ValidationError as err:
        raise ValueError(explain(err.errors()[0], {}, model)) from err


def change(path: Path, kind: Kind, sections: Sections) -> None:
    """Lay sections over what a file holds; ValueError, ConfigError or OSError if not."""
    # JSON is YAML: what was sent is read as a file is, where `true` is no number.
    given = check_saved(kind, texts_of(json.dumps(sections)))
    now = wall_clock.utc_text()
    with _lock:
        tree, _ = _read(path, kind)
        lines = [f"# Saved on the dashboard, {now}; goes before these keys of files."]
        for name in {**tree, **given}:
            values = {**tree.get(name, {}), **given.get(name, {})}
            lines += [f"{name}:", *(f"  {key}: {_text(value)}" for key, value in values.items())]
        write_atomically(path, "\n".join(lines) + "\n")


def forget(path: Path) -> None:
    """Delete what was saved; raises OSError if that cannot be done."""
    # Not while another page saves: it would write again what it has read before.
    with _lock:
        path.unlink(missing_ok=True)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    # JSON is YAML.
    return json.dumps(value)


def _read(path: Path, kind: Kind) -> tuple[dict[str, dict[str, Any]], Places]:
    """Return the sections of a file, and the lines of their keys; none if it is not there."""
    with contextlib.suppress(OSError):
        if path.is_file():
            raw, lines = read_yaml(path)
            try:
                return check_saved(kind, raw), lines
            except ValueError as err:
                msg = f"{path}: not the {kind} that the dashboard saves; take it away ({err})"
                raise ConfigError(msg) from err
    return {}, {}
