"""Credentials: the configuration names a file or an environment variable, never the value.

So no printed configuration, and no `repr`, can hold one, and a renewed file counts from the
next connection on.
"""

import os
from pathlib import Path

from radard.errors import ConfigError


def read_secret(what: str, file: Path | None, variable: str | None) -> str | None:
    """Return the first line of `file`, or of `variable`; None if neither is named.

    Raises ConfigError, which never shows the content, if both are named or one holds nothing;
    `what` is the key of the configuration without `_file` and `_env`.
    """
    if file is not None and variable is not None:
        msg = f"{what}_file and {what}_env are both given; one is enough"
        raise ConfigError(msg)
    if variable is not None:
        lines = os.environ.get(variable, "").removeprefix("\ufeff").splitlines()
        if not lines or not lines[0].strip():
            msg = f"{what}_env: the variable {variable} is empty or not set"
            raise ConfigError(msg)
        return lines[0].strip()
    if file is None:
        return None
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as err:
        why = err.strerror if isinstance(err, OSError) else "not text"
        msg = f"{what}_file: {file}: {why}"
        raise ConfigError(msg) from err
    if not lines or not lines[0].strip():
        msg = f"{what}_file: {file}: the first line is empty"
        raise ConfigError(msg)
    return lines[0].strip()
