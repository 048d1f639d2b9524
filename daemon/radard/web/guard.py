"""Guard: who may ask for a route, and what becomes of an error in one."""

from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from radard.errors import ConfigError, OutputError, UsageError
from radard.web.answers import json_body, refusal
from radard.web.auth import AccessControl, RateLimit

T = TypeVar("T")
Endpoint = Callable[[Request], Awaitable[Response]]
Handler = Callable[[dict[str, Any]], Awaitable[Response]]


class NoRunError(Exception):
    """The sensor has not begun to run."""


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

    def viewing(self, path: str, endpoint: Endpoint) -> Route:
        """Return a GET route for viewers; a UsageError of it is a bad request."""

        async def guarded(request: Request) -> Response:
            if self.access.role(request) == "nobody":
                return refusal(401, "show a token")
            try:
                return await endpoint(request)
            except UsageError as err:
                return refusal(400, str(err))

        return Route(path, guarded)

    def changing(self, path: str, handler: Handler) -> Route:
        """Return a POST route for operators, of a JSON object."""

        async def guarded(request: Request) -> Response:
            role = self.access.role(request)
            if role == "nobody":
                return refusal(401, "show a token")
            if role != "operator":
                return refusal(403, "only an operator may do this")
            if not self._rate_limit.take():
                return refusal(429, "too much at once; wait a moment")
            body = await json_body(request)
            if isinstance(body, Response):
                return body
            try:
                return await handler(body)
            except NoRunError:
                return refusal(503, "there is no run yet")
            except OverflowError:
                return refusal(400, "a number is too large")
            except ValueError as err:
                return refusal(400, str(err))
            except (OutputError, ConfigError) as err:
                return refusal(507, str(err))

        return Route(path, guarded, methods=["POST"])
