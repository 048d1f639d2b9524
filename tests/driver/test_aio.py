"""Frames for asyncio: the same ones, and every way out closes the port."""

import asyncio
import threading
import time

import numpy as np
import pytest

import x2radar
from tests.device_helpers import faulty
from x2radar.device.aio import AsyncRadar
from x2radar.device.link import Deadlines
from x2radar.device.transport import PtyTransport
from x2radar.errors import DeviceError, PortNotFound, ReadTimeout, TransportClosed
from x2radar.ports import parse_port
from x2radar.radars import make_radar


def readers():
    return [t for t in threading.enumerate() if t.name == "x2radar-reader"]


async def take(stream, n, got=None):
    got = [] if got is None else got
    async for frame in stream:
        got.append(frame)
        if len(got) == n:
            break
    return got


def test_the_same_frames_as_without_asyncio():
    async def main():
        async with x2radar.open_async("sim:human", speed=None) as stream:
            got = await take(stream, 100)
            assert stream.stats.frames >= 100
            assert stream.stream.frame_rate_hz == 60
            return got

    got = asyncio.run(main())
    with make_radar(parse_port("sim:human"), speed=None) as plain:
        for mine, its in zip(got, plain, strict=False):
            assert (mine.index, mine.counter) == (its.index, its.counter)
            assert np.array_equal(mine.samples, its.samples)
    assert not readers()


def test_a_slow_task_reads_every_frame_in_order():
    async def main():
        async with AsyncRadar(faulty(), max_waiting=4) as stream:
            for k in range(50):
                assert (await anext(stream)).index == k
                await asyncio.sleep(0.001)

    asyncio.run(main())


@pytest.mark.parametrize(
    ("faults", "error"), [("hang_up:1", TransportClosed), ("silent:1", ReadTimeout)]
)
def test_a_loss_is_raised_once_then_the_stream_is_over(faults, error):
    async def main():
        got = []
        stream = AsyncRadar(faulty(faults, deadlines=Deadlines(reply_s=60, stall_s=1)))
        async with stream:
            with pytest.raises(error):
                await take(stream, -1, got)
            assert [f.index for f in got] == list(range(len(got)))
            assert len(got) > 10
            assert await take(stream, 1) == []

    asyncio.run(main())
    assert not readers()


def test_errors_of_opening_come_where_it_is_opened():
    async def main(stream):
        async with stream:
            raise AssertionError

    with pytest.raises(DeviceError):
        asyncio.run(main(AsyncRadar(faulty("error_reply:1"))))
    with pytest.raises(PortNotFound):
        asyncio.run(main(x2radar.open_async("/dev/ttyNOTHING")))
    # One that was not opened says so.
    with pytest.raises(TransportClosed, match="async with"):
        asyncio.run(take(AsyncRadar(faulty()), 1))


@pytest.mark.integration
def test_cancelled_while_it_opens_and_while_it_waits():
    silent = PtyTransport()

    async def opening():
        async with x2radar.open_async(silent.path):
            raise AssertionError

    async def waiting():
        async with AsyncRadar(faulty("silent:0.5", deadlines=Deadlines(stall_s=60))) as stream:
            async for _ in stream:
                pass

    for task in (opening, waiting):
        began_s = time.monotonic()
        with pytest.raises(TimeoutError):
            asyncio.run(asyncio.wait_for(task(), 0.4))
        assert time.monotonic() - began_s < 30
        assert not readers()
    silent.close()
