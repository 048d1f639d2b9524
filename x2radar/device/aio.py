"""AsyncRadar: the same frames for asyncio; a thread reads, the loop takes.

The thread waits while `max_waiting` frames, a second at usual rates, are not taken: a task that is
too slow makes the system's buffer overflow, and what is lost there is stated in `Frame.lost`.
"""

import asyncio
import contextlib
import threading

from x2radar.device.device import RadarStats, X2Radar
from x2radar.errors import TransportClosed
from x2radar.frame import Frame, StreamInfo


class AsyncRadar:
    """An asynchronous context manager and iterator around a radar.

    `radar` is opened and closed here: leaving the block closes the port, also when its task is
    cancelled, while the radar is still being opened as well.
    """

    _loop: asyncio.AbstractEventLoop

    def __init__(self, radar: X2Radar, *, max_waiting: int = 64) -> None:
        self._radar = radar
        self._room = threading.Semaphore(max_waiting)
        self._halt = threading.Event()
        self._queue: asyncio.Queue[Frame | BaseException] = asyncio.Queue()
        self._thread = threading.Thread(target=self._read, name="x2radar-reader", daemon=True)

    @property
    def stats(self) -> RadarStats:
        """Counts up to now: a snapshot."""
        return self._radar.stats

    @property
    def stream(self) -> StreamInfo | None:
        """What holds for every frame; known with the first one."""
        return self._radar.stream

    async def __aenter__(self) -> "AsyncRadar":
        """Open the radar in a thread; raises as `X2Radar.open`."""
        self._loop = asyncio.get_running_loop()
        try:
            await asyncio.to_thread(self._radar.open, halt=self._halt)
        except BaseException:
            # Cancelled, perhaps: then the thread that opens ends now, too.
            self._halt.set()
            self._radar.close()
            raise
        self._thread.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the port and wait for the reader; a second cancellation ends only the wait."""
        self._halt.set()
        self._room.release()
        await asyncio.shield(asyncio.to_thread(self._end))

    def _end(self) -> None:
        self._radar.close()
        self._thread.join()

    def __aiter__(self) -> "AsyncRadar":
        """Iterate over the frames; see `__anext__`."""
        return self

    async def __anext__(self) -> Frame:
        """Return the next frame; raises as `X2Radar.frames`."""
        if self._thread.ident is None:
            raise TransportClosed("the radar is not open: use 'async with'")
        if self._halt.is_set() and self._queue.empty():
            raise StopAsyncIteration
        item = await self._queue.get()
        if isinstance(item, BaseException):
            if self._halt.is_set():
                raise StopAsyncIteration
            self._halt.set()
            raise item
        self._room.release()
        return item

    def _read(self) -> None:
        try:
            for frame in self._radar.frames():
                self._room.acquire()
                if self._halt.is_set():
                    return
                self._hand_over(frame)
        except BaseException as err:  # noqa: BLE001 - handed over to the task that reads
            self._hand_over(err)

    def _hand_over(self, item: Frame | BaseException) -> None:
        # RuntimeError: the loop is closed, nobody waits any more.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._queue.put_nowait, item)
