"""What was saved on the dashboard: files of its own over the configuration's sections.

::

    # Saved on the dashboard, 2026-11-21T06:00:00.000Z; goes before these keys of files.
    zones:
      include: [[0.600, 3.000]]
      exclude: []

They lie in the state directory, two for each sensor, `KEYS` says what each may hold; they are read
with the configuration: after its file, before environment and command line.
"""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radard.config.atomic import write_atomically
from radard.config.sources import ENV_PREFIX, Places, Where, put, read_yaml
from radard.errors import ConfigError, OutputError

Sections = Mapping[str, Mapping[str, Any]]
KEYS: dict[str, dict[str, tuple[str, ...]]] = {
    "zones": {"zones": ("include", "exclude", "away")},
    "settings": {
        "alarm": ("sensitivity", "entry_delay_s", "exit_delay_s"),
        "mount": ("height_m", "tilt_deg"),
    },
}
"""What may be saved: by kind of file, the keys of every section."""
_STRONGER = (ENV_PREFIX, "command line")
_SIMULATED = ("sim:", "replay:")


def state_folder(named: Path | None, environ: Mapping[str, str]) -> Path:
    """Return the folder of what is kept over a restart: named, systemd's or the user's."""
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if named is not None or given:
        return named or Path(given)
    home = environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "radard"


def saved_path(folder: Path, sensor: str, port: str | None, kind: str) -> Path:
    """Return where a sensor's `kind` of `KEYS` is kept; a simulated one has its own."""
    is_simulated = (port or "").startswith(_SIMULATED)
    return folder / f"{sensor}{'.sim' if is_simulated else ''}.{kind}.yaml"


def lay_over(
    folder: Path, sensor: str, port: str | None, tree: dict[str, Any], places: Places
) -> bool:
    """Put what was saved into sections and places; return whether that changed them.

    Raises ConfigError if a file of `saved_path` is not one of the dashboard's.
    """
    is_changed = False
    for kind in KEYS:
        path = saved_path(folder, sensor, port, kind)
        with contextlib.suppress(OSError):
            if path.is_file():
                is_changed |= _lay(path, kind, tree, places)
    return is_changed


def read_saved(path: Path, kind: str) -> dict[str, dict[str, Any]]:
    """Return what a file holds, nothing if it is not there; ConfigError if it is not ours."""
    return _read(path, kind)[0] if path.is_file() else {}


def save(path: Path, sections: Sections, *, now_utc: str) -> None:
    """Write sections, numbers to a thousandth; OutputError if the disk does not take them."""
    lines = [f"# Saved on the dashboard, {now_utc}; goes before these keys of files."]
    for name, values in sections.items():
        lines += [f"{name}:", *(f"  {key}: {_text(value)}" for key, value in values.items())]
    try:
        write_atomically(path, "\n".join(lines) + "\n")
    except OSError as err:
        msg = f"{path}: cannot be kept: {err.strerror or err}"
        raise OutputError(msg) from err


def forget(path: Path) -> None:
    """Delete what was saved; raises OutputError if that cannot be done."""
    try:
        path.unlink(missing_ok=True)
    except OSError as err:
        msg = f"{path}: cannot be taken away: {err.strerror or err}"
        raise OutputError(msg) from err


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    # JSON is YAML.
    return json.dumps(value)


def _read(path: Path, kind: str) -> tuple[dict[str, dict[str, Any]], Places]:
    raw, lines = read_yaml(path)
    known = KEYS[kind]
    is_ours = all(
        name in known and isinstance(values, dict) and set(values) <= set(known[name])
        for name, values in raw.items()
    )
    if not raw or not is_ours:
        msg = f"{path}: not the {kind} that the dashboard saves; take it away"
        raise ConfigError(msg)
    return raw, lines


def _lay(path: Path, kind: str, tree: dict[str, Any], places: Places) -> bool:
    raw, lines = _read(path, kind)
    is_changed = False
    for section, values in raw.items():
        old = tree.get(section)
        if old is not None and not isinstance(old, dict):
            # Wrong; the check of the section says so.
            continue
        for key, value in values.items():
            where: Where = (section, key)
            if places.get(where, "").startswith(_STRONGER):
                continue
            put(tree, section, key, value)
            places[where] = f"{lines[where]}, saved on the dashboard"
            is_changed = True
    return is_changed
