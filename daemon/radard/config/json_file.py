"""JSON files that other runs and programs wrote, read into dataclasses: strictly, by pydantic.

Keys stand once, and nothing is converted but whole numbers to floats and lists to tuples.
"""

import json
import reprlib
from codecs import BOM_UTF8
from functools import lru_cache
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from x2radar.keys import unrepeated

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
LOOSE = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)
"""For files that hold more than is read here."""
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60
T = TypeVar("T")
_adapter: Any = lru_cache(maxsize=16)(TypeAdapter)


class NotJson(ValueError):
    """What was read is no JSON at all."""


def parse_json(kind: type[T], text: str | bytes, within: str = "") -> T:
    """Return a dataclass made of JSON; ValueError names key, behind `within`, and value."""
    try:
        data = text.encode() if isinstance(text, str) else text
        made: T = _adapter(kind).validate_json(data.removeprefix(BOM_UTF8))
        # pydantic takes the last of two keys that are the same, without a word.
        json.loads(data.decode("utf-8-sig"), object_pairs_hook=unrepeated)
    except ValidationError as err:
        fault = err.errors()[0]
        kind_of = NotJson if fault["type"] == "json_invalid" else ValueError
        path = [str(part)[:60] for part in fault["loc"]]
        where = ".".join([within, *path] if within else path)
        message = str(fault["msg"]).removeprefix("Value error, ")[:200]
        text = f"{message[:1].lower()}{message[1:]}"
        if fault["type"] == "unexpected_keyword_argument":
            text = "unknown key"
        elif fault["type"] not in {"missing", "json_invalid", "missing_keyword_only_argument"}:
            text = f"{text} (got {_SHORT.repr(fault['input'])})"
        raise kind_of(f"{where}: {text}" if where else text) from err
    return made
