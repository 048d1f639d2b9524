"""Zones that were saved on the dashboard: a file of their own over the configuration's section.

::

    # Saved on the dashboard, 2026-11-21T06:00:00.000Z; goes before the section zones of files.
    zones:
      include: [[0.600, 3.000]]
      exclude: []

It lies in the state directory, one for each sensor, and is read with the configuration: after
its file, before environment and command line.
"""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radard.config.atomic import write_atomically
from radard.config.sources import ENV_PREFIX, Places, Where, put, read_yaml
from radard.errors import ConfigError, OutputError

Spans = Sequence[tuple[float, float]]
_KEYS = ("include", "exclude")
_STRONGER = (ENV_PREFIX, "command line")
_SIMULATED = ("sim:", "replay:")


def state_folder(named: Path | None, environ: Mapping[str, str]) -> Path:
    """Return the folder of what is kept over a restart: named, systemd's or the user's."""
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if named is not None or given:
        return named or Path(given)
    home = environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "radard"


def zones_path(folder: Path, sensor: str, port: str | None) -> Path:
    """Return where the zones of a sensor are kept; a simulated one has its own."""
    is_simulated = (port or "").startswith(_SIMULATED)
    return folder / f"{sensor}{'.sim' if is_simulated else ''}.zones.yaml"


def lay_over(path: Path, tree: dict[str, Any], places: Places) -> bool:
    """Put saved zones, if any, into sections and places; return whether that changed them.

    Raises ConfigError if `path`, from `zones_path`, is no file of zones.
    """
    with contextlib.suppress(OSError):
        if path.is_file():
            return _lay(path, tree, places)
    return False


def save(path: Path, include: Spans, exclude: Spans, *, now_utc: str) -> None:
    """Write zones, to the millimetre; raises OutputError if the disk does not take them."""
    text = (
        f"# Saved on the dashboard, {now_utc}; goes before the section zones of files.\n"
        f"zones:\n  include: {_listed(include)}\n  exclude: {_listed(exclude)}\n"
    )
    try:
        write_atomically(path, text)
    except OSError as err:
        msg = f"{path}: cannot keep the zones: {err.strerror or err}"
        raise OutputError(msg) from err


def forget(path: Path) -> None:
    """Delete saved zones; raises OutputError if that cannot be done."""
    try:
        path.unlink(missing_ok=True)
    except OSError as err:
        msg = f"{path}: cannot take the zones away: {err.strerror or err}"
        raise OutputError(msg) from err


def _listed(spans: Spans) -> str:
    return f"[{', '.join(f'[{a:.3f}, {b:.3f}]' for a, b in spans)}]"


def _lay(path: Path, tree: dict[str, Any], places: Places) -> bool:
    raw, lines = read_yaml(path)
    zones = raw.get("zones")
    if set(raw) != {"zones"} or not isinstance(zones, dict) or not set(zones) <= set(_KEYS):
        msg = f"{path}: not the zones that the dashboard saves; take it away"
        raise ConfigError(msg)
    old = tree.get("zones")
    if old is not None and not isinstance(old, dict):
        # Wrong; the check of the section says so.
        return False
    is_changed = False
    for key, value in zones.items():
        where: Where = ("zones", key)
        if places.get(where, "").startswith(_STRONGER):
            continue
        put(tree, "zones", key, value)
        places[where] = f"{lines[where]}, saved on the dashboard"
        is_changed = True
    return is_changed
