"""Actions: routes that change something. POST requests, by operators, from our own page only."""

import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any

from anyio import CapacityLimiter, to_thread
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from radard.config.saved import Kind, change, forget
from radard.errors import ConfigError, OutputError
from radard.outputs.base import COMMANDS
from radard.outputs.records import utc_now
from radard.web.auth import SESSION_S, AccessControl, RateLimit, address_of
from radard.web.labels import LABELS
from radard.web.middleware import refusal
from radard.web.queries import Queries

log = logging.getLogger("radard")
Handler = Callable[[dict[str, Any]], Awaitable[Response]]


class Actions:
    """Routes that change something."""

    def __init__(self, queries: Queries, access: AccessControl) -> None:
        self._queries = queries
        self._access = access
        # Commands wait in one queue with decisions: a flood of them must not.
        self._rate_limit = RateLimit(20, 4)
        self._testing = CapacityLimiter(1)
        self.routes = [
            self._route("/api/v1/command", self._command),
            self._route("/api/v1/labels", self._label),
            self._route("/api/v1/zones", self._zones),
            self._route("/api/v1/settings", self._settings),
            self._route("/api/v1/test-alarm", self._test_alarm),
            self._route("/api/v1/playback", self._playback),
            Route("/api/v1/login", self._log_in, methods=["POST"]),
            Route("/api/v1/logout", self._log_out, methods=["POST"]),
        ]

    def _route(self, path: str, handler: Handler) -> Route:
        async def guarded(request: Request) -> Response:
            role = self._access.role(request)
            if role == "nobody":
                return refusal(401, "show a token")
            if role != "operator":
                return refusal(403, "only an operator may do this")
            if not self._rate_limit.take():
                return refusal(429, "too much at once; wait a moment")
            body = await _json_body(request)
            if body is None:
                return refusal(400, "no JSON object")
            try:
                return await handler(body)
            except OverflowError:
                return refusal(400, "a number is too large")
            except ValueError as err:
                return refusal(400, str(err))
            except (OutputError, ConfigError) as err:
                return refusal(507, str(err))

        return Route(path, guarded, methods=["POST"])

    async def _command(self, body: dict[str, Any]) -> Response:
        name, host = body.get("command"), self._queries.host
        if not isinstance(name, str) or name not in COMMANDS:
            return refusal(400, f"command is one of {', '.join(COMMANDS)}")
        if host is None:
            return refusal(503, "there is no run yet")
        log.info("command from the dashboard: %s", name)
        host.command(name)
        return JSONResponse({"accepted": name}, 202)

    async def _label(self, body: dict[str, Any]) -> Response:
        event_id, label = body.get("event"), body.get("label")
        if label not in LABELS or not isinstance(event_id, str):
            return refusal(400, f"event and a label of {', '.join(LABELS)} are wanted")
        event = await run_in_threadpool(self._queries.event, event_id)
        if event is None:
            return refusal(404, "this event is not known")
        line = {
            "event": event_id,
            "label": label,
            **{key: event[key] for key in ("clip", "sensor", "kind", "peak")},
            "model": self._queries.history.hello.get("model"),
            "time": utc_now(),
        }
        await run_in_threadpool(self._queries.label_file.add, line)
        return JSONResponse({"event": event_id, "label": label}, 201)

    async def _zones(self, body: dict[str, Any]) -> Response:
        return await self._change("zones", body, {"zones": body})

    async def _settings(self, body: dict[str, Any]) -> Response:
        return await self._change("settings", body, body)

    async def _change(self, kind: Kind, body: dict[str, Any], sections: Any) -> Response:
        """Save sections, or forget what was saved, and have the configuration read again."""
        host = self._queries.host
        if host is None:
            return refusal(503, "there is no run yet")
        path = self._queries.saved_file(kind)
        is_forgotten = body.get("forget") is True
        if is_forgotten:
            await run_in_threadpool(forget, path)
        else:
            await run_in_threadpool(change, path, kind, sections)
        log.info("%s from the dashboard: %s", kind, "forgotten" if is_forgotten else path)
        # Through the configuration, so that `config show` says the same.
        host.reload()
        return JSONResponse({"file": None if is_forgotten else str(path)}, 202)

    async def _test_alarm(self, _body: dict[str, Any]) -> Response:
        host = self._queries.host
        if host is None:
            return refusal(503, "there is no run yet")
        log.warning("test alarm from the dashboard")
        # Threads of its own: outputs may take seconds to answer.
        answers = await to_thread.run_sync(host.test_alarm, limiter=self._testing)
        return JSONResponse({"outputs": answers})

    async def _playback(self, body: dict[str, Any]) -> Response:
        host = self._queries.host
        playback = host.playback() if host is not None else None
        if playback is None:
            return refusal(409, "this is no replay")
        action, value = body.get("action"), body.get("value")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if action == "play":
            playback.play()
        elif action == "pause":
            playback.pause()
        elif action == "seek" and is_number:
            playback.seek(float(value))  # type: ignore[arg-type]
        elif action == "speed" and (is_number or value is None):
            playback.set_speed(None if value is None else float(value))
        else:
            return refusal(400, "action is play, pause, seek or speed, with its value")
        return JSONResponse(self._queries.now()["playback"], 202)

    async def _log_in(self, request: Request) -> Response:
        body = await _json_body(request)
        token = (body or {}).get("token")
        if not isinstance(token, str) or len(token) > 512:
            return refusal(400, "a token is wanted")
        address = address_of(request)
        if self._access.is_locked(address):
            return refusal(429, "too many wrong tokens from this address; wait a minute")
        role, session = self._access.log_in(token, address)
        if role == "nobody":
            return refusal(401, "this is not the token")
        answer = JSONResponse({"role": role})
        answer.set_cookie(
            self._access.cookie,
            session,
            max_age=int(SESSION_S),
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )
        return answer

    async def _log_out(self, request: Request) -> Response:
        self._access.log_out(request.cookies)
        answer = JSONResponse({})
        answer.delete_cookie(self._access.cookie)
        return answer


async def _json_body(request: Request) -> dict[str, Any] | None:
    """Return the JSON object of a body, None when it is none."""
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        return None
    try:
        body = json.loads(await request.body(), parse_constant=_no_number)
    except (ValueError, RecursionError):
        return None
    return body if isinstance(body, dict) else None


def _no_number(name: str) -> float:
    msg = f"{name} is no JSON"
    raise ValueError(msg)
