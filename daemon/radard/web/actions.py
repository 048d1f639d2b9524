"""Actions: routes that change something. POST requests, by operators, from our own page only."""

import logging
from typing import Any

from anyio import CapacityLimiter, to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from radard.config.directories import saved_file
from radard.config.saved import Kind, change, forget
from radard.outputs.base import COMMANDS, Host
from radard.web.auth import SESSION_S, AccessControl, address_of
from radard.web.guard import Guard, NoRunError, json_body, refusal
from radard.web.view import View

log = logging.getLogger("radard")
_MAX_TOKEN = 512  # characters; longer ones are not even compared


class Actions:
    """Routes that change something of one sensor."""

    def __init__(self, view: View, guard: Guard) -> None:
        self._view = view
        self._read = guard.read
        self._testing = CapacityLimiter(1)
        self.routes: list[Route] = [
            guard.changing("/api/v1/command", self._command),
            guard.changing(
                "/api/v1/zones", lambda body: self._change("zones", body, {"zones": body})
            ),
            guard.changing("/api/v1/settings", lambda body: self._change("settings", body, body)),
            guard.changing("/api/v1/test-alarm", self._test_alarm),
            guard.changing("/api/v1/playback", self._playback),
            *_session_routes(guard.access),
        ]

    @property
    def _host(self) -> Host:
        """The sensor's run; raises NoRunError before there is one."""
        if self._view.host is None:
            raise NoRunError
        return self._view.host

    async def _command(self, body: dict[str, Any]) -> Response:
        name = body.get("command")
        if not isinstance(name, str) or name not in COMMANDS:
            return refusal(400, f"command is one of {', '.join(COMMANDS)}")
        host = self._host
        log.info("command from the dashboard: %s", name)
        try:
            host.command(name)
        except ValueError as err:
            return refusal(409, str(err))
        return JSONResponse({"accepted": name}, 202)

    async def _change(self, kind: Kind, body: dict[str, Any], sections: Any) -> Response:
        """Save sections, or forget what was saved, and have the configuration read again."""
        host, path = self._host, saved_file(self._view.config, kind)
        is_forgotten = body.get("forget") is True
        if is_forgotten:
            await self._read(forget, path)
        else:
            await self._read(change, path, kind, sections)
        log.info("%s from the dashboard: %s", kind, "forgotten" if is_forgotten else path)
        # Through the configuration, so that `config show` says the same.
        host.reload()
        return JSONResponse({"file": None if is_forgotten else str(path)}, 202)

    async def _test_alarm(self, _body: dict[str, Any]) -> Response:
        host = self._host
        log.warning("test alarm from the dashboard")
        # Threads of its own: outputs may take seconds to answer.
        answers = await to_thread.run_sync(host.test_alarm, limiter=self._testing)
        return JSONResponse({"outputs": answers})

    async def _playback(self, body: dict[str, Any]) -> Response:
        playback = self._host.playback()
        if playback is None:
            return refusal(409, "this is no replay")
        action, value = body.get("action"), body.get("value")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if action in {"play", "pause"}:
            playback.play(is_playing=action == "play")
        elif action == "seek" and is_number:
            playback.seek(float(value))  # type: ignore[arg-type]
        elif action == "speed" and (is_number or value is None):
            playback.set_speed(None if value is None else float(value))
        else:
            return refusal(400, "action is play, pause, seek or speed, with its value")
        return JSONResponse(self._view.now()["playback"], 202)


def _session_routes(access: AccessControl) -> list[Route]:
    """Return the routes that trade a token for a session, and end it."""

    async def log_in(request: Request) -> Response:
        body = await json_body(request)
        if isinstance(body, Response):
            return body
        token = body.get("token")
        if not isinstance(token, str) or len(token) > _MAX_TOKEN:
            return refusal(400, "a token is wanted")
        address = address_of(request)
        if access.is_locked(address):
            return refusal(429, "too many wrong tokens from this address; wait a minute")
        role, session = access.log_in(token, address)
        if role == "nobody":
            return refusal(401, "this is not the token")
        answer = JSONResponse({"role": role})
        answer.set_cookie(
            access.cookie,
            session,
            max_age=int(SESSION_S),
            httponly=True,
            samesite="strict",
            secure=request.url.scheme == "https",
        )
        return answer

    async def log_out(request: Request) -> Response:
        access.log_out(request.cookies)
        answer = JSONResponse({})
        answer.delete_cookie(access.cookie)
        return answer

    return [
        Route("/api/v1/login", log_in, methods=["POST"]),
        Route("/api/v1/logout", log_out, methods=["POST"]),
    ]
