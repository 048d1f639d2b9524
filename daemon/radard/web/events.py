"""Events for a page: listed, exported, labelled, with their clips and pictures."""

import base64
import csv
import io
import json
import re
from collections.abc import Iterator, Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryFile
from typing import IO, Any

from anyio import CapacityLimiter
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from radard.clips.spectrogram_png import decode_png, encode_png
from radard.config.sink_table import KINDS
from radard.errors import RadardError
from radard.log_file import MARKS, StoredEvent, newest_events, parse_since
from radard.web.guard import Guard, Refusal, attached, query_number
from radard.web.labels import LABELS, add_label, read_labels
from radard.web.pictures.clip_view import read_clip
from radard.web.view import View
from x2radar import wall_clock

_ULID = re.compile(r"[0-9A-HJKMNP-TV-Z]{26}")
_MAX_EVENTS = 2000  # of an answer: some hundred kilobytes
_SENT_BYTES = 65536  # of a clip at a time
_MAX_WAITING = 4  # requests for a clip's pictures: each takes seconds
_FIELDS = ("id", "sensor", "kind", "began", "ended", "peak", "reason", "label", "clip", *MARKS)
_SAME = ("id", "kind", "phase", "start_t_s", "end_t_s", "peak", "clip", "reason")
"""What an answer has under the name that an event of the log has, too."""


class EventRoutes:
    """The routes of one sensor's events."""

    def __init__(self, view: View, guard: Guard) -> None:
        self._view = view
        self._read = guard.read
        self._painting = CapacityLimiter(1)
        self.routes: list[Route] = [
            guard.viewing("/api/v1/events", self._list),
            guard.viewing("/api/v1/events/export", self._export),
            guard.viewing("/api/v1/events/{id}/clip", self._clip),
            guard.viewing("/api/v1/events/{id}/pictures", self._pictures),
            guard.viewing("/api/v1/events/{id}/thumbnail", self._thumbnail),
            guard.changing("/api/v1/labels", self._label),
        ]

    async def _list(self, request: Request) -> Response:
        events = await self._read(partial(self._events, **_filter(request)))
        return JSONResponse({"events": events})

    async def _export(self, request: Request) -> Response:
        events = await self._read(partial(self._events, **_filter(request)))
        text = "".join(json.dumps(e) + "\n" for e in events)
        name, kind = "events.jsonl", "application/jsonl"
        if request.query_params.get("format") == "csv":
            text, name, kind = _csv(events), "events.csv", "text/csv; charset=utf-8"
        return Response(text, media_type=kind, headers=attached(name))

    async def _clip(self, request: Request) -> Response:
        path = await self._read(self._clip_of, request.path_params["id"])
        try:
            copy, size = await self._read(_copied, path)
        except OSError as err:
            raise Refusal(503, f"the clip cannot be sent: {err.strerror or err}") from err
        headers = {**attached(path.name), "Content-Length": str(size)}
        return StreamingResponse(_sent(copy), media_type="application/x-hdf5", headers=headers)

    async def _pictures(self, request: Request) -> Response:
        path = await self._read(self._clip_of, request.path_params["id"])
        if self._painting.statistics().tasks_waiting >= _MAX_WAITING:
            raise Refusal(503, "others wait for pictures; try again soon")
        try:
            async with self._painting:
                data = await read_clip(path)
        except (RadardError, OSError) as err:
            code = 504 if isinstance(err, TimeoutError) else 422
            raise Refusal(code, f"the clip cannot be shown: {' '.join(str(err).split())}") from err
        return Response(data, media_type="application/octet-stream")

    async def _thumbnail(self, request: Request) -> Response:
        path = (await self._read(self._clip_of, request.path_params["id"])).with_suffix(".png")
        if not path.is_file():
            raise Refusal(404, "there is no picture of this event")
        try:
            return JSONResponse(await self._read(_thumbnail, path))
        except (OSError, ValueError) as err:
            raise Refusal(422, f"the picture cannot be shown: {err}") from err

    async def _label(self, body: dict[str, Any]) -> Response:
        event_id, label = body.get("event"), body.get("label")
        if label not in LABELS or not isinstance(event_id, str):
            raise Refusal(400, f"event and a label of {', '.join(LABELS)} are wanted")
        if (event := await self._read(self._event, event_id)) is None:
            raise Refusal(404, "this event is not known")
        line = {
            "event": event_id,
            "label": label,
            **{key: event[key] for key in ("clip", "sensor", "kind", "peak")},
            "model": self._view.history.hello.get("model"),
            "time": wall_clock.utc_text(),
        }
        await self._read(add_label, self._view.label_file, line)
        return JSONResponse({"event": event_id, "label": label}, 201)

    def _events(
        self, *, text: str, limit: int, label: str = "", **of_log: Any
    ) -> list[dict[str, Any]]:
        """Return events of the log, newest first: with `text` in reason or id, so labelled."""
        view, labels = self._view, read_labels(self._view.label_file)
        found = (
            each
            for each in reversed(newest_events(view.log.events(), **of_log, limit=_MAX_EVENTS))
            if not view.sensor or each.sensor == view.sensor
            if not label or labels.get(each.id, "none") == label
            if text.lower() in f"{each.reason} {each.id}".lower()
        )
        return [self._shown(each, labels) for each in islice(found, limit)]

    def _event(self, event_id: str) -> dict[str, Any] | None:
        """Return one event; None when it is not known."""
        found = self._events(text=event_id, limit=1) if _ULID.fullmatch(event_id) else []
        return found[0] if found else None

    def _clip_of(self, event_id: str) -> Path:
        """Return the clip of an event; Refusal unless it is there and named by the event's id."""
        event = self._event(event_id)
        path = Path(event["clip"] or "") if event else Path()
        if path.name != f"{event_id}.h5" or not path.is_file():
            raise Refusal(404, "there is no clip of this event")
        return path

    def _shown(self, event: StoredEvent, labels: Mapping[str, str]) -> dict[str, Any]:
        clip = Path(event.clip) if event.clip else None
        return {
            **{key: getattr(event, key) for key in _SAME},
            "sensor": event.sensor or self._view.config.sensor.name,
            "began": event.start_time,
            "ended": event.end_time,
            "lasted_s": event.lasted_s,
            **({event.mark: True} if event.mark else {}),
            "has_clip": clip is not None and clip.is_file(),
            "has_picture": clip is not None and clip.with_suffix(".png").is_file(),
            "label": labels.get(event.id),
            "why": self._view.history.cause(event.id),
        }


