"""Routes: the HTTP contract of radard, /healthz, /metrics, /api/v1/..., /ws and the pages."""

import contextlib
import logging
import mimetypes
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from anyio import CapacityLimiter, to_thread
from starlette.applications import Starlette
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from radard.alarm.explain import explain
from radard.alarm.sensitivity import alarm_policy, sensitivity_choices
from radard.config.credentials import redact_value
from radard.config.directories import kept_calibration, saved_file
from radard.config.saved import KINDS, Kind, change, forget
from radard.config.sections import AUTO_MODEL
from radard.config.sink_table import named_file
from radard.detect.calibration import load_calibration, restless_spans
from radard.errors import ConfigError, ModelMismatch, UsageError
from radard.health.health import Status, overall
from radard.judge.bundle import read_card
from radard.outputs.base import COMMANDS
from radard.web.auth import SESSION_S, AccessControl, Role, address_of
from radard.web.events import EventRoutes
from radard.web.guard import Guard, Refusal, SecurityMiddleware, json_body, query_number, refuse
from radard.web.hub import serve
from radard.web.metrics import exposition
from radard.web.view import DECISIONS, View

log = logging.getLogger("radard")
_STATIC = Path(__file__).parent / "static"
# Whatever the system's own table says: a browser runs no script of another type.
mimetypes.add_type("text/javascript", ".js")
_NUMBERS = ("confirm_k", "confirm_n", "p_on", "p_off")
_MAX_SEQ = 1 << 53  # what JavaScript counts to
Views = Callable[[], Sequence[View]]
OF_ONE = "radard.sensor"  # key of a request's scope: it was for one of several sensors, this one


