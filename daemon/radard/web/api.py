"""Routes: the HTTP contract of radard, /healthz, /metrics, /api/v1/..., /ws and the pages."""

import csv
import gzip
import hashlib
import io
import json
import time
from collections.abc import Awaitable, Callable
from importlib import resources
from typing import Any, TypeVar

from anyio import CapacityLimiter, to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from radard.config.sink_table import KINDS
from radard.errors import RadardError, UsageError
from radard.health.health import Status
from radard.outputs.store_query import parse_since
from radard.web import socket
from radard.web.actions import Actions
from radard.web.auth import AccessControl, Role
from radard.web.history import DECISIONS
from radard.web.hub import Hub
from radard.web.labels import LABELS
from radard.web.middleware import SecurityMiddleware, refusal, whole_number
from radard.web.pictures.clip_process import ClipTimeoutError, read_clip
from radard.web.pictures.thumbnail import thumbnail
from radard.web.queries import EventFilter, Queries

T = TypeVar("T")
Endpoint = Callable[[Request], Awaitable[Response]]
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}
_FIELDS = ("id", "sensor", "kind", "began", "ended", "peak", "reason", "label", "clip")
OF_ONE = "radard.sensor"
"""Key of a request's scope: it was for one of several sensors, this one."""
_MOST_SEQ = 1 << 53  # what JavaScript counts to
_MOST_WAITING = 4  # requests for a clip's pictures, chosen: each takes seconds


