"""Answers and what requests hold: refusals, whole numbers, JSON bodies, attachments."""

import json
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse

from radard.errors import UsageError


def refusal(code: int, reason: str) -> JSONResponse:
    """Return an error response with its reason."""
    return JSONResponse({"error": reason}, status_code=code)


def attached(name: str) -> dict[str, str]:
    """Return the headers of a file that a browser saves under a name."""
    return {
        "Content-Disposition": f'attachment; filename="{name}"',
        "Cache-Control": "no-store",
    }


def whole_number(text: str, most: int) -> int | None:
    """Return the whole number of a text; None if it is none or above `most`."""
    # Not of any length: int() refuses thousands of digits with a fault of its own.
    is_number = text.isascii() and text.isdecimal() and len(text) <= len(str(most))
    return int(text) if is_number and int(text) <= most else None


def query_number(request: Request, name: str, default: int, most: int) -> int:
    """Return a whole number of a query; raises UsageError if it is none or above `most`."""
    number = whole_number(request.query_params.get(name, str(default)), most)
    if number is None:
        msg = f"{name}: a whole number up to {most} is wanted"
        raise UsageError(msg)
    return number


async def json_body(request: Request) -> dict[str, Any] | None:
    """Return the JSON object of a body, None when it is none."""
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        return None
    try:
        body = json.loads(await request.body(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        return None
    return body if isinstance(body, dict) else None


def _refuse_constant(name: str) -> float:
    msg = f"{name} is no JSON"
    raise ValueError(msg)
