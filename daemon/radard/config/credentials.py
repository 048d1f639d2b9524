"""Credentials: the configuration names a file or an environment variable, never the value.

So no printed configuration, and no `repr`, can hold one, and a renewed file counts from the
next connection on.
"""

import os
from pathlib import Path

from radard.errors import ConfigError


def read_secret(what: str, file: Path | None, variable: str | None) -> str | None:
    """Return the first line of `file` or `variable`, None if neither is named; or ConfigError."""
    if file is not None and variable is not None:
        raise ConfigError(f"{what}_file and {what}_env are both given; one is enough")
    if variable is not None:
        lines = os.environ.get(variable, "").removeprefix("\ufeff").splitlines()
        if not lines or not lines[0].strip():
            raise ConfigError(f"{what}_env: the variable {variable} is empty or not set")
        return lines[0].strip()
    if file is None:
        return None
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as err:
        why = err.strerror if isinstance(err, OSError) else "not text"
        raise ConfigError(f"{what}_file: {file}: {why}") from err
    if not lines or not lines[0].strip():
        raise ConfigError(f"{what}_file: {file}: the first line is empty")
    return lines[0].strip()
