"""Socket: one page's WebSocket, which gets records and pictures.

A page sends small JSON: ``{"pictures": true}`` while it shows some, and ``{"drawn": n}``, how
many it has drawn. Commands are POST requests.
"""

import asyncio
import contextlib
import json
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from radard.web.auth import AccessControl, RateLimit
from radard.web.hub import Hub, Viewer

MAX_MESSAGE = 512  # bytes; the longest that a page sends has thirty
_MAX_PER_S = 20.0  # messages of a page, which reports pictures four times a second
_CLOSE_POLICY, _CLOSE_BUSY, _CLOSE_SLOW = 1008, 1013, 4008  # RFC 6455 and IANA; 4000 on are ours


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
    tasks = [
        asyncio.create_task(_send(socket, viewer)),
        asyncio.create_task(_listen(socket, viewer, hub)),
    ]
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
            text = await socket.receive_text()
        except (WebSocketDisconnect, KeyError):
            return
        if not rate_limit.take() or len(text) > MAX_MESSAGE:
            return
        try:
            message = json.loads(text)
        except ValueError:
            return
        if not isinstance(message, dict):
            return
        if isinstance(message.get("pictures"), bool):
            hub.watch(viewer, wants_pictures=message["pictures"])
        if isinstance(message.get("drawn"), int):
            viewer.drawn(message["drawn"])
