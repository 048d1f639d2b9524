"""Guard: what every request must pass, who may ask for a route, and what becomes of an error.

The host must be allowed and the body short; a request that changes something must come from
our own origin with our own header, which no form and no page of another site can send. The
headers of answers keep a browser from doing what our pages never ask for.
"""

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import unquote

from anyio import CapacityLimiter, to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from radard.errors import ConfigError
from radard.web.auth import AccessControl, RateLimit
from x2radar.keys import unrepeated

MAX_BODY = 4096  # bytes: 32 zones fit
_BODY_S = 10.0  # for a body that comes over a slow line
T = TypeVar("T")
Endpoint = Callable[[Request], Awaitable[Response]]
Handler = Callable[[dict[str, Any]], Awaitable[Response]]
_OWN_HEADER = "x-radard"
_ABSOLUTE = re.compile(rb"https?://([^/@]+)", re.IGNORECASE)
_SAFE = {"GET", "HEAD", "OPTIONS"}
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; manifest-src 'self'; worker-src 'self'; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}


class Refusal(Exception):
    """A request that is answered with a code and the reason for it."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.answer = JSONResponse({"error": reason}, status_code=code)


async def refuse(_request: Request, err: Exception) -> Response:
    """Return the answer to a Refusal; a UsageError is a bad request."""
    return (err if isinstance(err, Refusal) else Refusal(400, str(err))).answer


def attached(name: str) -> dict[str, str]:
    """Return the headers of a file that a browser saves under a name."""
    return {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}


def whole_number(text: str, most: int) -> int | None:
    """Return the whole number of a text; None if it is none or above `most`."""
    # Not of any length: int() refuses thousands of digits with a fault of its own.
    is_number = text.isascii() and text.isdecimal() and len(text) <= len(str(most))
    return int(text) if is_number and int(text) <= most else None


def query_number(request: Request, name: str, default: int, most: int) -> int:
    """Return a whole number of a query; raises Refusal if it is none or above `most`."""
    number = whole_number(request.query_params.get(name, str(default)), most)
    if number is None:
        raise Refusal(400, f"{name}: a whole number up to {most} is wanted")
    return number


async def json_body(request: Request) -> dict[str, Any]:
    """Return the JSON object of a body; raises Refusal if it is none, or late, or long."""
    data = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for chunk in request.stream():
                data += chunk
                if len(data) > MAX_BODY:
                    raise Refusal(413, "the body is too long")
        # NaN and infinities are no JSON; int() refuses them.
        body = json.loads(data, parse_constant=int, object_pairs_hook=unrepeated)
    except TimeoutError as err:
        raise Refusal(408, "the body does not come") from err
    except (ValueError, RecursionError, ClientDisconnect):
        body = None
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json" or not isinstance(body, dict):
        raise Refusal(400, "no JSON object")
    return body


class Guard:
    """Makes routes of one sensor for those who may look, and for those who may change it."""

    def __init__(self, access: AccessControl) -> None:
        self.access = access
        # Commands wait in one queue with decisions: a flood of them must not.
        self._rate_limit = RateLimit(20, 4)
        # Few threads: decisions need the processor more.
        self._reading = CapacityLimiter(2)

    async def read(self, call: Callable[..., T], *arguments: Any) -> T:
        """Return what a call that waits for a disk returns, made in a thread."""
        return await to_thread.run_sync(call, *arguments, limiter=self._reading)

    def viewing(self, path: str, endpoint: Endpoint, method: str = "GET") -> Route:
        """Return a route for viewers."""

        async def guarded(request: Request) -> Response:
            if self.access.role(request) == "nobody":
                raise Refusal(401, "show a token")
            return await endpoint(request)

        return Route(path, guarded, methods=[method])

    def reading(self, path: str, call: Callable[[], Any]) -> Route:
        """Return a GET route for viewers of what a call that may wait for a disk returns."""

        async def read(_request: Request) -> Response:
            return JSONResponse(await self.read(call))

        return self.viewing(path, read)

    def changing(self, path: str, handler: Handler) -> Route:
        """Return a POST route for operators, of a JSON object."""

        async def guarded(request: Request) -> Response:
            if self.access.role(request) != "operator":
                raise Refusal(403, "only an operator may do this")
            if not self._rate_limit.take():
                raise Refusal(429, "too much at once; wait a moment")
            body = await json_body(request)
            try:
                return await handler(body)
            except (ValueError, OverflowError) as err:
                raise Refusal(400, str(err)) from err
            except ConfigError as err:
                raise Refusal(507, str(err)) from err
            except OSError as err:
                told = f"{err.filename}: {err.strerror}" if err.filename else str(err)
                raise Refusal(507, told) from err

        return self.viewing(path, guarded, "POST")


def _to_origin_form(scope: Scope) -> None:
    """Take ``GET http://host/path`` for what it asks: its host counts (RFC 9112, 3.2.2)."""
    target: bytes = scope["raw_path"]
    if (found := _ABSOLUTE.match(target)) is not None:
        headers = [pair for pair in scope["headers"] if pair[0] != b"host"]
        scope["headers"] = [*headers, (b"host", found[1])]
        scope["raw_path"] = target[found.end() :] or b"/"
        scope["path"] = unquote(scope["raw_path"].decode("ascii"))


@dataclass(eq=False)
class SecurityMiddleware:
    """The checks as ASGI middleware around an application."""

    app: ASGIApp
    access: AccessControl

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request pass, or answer it; every answer has our headers."""

        async def shielded(message: Message) -> None:
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                out.update(_HEADERS)
                # The page's own files have a tag, and are asked for again with it.
                out.setdefault("Cache-Control", "no-cache" if "etag" in out else "no-store")
            await send(message)

        _to_origin_form(scope)
        app = self.app
        try:
            if scope["type"] == "http":
                self._check(scope["method"], Headers(scope=scope))
        except Refusal as err:
            app = err.answer
        await app(scope, receive, shielded)

    def _check(self, method: str, headers: Headers) -> None:
        if not self.access.is_right_host(headers):
            told = f"Host is '{headers.get('host', '')}': without tokens, only this machine's own"
            raise Refusal(421, f"{told} addresses are served; name tokens in the web section")
        if method in _SAFE:
            return
        if whole_number(headers.get("content-length", "0"), MAX_BODY) is None:
            raise Refusal(413, "the body is too long")
        if not self.access.is_same_origin(headers):
            told = f"the page is of {headers.get('origin', 'another site')}, Host is "
            told += f"'{headers.get('host', '')}': only the dashboard itself may do this, and a"
            raise Refusal(403, f"{told} proxy before it must hand on the Host that it was given")
        if _OWN_HEADER not in headers:
            raise Refusal(403, "only the dashboard itself may do this: X-Radard is missing")
