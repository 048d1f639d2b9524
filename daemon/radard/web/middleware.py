"""Middleware: checks of every request before any route sees it, and security headers.

The host must be allowed and the body short; a request that changes something must come from
our own origin with our own header, which no form and no page of another site can send. The
headers keep a browser from doing what our pages never ask for.
"""

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from radard.web.auth import AccessControl
from radard.web.guard import MAX_BODY, refusal, whole_number

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
        answer = _shielded(send)
        app = self._fault(scope["method"], Headers(scope=scope)) or self._app
        await app(scope, receive, answer)

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
