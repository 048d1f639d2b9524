"""Actions: routes that change something. POST requests, by operators, from our own page only."""

import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any

from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from radard.config.saved_zones import forget, save
from radard.config.sections import ZonesSection
from radard.errors import OutputError
from radard.outputs.records import utc_now
from radard.sinks.base import COMMANDS
from radard.web.auth import SESSION_S, AccessControl, RateLimit, address_of
from radard.web.labels import LABELS
from radard.web.middleware import refusal
from radard.web.queries import Queries

log = logging.getLogger("radard")
_MOST_ZONES = 32  # chosen: more than any room has
_LEAST_ZONE_M = 0.01  # chosen: below a range bin, 0.029 m at the finest
Handler = Callable[[dict[str, Any]], Awaitable[Response]]


class Actions:
    """Routes that change something."""

    def __init__(self, queries: Queries, access: AccessControl) -> None:
        self._queries = queries
        self._access = access
        # Commands wait in one queue with decisions: a flood of them must not.
        self._rate_limit = RateLimit(20, 4)
        self.routes = [
            self._route("/api/v1/command", self._command),
            self._route("/api/v1/labels", self._label),
            self._route("/api/v1/zones", self._zones),
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
            except OutputError as err:
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
        host = self._queries.host
        if host is None:
            return refusal(503, "there is no run yet")
        zones = None if body.get("forget") is True else _zones_of(body)
        path = self._queries.zones_file
        if zones is None:
            await run_in_threadpool(forget, path)
        else:
            await run_in_threadpool(
                lambda: save(path, zones.include, zones.exclude, now_utc=utc_now())
            )
        log.info("zones from the dashboard: %s", "forgotten" if zones is None else path)
        # Through the configuration, so that `config show` says the same.
        host.reload()
        return JSONResponse({"file": None if zones is None else str(path)}, 202)

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


def _zones_of(body: dict[str, Any]) -> ZonesSection:
    """Return the zones of a request; raises ValueError with what is wrong."""
    if set(body) != {"include", "exclude"}:
        msg = "include and exclude are wanted, lists of [from, to] in metres"
        raise ValueError(msg)
    try:
        zones = ZonesSection.model_validate(body)
    except ValidationError as err:
        fault = err.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        msg = f"{where}: {str(fault['msg']).removeprefix('Value error, ')}"
        raise ValueError(msg) from err
    spans = (*zones.include, *zones.exclude)
    if len(spans) > _MOST_ZONES:
        msg = f"more than {_MOST_ZONES} zones"
        raise ValueError(msg)
    if any(to - start < _LEAST_ZONE_M for start, to in spans):
        msg = f"a zone is at least {_LEAST_ZONE_M:g} m long"
        raise ValueError(msg)
    return zones


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
