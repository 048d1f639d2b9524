"""Actions: routes that change something. POST requests, by operators, from our own page only."""

import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from radard.config.saved import KEYS, Sections, forget, read_saved, save
from radard.config.sections import RadarSections, Section, ZonesSection
from radard.errors import ConfigError, OutputError
from radard.outputs.base import COMMANDS
from radard.outputs.records import utc_now
from radard.web.auth import SESSION_S, AccessControl, RateLimit, address_of
from radard.web.labels import LABELS
from radard.web.middleware import refusal
from radard.web.queries import Queries

log = logging.getLogger("radard")
_MOST_ZONES = 32  # chosen: more than any room has
_LEAST_ZONE_M = 0.01  # chosen: below a range bin, 0.029 m at the finest
S = TypeVar("S", bound=Section)
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
        zones = None if _is_forget(body) else _zones_of(body)
        return await self._keep("zones", None if zones is None else {"zones": zones.model_dump()})

    async def _settings(self, body: dict[str, Any]) -> Response:
        if _is_forget(body):
            return await self._keep("settings", None)
        given = _settings_of(body)
        old = read_saved(self._queries.saved_file("settings"), "settings")
        return await self._keep(
            "settings",
            {name: {**old.get(name, {}), **given.get(name, {})} for name in {**old, **given}},
        )

    async def _keep(self, kind: str, sections: Sections | None) -> Response:
        """Save sections, or forget what was saved, and have the configuration read again."""
        host = self._queries.host
        if host is None:
            return refusal(503, "there is no run yet")
        path = self._queries.saved_file(kind)
        if sections is None:
            await run_in_threadpool(forget, path)
        else:
            await run_in_threadpool(lambda: save(path, sections, now_utc=utc_now()))
        log.info("%s from the dashboard: %s", kind, "forgotten" if sections is None else path)
        # Through the configuration, so that `config show` says the same.
        host.reload()
        return JSONResponse({"file": None if sections is None else str(path)}, 202)

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


def _is_forget(body: Mapping[str, Any]) -> bool:
    return body.get("forget") is True


def _zones_of(body: Mapping[str, Any]) -> ZonesSection:
    """Return the zones of a request; raises ValueError with what is wrong."""
    known = set(KEYS["zones"]["zones"])
    if not {"include", "exclude"} <= set(body) <= known:
        msg = "include and exclude are wanted, lists of [from, to] in metres"
        raise ValueError(msg)
    zones = _checked(ZonesSection, body)
    spans = [span for key in body for span in getattr(zones, key)]
    if len(spans) > _MOST_ZONES:
        msg = f"more than {_MOST_ZONES} zones"
        raise ValueError(msg)
    if any(to - start < _LEAST_ZONE_M for start, to in spans):
        msg = f"a zone is at least {_LEAST_ZONE_M:g} m long"
        raise ValueError(msg)
    return zones


def _settings_of(body: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the settings of a request by section; raises ValueError with what is wrong."""
    known = KEYS["settings"]
    found = {}
    for name, values in body.items():
        if not isinstance(values, dict) or not set(values) <= set(known.get(name, ())):
            names = ", ".join(
                f"{section}.{key}" for section, keys in known.items() for key in keys
            )
            msg = f"what may be set is {names}"
            raise ValueError(msg)
        section = _checked(type(getattr(RadarSections(), name)), values)
        found[name] = {key: getattr(section, key) for key in values}
    return found


def _checked(section: type[S], values: Mapping[str, Any]) -> S:
    """Return a section of given values; raises ValueError with the first fault."""
    try:
        return section.model_validate(values)
    except ValidationError as err:
        fault = err.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        msg = f"{where}: {str(fault['msg']).removeprefix('Value error, ')}"
        raise ValueError(msg) from err


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
