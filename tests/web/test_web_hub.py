"""Pages that are slow, many, or gone: what they get, and that nobody waits for them."""

import asyncio
import contextlib
import json
import resource
import signal

import pytest

from radard.web.hub import MAX_IN_FLIGHT, MAX_TEXTS, Hub, Viewer
from radard.web.labels import add_label, read_labels

PICTURE = b"\x01 columns"
GAIT = b"\x02 gait"


async def taken(viewer):
    """Everything that a page would be sent now."""
    found = []
    with contextlib.suppress(TimeoutError):
        while True:
            found.append(await asyncio.wait_for(viewer.next(), 0.02))
    return found


def hub_of(n):
    """A hub with pages that want pictures, and what it asked for."""
    asked = []
    hub = Hub(asked.append)
    viewers = [Viewer() for _ in range(n)]
    for viewer in viewers:
        hub.add(viewer)
        hub.watch(viewer, wants_pictures=True)
    return hub, viewers, asked


def test_pictures_are_wanted_exactly_while_somebody_shows_some():
    hub, (one, two), asked = hub_of(2)
    hub.watch(one, wants_pictures=False)
    assert asked == [True]
    for each in (two, one, one):
        hub.remove(each)
        assert asked == [True, False]


def test_a_slow_page_loses_pictures_and_no_records():
    async def go():
        hub, (slow,), _ = hub_of(1)
        for k in range(100):
            hub.show(PICTURE)
            hub.broadcast({"type": "decision", "seq": k})
        got = await taken(slow)
        assert sum(item == PICTURE for item in got) == MAX_IN_FLIGHT
        assert [json.loads(t)["seq"] for t in got if isinstance(t, str)] == list(range(100))
        hub.show(PICTURE)
        assert await taken(slow) == []
        slow.drawn(MAX_IN_FLIGHT)
        hub.show(PICTURE)
        assert await taken(slow) == [PICTURE]
        # No page can claim more than it got.
        slow.drawn(10**12)
        slow.drawn(-5)
        for _ in range(100):
            hub.show(PICTURE)
        assert len(await taken(slow)) == MAX_IN_FLIGHT

    asyncio.run(go())


def test_a_page_that_takes_nothing_is_given_up():
    hub, (dead,), _ = hub_of(1)
    for k in range(MAX_TEXTS + 1):
        hub.broadcast({"type": "decision", "seq": k})
    assert dead.is_overrun


def test_a_late_page_gets_axes_and_the_last_pictures():
    async def go():
        hub, _, _ = hub_of(1)
        hub.announce({"pictures": []})
        for _ in range(40):
            hub.show(PICTURE)
        hub.show(GAIT)
        late = Viewer()
        hub.add(late)
        hub.watch(late, wants_pictures=True)
        got = await taken(late)
        assert json.loads(got[0]) == {"type": "axes", "pictures": []}
        assert got[1:] == [PICTURE] * 40
        hub.show(PICTURE)
        assert await taken(late) == [PICTURE]

    asyncio.run(go())


def test_all_is_sent_once_every_page_has_taken_every_text():
    async def go():
        hub, pages, _ = hub_of(2)
        hub.broadcast({"type": "status", "state": "offline"})
        told = asyncio.create_task(hub.has_sent_all())
        await taken(pages[0])
        assert not told.done()
        await taken(pages[1])
        await asyncio.wait_for(told, 60)
        hub.broadcast({"type": "status", "state": "offline"})
        again = asyncio.create_task(hub.has_sent_all())
        await asyncio.sleep(0)
        assert not again.done()
        again.cancel()

    asyncio.run(go())


def test_a_label_costs_no_other_whatever_the_disk_takes(tmp_path, monkeypatch):
    """Half a line, as a power cut or a full disk leaves it, would take the next one along."""
    path = tmp_path / "labels.jsonl"
    path.write_text('{"event": "cut", "la')
    add_label(path, {"event": "A", "label": "pet"})
    assert read_labels(path) == {"A": "pet"}
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 20, limits[1]))
        with pytest.raises(OSError, match=r"File too large: '.*labels\.jsonl'"):
            add_label(path, {"event": "B", "label": "human"})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, ignored)
    assert path.read_bytes() == before


def test_broken_lines_among_labels_are_passed_over(tmp_path):
    path = tmp_path / "deep" / "labels.jsonl"
    assert read_labels(path) == {}
    add_label(path, {"event": "A", "label": "pet"})
    with path.open("a") as file:
        file.write('{"event": "B", "label":\n[]\n{"event": 5, "label": "pet"}\n')
    add_label(path, {"event": "A", "label": "human"})
    assert read_labels(path) == {"A": "human"}
    assert path.parent.stat().st_mode & 0o777 == 0o700