class Api:
    """All routes of one sensor; `all_views` returns those of all sensors of the process."""

    def __init__(self, view: View, access: AccessControl, all_views: Views) -> None:
        self._view = view
        self._access = access
        self._all_views = all_views
        self._testing = CapacityLimiter(1)
        self._guard = guard = Guard(access)
        self.routes: list[BaseRoute] = [
            Route("/healthz", partial(self._told, lambda now: now.is_well)),
            Route("/readyz", partial(self._told, lambda now: now.state == "online")),
            guard.viewing("/metrics", self._metrics),
            guard.viewing("/api/v1/status", self._status),
            guard.viewing("/api/v1/decisions", self._decisions),
            guard.viewing("/api/v1/decisions/{seq}", self._why),
            guard.reading("/api/v1/sensitivities", self._choices),
            guard.reading("/api/v1/calibration", self._room),
            guard.reading("/api/v1/config", self._config),
            *EventRoutes(view, guard).routes,
            guard.changing("/api/v1/command", self._command),
            guard.changing("/api/v1/zones", partial(self._change, "zones")),
            guard.changing("/api/v1/settings", partial(self._change, "settings")),
            guard.changing("/api/v1/test-alarm", self._test_alarm),
            guard.changing("/api/v1/playback", self._playback),
            Route("/api/v1/login", self._log_in, methods=["POST"]),
            Route("/api/v1/logout", self._log_out, methods=["POST"]),
            WebSocketRoute("/ws", self._ws),
            Route("/", self._page),
            # Here, because a service worker is for what lies beside it.
            Route("/sw.js", lambda _request: FileResponse(_STATIC / "sw.js")),
            Mount("/static", GZipMiddleware(StaticFiles(directory=_STATIC))),
        ]
        # The routes as an application, behind the checks of every request.
        handlers = {Refusal: refuse, UsageError: refuse}
        app = Starlette(routes=self.routes, exception_handlers=handlers)
        self.app = SecurityMiddleware(app, access)

    async def _told(self, is_good: Callable[[Status], bool], request: Request) -> Response:
        """Return the state, 200 or 503; the reason for those who may look."""
        views = [self._view] if OF_ONE in request.scope else self._all_views()
        now = overall({view.host.sensor: view.host.health for view in views})
        reason = {} if self._access.role(request) == "nobody" else {"reason": now.reason}
        return JSONResponse({"state": now.state, **reason}, 200 if is_good(now) else 503)

    async def _metrics(self, _request: Request) -> Response:
        views = self._all_views()
        for view in views:
            view.metrics.refresh(view.host)
        text = exposition([view.metrics for view in views], self._view.host.sinks())
        return Response(text, media_type="text/plain; version=0.0.4")

    async def _status(self, request: Request) -> Response:
        status = self._what_holds(self._access.role(request))
        return JSONResponse({**status, "viewers": len(self._view.hub)})

    def _what_holds(self, role: Role) -> dict[str, Any]:
        """Return what a page needs to begin with."""
        view, config, hello = self._view, self._view.config, self._view.history.hello
        policy = alarm_policy(config.alarm, hello.get("policy", "window"))
        store = config.named_output("store")
        others = [v.sensor for v in self._all_views() if v is not view]
        return {
            **view.now(),
            "role": role,
            "sensor": config.sensor.name,
            "hello": dict(hello),
            "confirm": [policy.k, policy.n],
            "latch_s": policy.latch_s,
            **{f"has_saved_{kind}": saved_file(config, kind).is_file() for kind in KINDS},
            "sensors": {**{n: f"/sensor/{n}/" for n in others}, **view.section.sensors},
            "has_store": store is not None and named_file(store).is_file(),
            "outputs": [
                {"name": s.name, "status": now.status, "reason": now.reason or now.remark}
                for s in self._view.host.sinks()
                for now in (s.state,)
            ],
        }

    async def _decisions(self, request: Request) -> Response:
        limit = query_number(request, "limit", 100, DECISIONS)
        before = query_number(request, "before_seq", 0, _MAX_SEQ)
        return JSONResponse({"decisions": self._view.history.decisions(limit, before_seq=before)})

    async def _why(self, request: Request) -> Response:
        view, history = self._view, self._view.history
        if not (held := history.around(request.path_params["seq"])):
            raise Refusal(404, "this decision is not remembered any more")
        records, states = zip(*held, strict=True)
        reasons = explain(records, history.hello, view.config, history.events(), states[-1])
        return JSONResponse({"decision": dict(records[-1]), **reasons})

    def _choices(self) -> dict[str, Any]:
        """Return the sensitivities to choose from, and what each costs by the model's card."""
        config, hello = self._view.config, self._view.history.hello
        is_named = config.model.name not in {AUTO_MODEL, "none"}
        model = config.model.name if is_named else hello.get("model")
        card, alarm = None, config.alarm
        if model is not None:
            with contextlib.suppress(ModelMismatch, OSError, ValueError):
                card = read_card(model)
        return {
            "choices": sensitivity_choices(alarm, hello.get("policy", "window"), card),
            # They go before those of the name.
            "given": [key for key in _NUMBERS if getattr(alarm, key) is not None],
        }

    def _room(self) -> dict[str, Any] | None:
        """Return what the sensor's own calibration says of its room; None without one."""
        config, keys = self._view.config, ("made_utc", "false_gates_per_day")
        with contextlib.suppress(ConfigError):
            if config.gate.calibration != "none":
                found = load_calibration(kept_calibration(config))
                made = {key: getattr(found.provenance, key) for key in keys}
                return {**made, "restless": restless_spans(found)}
        return None

    def _config(self) -> Any:
        return redact_value("", self._view.config.model_dump(mode="json"))

    async def _ws(self, websocket: WebSocket) -> None:
        view = self._view
        welcome = {
            "type": "welcome",
            **self._what_holds(self._access.role(websocket)),
            "decisions": view.history.decisions(180),
            "events": view.history.events()[-50:],
        }
        await serve(websocket, self._access, view.hub, view.section.max_viewers, welcome)

    async def _page(self, request: Request) -> Response:
        is_known = self._access.role(request) != "nobody"
        return FileResponse(_STATIC / ("index.html" if is_known else "login.html"))

    async def _command(self, body: dict[str, Any]) -> Response:
        name = body.get("command")
        if not isinstance(name, str) or name not in COMMANDS:
            raise Refusal(400, f"command is one of {', '.join(COMMANDS)}")
        host = self._view.host
        log.info("command from the dashboard: %s", name)
        try:
            host.command(name)
        except ValueError as err:
            raise Refusal(409, str(err)) from err
        return JSONResponse({"accepted": name}, 202)

    async def _change(self, kind: Kind, body: dict[str, Any]) -> Response:
        """Save sections, or forget what was saved, and have the configuration read again."""
        host, path = self._view.host, saved_file(self._view.config, kind)
        is_forgotten = body.get("forget") is True
        if is_forgotten:
            await self._guard.read(forget, path)
        else:
            sections = {"zones": body} if kind == "zones" else body
            await self._guard.read(change, path, kind, sections)
        log.info("%s from the dashboard: %s", kind, "forgotten" if is_forgotten else path)
        # Through the configuration, so that `config show` says the same.
        host.reload()
        return JSONResponse({"file": None if is_forgotten else str(path)}, 202)

    async def _test_alarm(self, _body: dict[str, Any]) -> Response:
        host = self._view.host
        log.warning("test alarm from the dashboard")
        # Threads of its own: outputs may take seconds to answer.
        answers = await to_thread.run_sync(host.test_alarm, limiter=self._testing)
        return JSONResponse({"outputs": answers})

    async def _playback(self, body: dict[str, Any]) -> Response:
        if (playback := self._view.host.playback()) is None:
            raise Refusal(409, "this is no replay")
        action, value = body.get("action"), body.get("value")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if action in {"play", "pause"}:
            playback.play(is_playing=action == "play")
        elif action == "seek" and is_number:
            playback.seek(float(value))  # type: ignore[arg-type]
        elif action == "speed" and (is_number or value is None):
            playback.set_speed(None if value is None else float(value))
        else:
            raise Refusal(400, "action is play, pause, seek or speed, with its value")
        return JSONResponse(self._view.now()["playback"], 202)

    async def _log_in(self, request: Request) -> Response:
        token = (await json_body(request)).get("token")
        if not isinstance(token, str):
            raise Refusal(400, "a token is wanted")
        address = address_of(request)
        if self._access.is_locked(address):
            raise Refusal(429, "too many wrong tokens from this address; wait a minute")
        role, session = self._access.log_in(token, address)
        if role == "nobody":
            raise Refusal(401, "this is not the token")
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
