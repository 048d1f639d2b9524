"""Hub: hands records and pictures to every page; a page that is slow gets fewer pictures.

It runs in the web's own thread (asyncio). Records are few and wait, to a limit; a page that
cannot even take those is closed and reconnects by itself. Pictures never wait: a page reports
how many it has drawn, and gets none while too many are in flight.

A page sends small JSON: ``{"pictures": true}`` while it shows some, and ``{"drawn": n}``, how
many it has drawn. Commands are POST requests.
"""

import asyncio
import contextlib
import json
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from radard.web.auth import AccessControl, RateLimit

MAX_TEXTS = 400  # minutes of records
MAX_IN_FLIGHT = 64  # pictures: what a page gets at its opening, and some seconds more
_BACKLOG = 512  # messages: a minute of pictures for a page that opens
_dump = json.JSONEncoder(separators=(",", ":")).encode
_MAX_PER_S = 20.0  # messages of a page, which reports pictures four times a second
_CLOSE_POLICY, _CLOSE_BUSY, _CLOSE_SLOW = 1008, 1013, 4008  # RFC 6455 and IANA; 4000 on are ours


class Viewer:
    """One open page; `wants_pictures` while it shows some."""

    def __init__(self) -> None:
        self.wants_pictures = False
        self.is_overrun = False
        self._texts: deque[str] = deque()
        self._pictures: deque[bytes] = deque()
        self._n_sent = self._n_drawn = 0
        self._wake = asyncio.Event()
        self.has_all = asyncio.Event()  # whether every text has been sent

    def put_text(self, text: str) -> None:
        """Queue a text; a page that lets too many wait is to be closed."""
        if len(self._texts) >= MAX_TEXTS:
            self.is_overrun = True
        else:
            self._texts.append(text)
        self.has_all.clear()
        self._wake.set()

    def put_picture(self, data: bytes) -> None:
        """Queue a picture, or drop it."""
        in_flight = self._n_sent - self._n_drawn + len(self._pictures)
        if self.wants_pictures and in_flight < MAX_IN_FLIGHT:
            self._pictures.append(data)
            self._wake.set()

    def put_backlog(self, data: list[bytes]) -> None:
        """Queue earlier pictures, which do not count as in flight."""
        self._n_sent -= len(data)
        self._pictures.extend(data)
        self._wake.set()

    def drawn(self, n: int) -> None:
        """Note how many pictures the page has drawn so far."""
        self._n_drawn = max(self._n_drawn, min(n, self._n_sent))

    async def next(self) -> str | bytes:
        """Return what to send next; texts first."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._pictures:
                self._n_sent += 1
                return self._pictures.popleft()
            self.has_all.set()
            self._wake.clear()
            await self._wake.wait()


class Hub:
    """All open pages; calls `want_pictures` when the first wants some, or none any more."""

    def __init__(self, want_pictures: Callable[[bool], None]) -> None:
        self._want_pictures = want_pictures
        self._viewers: set[Viewer] = set()
        self._axes: Mapping[str, Any] | None = None
        self._backlog: deque[bytes] = deque(maxlen=_BACKLOG)
        self._is_wanted = False

    def __len__(self) -> int:
        return len(self._viewers)

    def add(self, viewer: Viewer) -> None:
        """Send records to a page from now on."""
        self._viewers.add(viewer)

    def remove(self, viewer: Viewer) -> None:
        """Send nothing more to a page."""
        self._viewers.discard(viewer)
        self._update_wanted()

    def watch(self, viewer: Viewer, *, wants_pictures: bool) -> None:
        """Note whether a page shows pictures; it gets earlier ones first."""
        if wants_pictures and not viewer.wants_pictures and self._axes is not None:
            viewer.put_text(_dump({"type": "axes", **self._axes}))
            viewer.put_backlog(list(self._backlog))
        viewer.wants_pictures = wants_pictures
        self._update_wanted()

    def broadcast(self, message: Mapping[str, Any]) -> None:
        """Send a message to every page."""
        if self._viewers:
            text = _dump(message)
            for viewer in self._viewers:
                viewer.put_text(text)

    def announce(self, axes: Mapping[str, Any]) -> None:
        """Send the axes of the pictures to come."""
        self._axes = axes
        self._backlog.clear()
        self.broadcast({"type": "axes", **axes})

    def show(self, data: bytes) -> None:
        """Send a picture to every page that wants it."""
        if data[0] == 1:
            self._backlog.append(data)
        for viewer in self._viewers:
            viewer.put_picture(data)

    async def has_sent_all(self) -> None:
        """Return once every page has every text."""
        await asyncio.gather(*(viewer.has_all.wait() for viewer in self._viewers))

    def _update_wanted(self) -> None:
        is_wanted = any(viewer.wants_pictures for viewer in self._viewers)
        if is_wanted != self._is_wanted:
            self._is_wanted = is_wanted
            if not is_wanted:
                self._axes = None
                self._backlog.clear()
            self._want_pictures(is_wanted)


async def serve(
    socket: WebSocket, access: AccessControl, hub: Hub, most_viewers: int, welcome: dict[str, Any]
) -> None:
    """Serve one page until it disconnects; `welcome` is its first message."""
    is_ours = access.is_right_host(socket.headers) and access.is_same_origin(socket.headers)
    if not is_ours or access.role(socket) == "nobody":
        await socket.close(_CLOSE_POLICY)
        return
    await socket.accept()
    if len(hub) >= most_viewers:
        await socket.close(_CLOSE_BUSY, "too many pages are open")
        return
    viewer = Viewer()
    viewer.put_text(json.dumps(welcome))
    hub.add(viewer)
    tasks = [asyncio.create_task(_send(socket, viewer))]
    tasks.append(asyncio.create_task(_listen(socket, viewer, hub)))
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.remove(viewer)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, OSError, WebSocketDisconnect):
            await socket.close(_CLOSE_SLOW if viewer.is_overrun else 1000)


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    while not viewer.is_overrun:
        item = await viewer.next()
        if isinstance(item, str):
            await socket.send_text(item)
        else:
            await socket.send_bytes(item)


async def _listen(socket: WebSocket, viewer: Viewer, hub: Hub) -> None:
    rate_limit = RateLimit(_MAX_PER_S, _MAX_PER_S)
    while True:
        try:
            message = json.loads(await socket.receive_text())
        except (WebSocketDisconnect, KeyError, ValueError):
            return
        if not rate_limit.take() or not isinstance(message, dict):
            return
        if isinstance(message.get("pictures"), bool):
            hub.watch(viewer, wants_pictures=message["pictures"])
        if isinstance(message.get("drawn"), int):
            viewer.drawn(message["drawn"])
