"""Hub: hands records and pictures to every page; a page that is slow gets fewer pictures.

Lives in the web's own thread (asyncio). Records are few and wait, to a limit; a page that
cannot even take those is closed and comes back by itself. Pictures never wait: a page says
how many it has drawn, and gets none while too many are under way.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

MOST_TEXTS = 400
MOST_UNDER_WAY = 24
_BACKLOG = 512


class Viewer:
    """One open page.

    Attributes
    ----------
    wants_pictures : bool
        Whether it shows any now.
    """

    def __init__(self) -> None:
        self.wants_pictures = False
        self.n_dropped = 0
        self.is_overrun = False
        self._texts: deque[str] = deque()
        self._pictures: deque[bytes] = deque()
        self._n_sent = self._n_drawn = 0
        self._wake = asyncio.Event()

    def put_text(self, text: str) -> None:
        """Queue a text; a page that lets too many wait is to be closed."""
        if len(self._texts) >= MOST_TEXTS:
            self.is_overrun = True
        else:
            self._texts.append(text)
        self._wake.set()

    def put_picture(self, data: bytes) -> None:
        """Queue a picture, or drop it."""
        under_way = self._n_sent - self._n_drawn + len(self._pictures)
        if not self.wants_pictures or under_way >= MOST_UNDER_WAY:
            self.n_dropped += self.wants_pictures
            return
        self._pictures.append(data)
        self._wake.set()

    def put_backlog(self, data: list[bytes]) -> None:
        """Queue the pictures of the last while, which do not count as under way."""
        self._n_sent -= len(data)
        self._pictures.extend(data)
        self._wake.set()

    def drawn(self, n: int) -> None:
        """Note how many pictures the page has taken so far."""
        self._n_drawn = max(self._n_drawn, min(n, self._n_sent))

    async def next(self) -> str | bytes:
        """Return what to send next; texts first."""
        while True:
            if self._texts:
                return self._texts.popleft()
            if self._pictures:
                self._n_sent += 1
                return self._pictures.popleft()
            self._wake.clear()
            await self._wake.wait()


class Hub:
    """All open pages.

    Parameters
    ----------
    want_pictures : callable
        Told whether any page wants pictures, whenever that changes.
    """

    def __init__(self, want_pictures: Callable[[bool], None]) -> None:
        self._want_pictures = want_pictures
        self._viewers: set[Viewer] = set()
        self._axes: Mapping[str, Any] | None = None
        self._backlog: deque[bytes] = deque(maxlen=_BACKLOG)
        self._is_wanted = False

    def __len__(self) -> int:
        return len(self._viewers)

    def add(self, viewer: Viewer) -> None:
        """Take in a page."""
        self._viewers.add(viewer)

    def remove(self, viewer: Viewer) -> None:
        """Let a page go."""
        self._viewers.discard(viewer)
        self._look()

    def watch(self, viewer: Viewer, *, wants_pictures: bool) -> None:
        """Note whether a page shows pictures; it gets those of the last while at first."""
        if wants_pictures and not viewer.wants_pictures and self._axes is not None:
            viewer.put_text(_dump({"type": "axes", **self._axes}))
            viewer.put_backlog(list(self._backlog))
        viewer.wants_pictures = wants_pictures
        self._look()

    def broadcast(self, message: Mapping[str, Any]) -> None:
        """Send a message to every page."""
        if self._viewers:
            text = _dump(message)
            for viewer in self._viewers:
                viewer.put_text(text)

    def announce(self, axes: Mapping[str, Any]) -> None:
        """Take the axes of the pictures to come."""
        self._axes = axes
        self._backlog.clear()
        self.broadcast({"type": "axes", **axes})

    def show(self, data: bytes) -> None:
        """Send a picture to every page that wants it."""
        if data[0] == 1:
            self._backlog.append(data)
        for viewer in self._viewers:
            viewer.put_picture(data)

    def _look(self) -> None:
        is_wanted = any(viewer.wants_pictures for viewer in self._viewers)
        if is_wanted != self._is_wanted:
            self._is_wanted = is_wanted
            if not is_wanted:
                self._axes = None
                self._backlog.clear()
            self._want_pictures(is_wanted)


def _dump(message: Mapping[str, Any]) -> str:
    return json.dumps(message, separators=(",", ":"))
