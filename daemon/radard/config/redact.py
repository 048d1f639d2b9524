"""Secrets out of what is printed: passwords in URLs, tokens in paths, arguments of programs."""

import re
from collections.abc import Mapping
from typing import Any

MASK = "***"
_USERINFO = re.compile(r"(//[^/@:\s]*):[^/@\s]*@")
_QUERY = re.compile(r"([?&][^=&\s]*(?:pass|secret|token|key|auth)[^=&\s]*)=[^&\s]*", re.IGNORECASE)
_KEY = re.compile(r"pass(word)?|secret|token|api_?key", re.IGNORECASE)


def redact(text: str) -> str:
    """Return a port, output or error text without what only its owner should know.

    Of a webhook only scheme and host stay, of a command only the program: their paths and
    arguments are where tokens are kept.
    """
    scheme, colon, rest = text.partition(":")
    if scheme == "webhook":
        url = re.match(r"\w+://[^/?#\s]*", rest)
        host = re.sub(r"//[^/@]*@", f"//{MASK}@", url.group()) if url else ""
        return f"webhook:{host}" + ("" if host == rest else f"/{MASK}")
    if scheme == "exec" and colon:
        program, _, arguments = rest.strip().partition(" ")
        return f"exec:{program}" + (f" {MASK}" if arguments else "")
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
