"""Secrets: read from the file or variable that the configuration names, and never printed.

What is printed loses passwords in URLs, tokens in paths and arguments of programs.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radard.config.sink_table import find_row
from radard.errors import ConfigError

MASK = "***"
_USERINFO = re.compile(r"(//[^:\s]*):\S*@")  # up to the last @: a password may hold /, @, :
_QUERY = re.compile(r"([?&][^=&\s]*(?:pass|secret|token|key|auth)[^=&\s]*)=[^&\s]*", re.IGNORECASE)
_KEY = re.compile(r"pass(word)?|secret|token|api_?key", re.IGNORECASE)


def read_secret(what: str, file: Path | None, variable: str | None) -> str | None:
    """Return the first line of `file` or `variable`, None if neither is named; or ConfigError."""
    if file is not None and variable is not None:
        raise ConfigError(f"{what}_file and {what}_env are both given; one is enough")
    if file is None and variable is None:
        return None
    text = os.environ.get(variable or "", "").removeprefix("\ufeff")
    fault = f"{what}_env: the variable {variable} is empty or not set"
    if file is not None:
        try:
            text = file.read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as err:
            why = err.strerror if isinstance(err, OSError) else "not text"
            raise ConfigError(f"{what}_file: {file}: {why}") from err
        fault = f"{what}_file: {file}: the first line is empty"
    line = (text.splitlines() or [""])[0].strip()
    if not line:
        raise ConfigError(fault)
    return line


def redact(text: str) -> str:
    """Return a port, output or error text without its secrets, see `SinkRow.shows`."""
    scheme, _, rest = text.partition(":")
    row = find_row(text)
    if row is not None and row.shows == "host":
        # After an @ nobody knows what is the host, and what a password.
        url = None if "@" in rest else re.match(r"\w+://[^/?#\s]*", rest)
        host = url.group() if url else ""
        return f"{scheme}:{host}" + ("" if host == rest else f"/{MASK}")
    if row is not None and row.shows == "service":
        # Of which any part may be a token; a file's name is none.
        service, found, _ = rest.partition("://")
        return text if rest.startswith("@") else f"{scheme}:{service if found else ''}://{MASK}"
    if row is not None and row.shows == "program":
        program, _, arguments = rest.strip().partition(" ")
        return f"{scheme}:{program}" + (f" {MASK}" if arguments else "")
    return _QUERY.sub(rf"\1={MASK}", _USERINFO.sub(rf"\1:{MASK}@", text))


def redact_value(key: str, value: Any) -> Any:
    """Return a configuration value, or tree of them, without its secrets."""
    if isinstance(value, Mapping):
        return {k: redact_value(str(k), v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [redact_value(key, v) for v in value]
    if value is not None and _KEY.search(key) and not key.endswith(("_file", "_env")):
        return MASK
    return redact(value) if isinstance(value, str) else value
