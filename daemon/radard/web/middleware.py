"""Middleware: checks of every request before any route sees it, and security headers.

The host must be allowed and the body short; a request that changes something must come from
our own origin with our own header, which no form and no page of another site can send. The
headers keep a browser from doing what our pages never ask for.
"""

import asyncio

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from radard.web.answers import refusal, whole_number
from radard.web.auth import AccessControl

MAX_BODY = 4096  # bytes: 32 zones fit
_BODY_S = 10.0  # for a body that comes over a slow phone line
_OWN_HEADER = "x-radard"
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


class _TooLong(Exception):
    """A body is longer than `MAX_BODY`."""


async def _whole_body(receive: Receive) -> Receive:
    """Read the whole body; return a `receive` that hands it on in one piece."""
    body = b""
    while True:
        message = await receive()
        body += message.get("body", b"")
        if len(body) > MAX_BODY:
            raise _TooLong
        if not message.get("more_body", False):
            break
    whole: list[Message] = [{**message, "body": body} if "body" in message else message]

    async def again() -> Message:
        return whole.pop() if whole else await receive()

    return again


def _shielded(send: Send) -> Send:
    """Return a `send` that adds our headers to an answer."""

    async def add(message: Message) -> None:
        if message["type"] == "http.response.start":
            out = MutableHeaders(scope=message)
            out.update(_HEADERS)
            # The page's own files have a tag, and are asked for again with it.
            out.setdefault("Cache-Control", "no-cache" if "etag" in out else "no-store")
        await send(message)

    return add


class SecurityMiddleware:
    """The checks as ASGI middleware around an application."""

    def __init__(self, app: ASGIApp, access: AccessControl) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request pass, or answer it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        answer = _shielded(send)
        fault = self._fault(scope["method"], headers)
        if fault is not None:
            await fault(scope, receive, answer)
            return
        if scope["method"] not in _SAFE:
            try:
                async with asyncio.timeout(_BODY_S):
                    receive = await _whole_body(receive)
            except TimeoutError:
                await refusal(408, "the body does not come")(scope, receive, answer)
                return
            except _TooLong:
                await refusal(413, "the body is too long")(scope, receive, answer)
                return
        await self._app(scope, receive, answer)

    def _fault(self, method: str, headers: Headers) -> JSONResponse | None:
        if not self._access.is_right_host(headers):
            told = f"Host is '{headers.get('host', '')}': without tokens, only this machine's own"
            return refusal(421, f"{told} addresses are served; name tokens in the web section")
        if method in _SAFE:
            return None
        if whole_number(headers.get("content-length", "0"), MAX_BODY) is None:
            return refusal(413, "the body is too long")
        if not self._access.is_same_origin(headers):
            told = f"the page is of {headers.get('origin', 'another site')}, Host is "
            told += f"'{headers.get('host', '')}': only the dashboard itself may do this, and a"
            return refusal(403, f"{told} proxy before it must hand on the Host that it was given")
        if _OWN_HEADER not in headers:
            return refusal(403, "only the dashboard itself may do this: X-Radard is missing")
        return None