class Api:
    """All routes of one sensor."""

    def __init__(self, queries: Queries, access: AccessControl, hub: Hub) -> None:
        self._queries = queries
        self._access = access
        self._hub = hub
        self._static = _read_static()
        actions = Actions(queries, access)
        # Few threads: decisions need the processor more.
        self._reading = CapacityLimiter(2)
        self._painting = CapacityLimiter(1)
        routes: list[Route | WebSocketRoute] = [
            Route("/healthz", self._healthz),
            Route("/readyz", self._readyz),
            Route("/metrics", self._for_viewers(self._metrics)),
            Route("/api/v1/status", self._for_viewers(self._status)),
            Route("/api/v1/decisions", self._for_viewers(self._decisions)),
            Route("/api/v1/decisions/{seq}", self._for_viewers(self._why)),
            Route("/api/v1/events", self._for_viewers(self._events)),
            Route("/api/v1/events/export", self._for_viewers(self._export)),
            Route("/api/v1/events/{id}/clip", self._for_viewers(self._clip)),
            Route("/api/v1/events/{id}/pictures", self._for_viewers(self._pictures)),
            Route("/api/v1/events/{id}/thumbnail", self._for_viewers(self._thumbnail)),
            Route("/api/v1/sensitivities", self._for_viewers(self._sensitivities)),
            Route("/api/v1/calibration", self._for_viewers(self._calibration)),
            Route("/api/v1/config", self._for_viewers(self._config)),
            *actions.routes,
            WebSocketRoute("/ws", self._ws),
            Route("/", self._page),
            # Here, because a service worker is for what lies beside it.
            Route("/sw.js", self._worker),
            Route("/static/{path:path}", self._file),
        ]
        self.app = SecurityMiddleware(Starlette(routes=routes), access)

    def _for_viewers(self, endpoint: Endpoint) -> Endpoint:
        """Return an endpoint that wants a role; a UsageError of it is a bad request."""

        async def guarded(request: Request) -> Response:
            if self._role(request) == "nobody":
                return refusal(401, "show a token")
            try:
                return await endpoint(request)
            except UsageError as err:
                return refusal(400, str(err))

        return guarded

    def _role(self, request: Request) -> Role:
        return self._access.role(request)

    async def _healthz(self, request: Request) -> Response:
        return self._told(request, lambda now: now.is_well)

    async def _readyz(self, request: Request) -> Response:
        return self._told(request, lambda now: now.state == "online")

    def _told(self, request: Request, is_good: Callable[[Status], bool]) -> Response:
        """Return the state, 200 or 503; the reason for those who may look."""
        now = self._queries.health(is_whole=OF_ONE not in request.scope)
        body: dict[str, str] = {"state": now.state}
        if self._role(request) != "nobody":
            body["reason"] = now.reason
        return JSONResponse(body, 200 if is_good(now) else 503)

    async def _metrics(self, _request: Request) -> Response:
        return Response(self._queries.metrics_text(), media_type="text/plain; version=0.0.4")

    async def _status(self, request: Request) -> Response:
        status = self._queries.status(self._role(request))
        return JSONResponse({**status, "viewers": len(self._hub)})

    async def _config(self, _request: Request) -> Response:
        return JSONResponse(self._queries.config_shown())

    async def _decisions(self, request: Request) -> Response:
        limit = _whole_number(request, "limit", 100, DECISIONS)
        before = _whole_number(request, "before_seq", 0, _MOST_SEQ)
        found = self._queries.history.decisions(limit, before_seq=before or None)
        return JSONResponse({"decisions": found})

    async def _why(self, request: Request) -> Response:
        seq = whole_number(request.path_params["seq"], _MOST_SEQ)
        found = None if seq is None else self._queries.why(seq)
        if found is None:
            return refusal(404, "this decision is not remembered any more")
        return JSONResponse(found)

    async def _events(self, request: Request) -> Response:
        found = await self._read(self._queries.events, _filter(request))
        return JSONResponse({"events": found})

    async def _export(self, request: Request) -> Response:
        events = await self._read(self._queries.events, _filter(request))
        is_csv = request.query_params.get("format") == "csv"
        name = "events.csv" if is_csv else "events.jsonl"
        text = _csv(events) if is_csv else "".join(json.dumps(e) + "\n" for e in events)
        kind = "text/csv; charset=utf-8" if is_csv else "application/jsonl"
        return Response(text, media_type=kind, headers=_attached(name))

    async def _clip(self, request: Request) -> Response:
        path = await self._read(self._queries.clip, request.path_params["id"])
        if path is None:
            return refusal(404, "there is no clip of this event")
        return FileResponse(path, media_type="application/x-hdf5", headers=_attached(path.name))

    async def _pictures(self, request: Request) -> Response:
        path = await self._read(self._queries.clip, request.path_params["id"])
        if path is None:
            return refusal(404, "there is no clip of this event")
        if self._painting.statistics().tasks_waiting >= _MOST_WAITING:
            return refusal(503, "others wait for pictures; try again soon")
        try:
            async with self._painting:
                data = await read_clip(path)
        except (RadardError, OSError) as err:
            code = 504 if isinstance(err, ClipTimeoutError) else 422
            return refusal(code, f"the clip cannot be shown: {' '.join(str(err).split())}")
        return Response(data, media_type="application/octet-stream")

    async def _thumbnail(self, request: Request) -> Response:
        path = await self._read(self._queries.picture, request.path_params["id"])
        if path is None:
            return refusal(404, "there is no picture of this event")
        try:
            return JSONResponse(await self._read(thumbnail, path))
        except (OSError, ValueError) as err:
            return refusal(422, f"the picture cannot be shown: {err}")

    async def _sensitivities(self, _request: Request) -> Response:
        return JSONResponse(await self._read(self._queries.sensitivities))

    async def _calibration(self, _request: Request) -> Response:
        return JSONResponse(await self._read(self._queries.calibration))

    async def _read(self, call: Callable[..., T], *arguments: Any) -> T:
        return await to_thread.run_sync(call, *arguments, limiter=self._reading)

    async def _ws(self, websocket: WebSocket) -> None:
        queries, role = self._queries, self._access.role(websocket)
        welcome = {
            "type": "welcome",
            **queries.status(role),
            "decisions": queries.history.decisions(180),
            "events": queries.history.events()[-50:],
        }
        most = queries.section.max_viewers
        await socket.serve(websocket, self._access, self._hub, most, welcome)

    async def _page(self, request: Request) -> Response:
        is_known = self._role(request) != "nobody"
        return self._served(request, "index.html" if is_known else "login.html")

    async def _worker(self, request: Request) -> Response:
        return self._served(request, "sw.js")

    async def _file(self, request: Request) -> Response:
        return self._served(request, request.path_params["path"])

    def _served(self, request: Request, path: str) -> Response:
        if path not in self._static:
            return refusal(404, "no such file")
        kind, tag, data, packed = self._static[path]
        headers = {"ETag": tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            data, headers["Content-Encoding"] = packed, "gzip"
        return Response(data, media_type=kind, headers=headers)


def _read_static() -> dict[str, tuple[str, str, bytes, bytes]]:
    """Return type, tag, content and gzipped content of every file of the pages, by path."""
    found: dict[str, tuple[str, str, bytes, bytes]] = {}
    folders = [("", resources.files("radard.web") / "static")]
    while folders:
        above, folder = folders.pop()
        for item in folder.iterdir():
            path = above + item.name
            suffix = "." + item.name.rpartition(".")[2]
            if item.is_dir():
                folders.append((f"{path}/", item))
            elif suffix in _TYPES:
                data = item.read_bytes()
                tag = f'"{hashlib.blake2b(data, digest_size=8).hexdigest()}"'
                found[path] = (_TYPES[suffix], tag, data, gzip.compress(data))
    return found


def _whole_number(request: Request, name: str, default: int, most: int) -> int:
    number = whole_number(request.query_params.get(name, str(default)), most)
    if number is None:
        msg = f"{name}: a whole number up to {most} is wanted"
        raise UsageError(msg)
    return number


def _filter(request: Request) -> EventFilter:
    query = request.query_params
    kinds = tuple(query.getlist("kind"))
    label, text, since = (query.get(name, "")[:200] for name in ("label", "text", "since"))
    if not set(kinds) <= set(KINDS) or label not in {"", "none", *LABELS}:
        msg = f"kind is one of {', '.join(KINDS)}; label one of none, {', '.join(LABELS)}"
        raise UsageError(msg)
    return EventFilter(
        kinds=kinds,
        since_s=parse_since(since, time.time()) if since else None,
        label=label,
        text=text,
        limit=_whole_number(request, "limit", 200, 2000),
    )


def _csv(events: list[dict[str, Any]]) -> str:
    out = io.StringIO()
    writer = csv.DictWriter(out, _FIELDS, extrasaction="ignore")
    writer.writeheader()
    writer.writerows({k: _safe_cell(v) for k, v in event.items()} for event in events)
    return out.getvalue()


def _safe_cell(value: Any) -> Any:
    """Return a value that a spreadsheet does not run as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in "=+-@\t" else value


def _attached(name: str) -> dict[str, str]:
    return {"Content-Disposition": f'attachment; filename="{name}"'}
