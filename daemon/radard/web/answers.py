"""Answers and what requests hold: refusals, whole numbers, JSON bodies, attachments."""

import asyncio
import json
from typing import Any

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse

from radard.errors import UsageError

MAX_BODY = 4096  # bytes: 32 zones fit
_BODY_S = 10.0  # for a body that comes over a slow line


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


async def json_body(request: Request) -> dict[str, Any] | JSONResponse:
    """Return the JSON object of a body, or the answer to one that is none, or late, or long."""
    data = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for chunk in request.stream():
                data += chunk
                if len(data) > MAX_BODY:
                    return refusal(413, "the body is too long")
        body = json.loads(data, parse_constant=_refuse_constant)
    except TimeoutError:
        return refusal(408, "the body does not come")
    except (ValueError, RecursionError, ClientDisconnect):
        body = None
    is_json = request.headers.get("content-type", "").partition(";")[0] == "application/json"
    return body if is_json and isinstance(body, dict) else refusal(400, "no JSON object")


def _refuse_constant(name: str) -> float:
    msg = f"{name} is no JSON"
    raise ValueError(msg)
