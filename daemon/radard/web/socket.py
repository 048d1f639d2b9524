"""Socket: one page's WebSocket. It gets records and pictures, and says little.

What a page may say is small JSON: ``{"pictures": true}`` while it shows some, and
``{"drawn": n}``, how many it has drawn. Commands do not go this way; they are POST requests.
"""

import asyncio
import contextlib
import json
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from radard.web.auth import AccessControl, Allowance
from radard.web.hub import Hub, Viewer

MOST_MESSAGE = 512
_MOST_PER_S = 20.0
_CLOSE_POLICY, _CLOSE_BUSY, _CLOSE_SLOW = 1008, 1013, 4008


async def serve(
    socket: WebSocket, guard: AccessControl, hub: Hub, most_viewers: int, welcome: dict[str, Any]
) -> None:
    """Serve one page until it goes.

    Parameters
    ----------
    socket : WebSocket
        Not accepted yet.
    guard : AccessControl
        Says who may look.
    hub : Hub
        Where records and pictures come from.
    most_viewers : int
        Pages that may be open at once.
    welcome : mapping
        First message.
    """
    is_ours = guard.is_right_host(socket.headers) and guard.is_same_origin(socket.headers)
    if not is_ours or guard.role(socket.headers, socket.cookies) == "nobody":
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
    allowance = Allowance(_MOST_PER_S, _MOST_PER_S)
    while True:
        try:
            text = await socket.receive_text()
        except (WebSocketDisconnect, KeyError):
            return
        if not allowance.take() or len(text) > MOST_MESSAGE:
            return
        try:
            said = json.loads(text)
        except ValueError:
            return
        if not isinstance(said, dict):
            return
        if isinstance(said.get("pictures"), bool):
            hub.watch(viewer, wants_pictures=said["pictures"])
        if isinstance(said.get("drawn"), int):
            viewer.drawn(said["drawn"])
