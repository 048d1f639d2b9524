"""A clip's pictures: made in a process of their own, which a damaged file may not keep."""

import asyncio
import json
import struct
from pathlib import Path

import h5py
import pytest

from radard.web.pictures import clip_view as clip_module
from radard.web.pictures.clip_view import clip_view, read_clip
from tests.alarm_helpers import begun_clip, write_recording
from tests.device_helpers import in_thread
from tests.radar_helpers import noise
from tests.sink_helpers import decision
from tests.waiting import wait_for
from tests.web_helpers import ULID, event

pytestmark = pytest.mark.integration


@pytest.fixture
def clip(tmp_path):
    """A clip of ten seconds."""
    path = tmp_path / f"{ULID}.h5"
    write_recording(path, noise(600))
    return path


@pytest.fixture
def hanging(monkeypatch, tmp_path):
    """A program in the place of the one that reads clips: it never ends, and says its number."""
    program = tmp_path / "bin" / "hang"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/pid\nexec sleep 600\n")
    program.chmod(0o755)
    monkeypatch.setattr(clip_module.sys, "executable", str(program))
    return tmp_path / "pid"


def is_running(pid):
    """Whether a process is there."""
    try:
        with Path(f"/proc/{pid}/stat").open() as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_pictures_of_a_clip(client, clip):
    client.tell(event(clip=str(clip)))
    answer = client.get(f"/api/v1/events/{ULID}/pictures")
    assert answer.status_code == 200
    (n,) = struct.unpack_from("<I", answer.content)
    assert b'"length_s": 10.0' in answer.content[4 : 4 + n]
    assert answer.content[4 + n] == 1
    clip.write_bytes(b"no recording")
    answer = client.get(f"/api/v1/events/{ULID}/pictures")
    assert (answer.status_code, "cannot be shown" in answer.json()["error"]) == (422, True)


def test_a_clip_that_does_not_end_stops_nothing_else(make, clip, hanging, monkeypatch):
    monkeypatch.setattr(clip_module, "DEADLINE_S", 3.0)
    client = make(served=True)
    client.tell(event(clip=str(clip)))
    answers = []
    path = f"/api/v1/events/{ULID}/pictures"
    asking = in_thread(lambda: answers.append(client.get(path)))
    wait_for(hanging.exists)
    assert client.get("/healthz").status_code == 503
    assert asking.is_alive()
    asking.join(60)
    (answer,) = answers
    error = answer.json()["error"]
    assert (answer.status_code, "longer than 3 s" in error, "\n" in error) == (504, True, False)
    assert not is_running(hanging.read_text().strip())


def test_nobody_waits_for_the_process_when_the_dashboard_ends(clip, hanging):
    async def end_early():
        task = asyncio.create_task(read_clip(clip))
        while not (hanging.exists() and hanging.read_text()):
            await asyncio.sleep(0.01)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(end_early())
    assert not is_running(hanging.read_text().strip())


def decisions_of(data):
    (n,) = struct.unpack_from("<I", data)
    return json.loads(data[4 : 4 + n])["decisions"]


@pytest.mark.parametrize("damage", ["none", "huge", "vast", "elsewhere", "link", "short", "flat"])
def test_decisions_of_a_clip_are_read_without_trust(tmp_path, damage):
    path = tmp_path / f"{ULID}.h5"
    begun_clip(path, 200).finish([decision()], {})
    with h5py.File(path, "r+") as file:
        group = file["decisions"]
        if damage != "none":
            del group["t_s" if damage == "vast" else "range_m"]
        if damage == "huge":
            group.create_dataset("range_m", (10**12,), "f8", chunks=(1000,), compression="gzip")
        elif damage == "vast":
            # A few bytes that stand for 8 GB.
            group.create_dataset("t_s", (10**9,), "f8", chunks=(10**6,), fillvalue=0.0)
        elif damage == "elsewhere":
            group.create_dataset("range_m", (1,), "f8", external=[("/etc/hostname", 0, 8)])
        elif damage == "link":
            group["range_m"] = h5py.ExternalLink("/etc/passwd", "/x")
        elif damage == "flat":
            group["range_m"] = 1.0
    # What asks for gigabytes meets the limits of the process.
    data = asyncio.run(read_clip(path)) if damage == "vast" else clip_view(path)
    made = decisions_of(data)
    assert [row["range_m"] for row in made] == ([2.1] if damage == "none" else [])
    if damage == "none":
        assert (made[0]["label"], made[0]["alarm"]) == ("human", True)


def test_a_clip_is_shown_while_it_is_written(tmp_path):
    path = tmp_path / f"{ULID}.h5"
    clip = begun_clip(path, 200)
    assert decisions_of(asyncio.run(read_clip(path))) == []
    clip.finish([], {})
    assert asyncio.run(read_clip(path))