def _filter(request: Request) -> dict[str, Any]:
    """Return which events a query asks for; empty means all, label 'none' those without one."""
    query = request.query_params
    kinds = tuple(query.getlist("kind"))
    label, text, since = (query.get(name, "")[:200] for name in ("label", "text", "since"))
    if not set(kinds) <= set(KINDS) or label not in {"", "none", *LABELS}:
        msg = f"kind is one of {', '.join(KINDS)}; label one of none, {', '.join(LABELS)}"
        raise Refusal(400, msg)
    return {
        "kinds": kinds,
        "since_s": parse_since(since, wall_clock.now_s()) if since else None,
        "label": label,
        "text": text,
        "limit": query_number(request, "limit", 200, _MAX_EVENTS),
    }


def _copied(clip: Path) -> tuple[IO[bytes], int]:
    """Return a nameless copy of a clip, and its length; the clip may yet grow, shrink or go."""
    copy = TemporaryFile()  # noqa: SIM115 - it is closed when it has been sent
    with clip.open("rb") as file:
        copyfileobj(file, copy)
    size = copy.tell()
    copy.seek(0)
    return copy, size


def _sent(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        yield from iter(partial(file.read, _SENT_BYTES), b"")


def _thumbnail(path: Path) -> dict[str, Any]:
    """Return a quarter of a clip's `png`, as data: URL, and `axes`; OSError or ValueError."""
    picture, axes = decode_png(path.read_bytes())
    small = base64.b64encode(encode_png(picture[::2, ::2])).decode()
    return {"png": f"data:image/png;base64,{small}", "axes": axes}


def _csv(events: list[dict[str, Any]]) -> str:
    out = io.StringIO()
    writer = csv.DictWriter(out, _FIELDS, extrasaction="ignore")
    writer.writeheader()
    for event in events:
        # A spreadsheet would run what looks like a formula.
        is_risky = {k: isinstance(v, str) and v[:1] in "=+-@\t" for k, v in event.items()}
        writer.writerow({k: f"'{v}" if is_risky[k] else v for k, v in event.items()})
    return out.getvalue()
