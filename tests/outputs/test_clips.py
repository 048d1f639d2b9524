"""Clips: the frames around an alarm, kept whole, replayed alike; which go, and which stay."""

import contextlib
import fcntl
import io
import json
import os
import shutil
import threading
from pathlib import Path

import h5py
import matplotlib.image
import numpy as np
import pytest

from radard.clips.keeper import ClipKeeper
from radard.clips.room import date_last, limit_size, prepare_folder
from radard.clips.spectrogram_png import PictureMaker, decode_png, encode_png
from radard.config.sections import ClipsSection
from radard.errors import OutputError
from tests.alarm_helpers import begun_clip
from tests.processes import ran
from tests.radar_helpers import BASEBAND, decisions, events, noise, run_radard
from tests.sink_helpers import decision, event, ulid
from x2radar.frame import Frame, StreamInfo
from x2radar.recording.registry import open_recording

RATE_HZ = 60.0
STREAM = StreamInfo(BASEBAND, RATE_HZ, "test")
N_SLOW = 147
SAMPLES = noise(60 * 60)


def run_with_clips(folder, port, seconds, *argv, env=()):
    """Run at full speed with clips; return records, clips, the oldest first, and stderr."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ({"STATE_DIRECTORY": str(folder)} | dict(env)).items():
            patch.setenv(name, value)
        common = ("--speed", "max", "--duration", str(seconds), "-o", "json")
        code, records, err = run_radard("--port", port, *common, *argv)
    assert code == 0, err
    return records, sorted((folder / "clips").glob("*.h5")), err


@pytest.mark.parametrize(
    ("port", "seconds"), [("sim:demo", 60), ("sim:demo?kind=baseband", 40), ("sim:human", 30)]
)
def test_a_clip_replays_to_the_same_decisions(tmp_path, port, seconds):
    records, (clip, *_), _ = run_with_clips(tmp_path, port, seconds)
    new, *_ = events(records, "alarm")
    assert new["clip"] == str(clip)
    live = {d["seq"]: d for d in decisions(records)}
    with h5py.File(clip) as file:
        offset_s = file.attrs["stream_t_s"]
        kept = {name: file[f"decisions/{name}"][()] for name in file["decisions"]}
    again = decisions(run_with_clips(tmp_path / "again", f"replay:{clip}", seconds)[0])
    # Of a replay no clips are made.
    assert not (tmp_path / "again").exists()
    assert len(again) == len(kept["seq"]) >= 5
    assert next(d for d in again if round(d["t_s"] + offset_s, 3) == new["t_s"])["alarm"]
    for k, made in enumerate(again):
        then = live[int(kept["seq"][k])]
        assert made["t_s"] == pytest.approx(kept["t_s"][k], abs=2e-3)
        assert then["t_s"] == pytest.approx(made["t_s"] + offset_s, abs=2e-3)
        assert kept["label"][k].decode() == then["label"]
        for name in ("gate", "label", "alarm"):
            assert made[name] == then[name]
        # Clutter map, noise floor and tracks know of what was before the clip; it does not.
        for name, most in (("p_human", 0.02), ("p_pet", 0.02), ("range_m", 0.05)):
            assert made[name] == pytest.approx(then[name], abs=most)
        # Of an empty room there is nothing but what the clutter map leaves.
        most_db = 0.3 if made["gate"] == "open" else 1.5
        assert made["power_db"] == pytest.approx(then["power_db"], abs=most_db)


def test_what_a_clip_holds(tmp_path):
    records, (clip,), _ = run_with_clips(tmp_path, "sim:human", 20, "--sensitivity", "high")
    hello = records[0]
    with h5py.File(clip) as file:
        attrs = dict(file.attrs)
        picture = file["picture"][()]
        n_frames, n_samples = file["frames/samples"].shape
    assert n_samples == 768
    assert attrs["config_hash"] == hello["config_hash"]
    assert (attrs["model"], attrs["sensor"]) == ("accurate", "radar")
    assert len(attrs["model_sha256"]) == 64
    event = json.loads(attrs["event"])
    assert (event["id"], event["clip"]) == (clip.stem, str(clip))
    assert picture.min() < 30
    assert picture.max() > 220
    decoded, axes = decode_png(clip.with_suffix(".png").read_bytes())
    assert (decoded == picture).all()
    # c fp / (4 f) of an X2 at 60 Hz; its swath; the clip's length but for the last CPI.
    assert axes["velocity_mps"] == pytest.approx([-0.66, 0.66], abs=0.03)
    assert axes["range_m"] == pytest.approx([0.6, 3.4], abs=0.1)
    assert axes["length_s"] == pytest.approx(n_frames / 60, abs=0.5)
    assert clip.stat().st_mode & 0o600 == 0o600
    assert clip.parent.stat().st_mode & 0o077 == 0
    with open_recording(clip) as reader:
        assert reader.warning is None


@pytest.mark.parametrize(
    "argv", [("RADARD_CLIPS__ENABLED", "false"), ("STATE_DIRECTORY", "")], ids=["off", "no folder"]
)
def test_off_nothing_is_kept(tmp_path, argv):
    records, clips, _ = run_with_clips(tmp_path, "sim:human", 20, env=[argv])
    assert ({e["clip"] for e in events(records, "alarm")}, clips) == ({None}, [])


def test_a_simulated_stream_that_begins_again_keeps_its_clips(tmp_path):
    _, (clip,), _ = run_with_clips(tmp_path, "sim:human?run=again", 6)
    before = clip.read_bytes()
    # As one of another stream would be, which came in between.
    later_ns = clip.stat().st_mtime_ns + 10**12
    other = clip.with_name(f"{'7' * 26}.h5")
    other.touch()
    os.utime(other, ns=(later_ns, later_ns))
    # Else the alarm that is on stays on, and none begins.
    (tmp_path / "log.db").unlink()
    records, _, err = run_with_clips(tmp_path, "sim:human?run=again", 6)
    assert "clip" not in err
    assert {e["clip"] for e in events(records)} == {str(clip)}
    assert clip.read_bytes() == before
    assert clip.stat().st_mtime_ns > later_ns


def frame(index, *, lost=0):
    return Frame(SAMPLES[index % len(SAMPLES)], index + 1, index, lost, False, BASEBAND)


class Feeder:
    """Push frames and decisions into a keeper as reader and worker do."""

    def __init__(self, keeper, *, ahead=0):
        self.keeper, self.ahead = keeper, ahead
        self.pushed = self.hops = 0

    def hop(self, n=1):
        for _ in range(n):
            end = N_SLOW + 60 * self.hops
            while self.pushed < end + self.ahead:
                self.keeper.push(frame(self.pushed))
                self.pushed += 1
            self.hops += 1
            self.t_s = end / RATE_HZ
            made = decision(self.hops, t_s=round(self.t_s, 3), gate="closed", alarm=False)
            self.keeper.on_decision(made, self.t_s)

    def after(self, *, is_seen, n=1):
        for _ in range(n):
            self.keeper.after(self.t_s, is_seen=is_seen)
            self.hop()


def make_keeper(tmp_path, **settings):
    given = {"pre_s": 5.0, "post_s": 2.0, "longest_s": 30.0, "free_mb": 0.0, **settings}
    keeper = ClipKeeper(ClipsSection(**given), tmp_path / "clips", STREAM, N_SLOW, {})
    return keeper, Feeder(keeper)


def span(path):
    """First and last frame counter, and the number of decisions."""
    with h5py.File(path) as file:
        counter = file["frames/counter"]
        return int(counter[0]), int(counter[-1]), len(file["decisions/seq"])


@pytest.mark.parametrize("ahead", [0, 1, 100, 180])
def test_the_frames_of_a_clip_do_not_depend_on_who_is_faster(tmp_path, ahead):
    keeper, feeder = make_keeper(tmp_path)
    feeder.ahead = ahead
    feeder.hop(20)
    path = keeper.begin(event(0), feeder.t_s)
    feeder.after(is_seen=True, n=3)
    feeder.after(is_seen=False, n=4)
    assert keeper.close(60.0)
    # 5 s before the dwell of decision 20, on the grid of the hops; 2 s after it was last seen.
    first, last, n = span(path)
    assert first == 1 + 60 * 14
    assert last == N_SLOW + 60 * 23
    assert n == (last - first - N_SLOW + 1) / 60 + 1


def test_early_alarms_long_alarms_and_one_clip_at_a_time(tmp_path):
    keeper, feeder = make_keeper(tmp_path, longest_s=10.0)
    feeder.hop(2)
    path = keeper.begin(event(0), feeder.t_s)
    assert keeper.begin(event(1), feeder.t_s) is None
    feeder.after(is_seen=True, n=30)
    keeper.begin(event(2), feeder.t_s)
    other = tmp_path / "clips" / f"{ulid(2)}.h5"
    keeper.after(feeder.t_s, is_seen=True)
    assert keeper.close(60.0)
    assert span(path)[:2] == (1, 600)
    assert span(other)[1] == N_SLOW + 60 * 31
    assert not keeper.complaint


def test_no_clip_reaches_back_over_a_restart(tmp_path):
    keeper, feeder = make_keeper(tmp_path)
    feeder.hop(10)
    keeper.restart()
    feeder.hop(1)
    path = keeper.begin(event(0), feeder.t_s)
    assert keeper.close(60.0)
    assert span(path)[0] == 1 + 60 * 10


@pytest.mark.parametrize("is_full", [True, False])
def test_without_room_there_is_no_clip_and_a_complaint_and_the_next_is_tried(tmp_path, is_full):
    if not is_full:
        (tmp_path / "clips").write_text("a file")
    keeper, feeder = make_keeper(tmp_path, free_mb=1e12 if is_full else 0.0)
    feeder.hop(3)
    assert keeper.begin(event(0), feeder.t_s) is None
    assert ("MB are free" if is_full else "File exists") in keeper.complaint
    keeper.settings = keeper.settings.model_copy(update={"free_mb": 0.0})
    if not is_full:
        (tmp_path / "clips").unlink()
    path = keeper.begin(event(0), feeder.t_s)
    feeder.after(is_seen=False, n=5)
    assert keeper.close(60.0)
    assert Path(path).is_file()
    assert not keeper.complaint


def test_a_run_whose_clips_fail_goes_on_degraded(tmp_path):
    (tmp_path / "clips").write_text("a file")
    records, _, err = run_with_clips(tmp_path, "sim:demo", 40)
    assert "clip:" in err
    degraded, *_ = [r for r in records if r.get("state") == "degraded"]
    assert degraded["reason"].startswith("clips: ")
    assert {alarm["clip"] for alarm in events(records, "alarm")} == {None}


def test_a_reader_keeps_no_decision_out_of_a_clip(tmp_path):
    path = tmp_path / "read.h5"
    clip = begun_clip(path, 150)
    with path.open("rb") as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        clip.finish([decision(t_s=2.0)], event(0))
    with h5py.File(path) as file:
        assert "event" in file.attrs
        assert list(file["decisions/t_s"]) == [2.0]


FULL_AT_ITS_END = """
import contextlib, gc, resource, signal
from radard.errors import OutputError
from tests.outputs.test_clips import *
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for extra in range(0, 40_000, 1_000):
    path = Path(f"{extra}.h5")
    clip = begun_clip(path, 150)
    limit = path.stat().st_size + extra
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    with contextlib.suppress(OutputError):
        clip.finish([decision(t_s=2.0)] * (1 + extra // 500), event(0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    del clip
    gc.collect()
    with open_recording(path) as reader:
        frames = list(reader.frames())
    assert len(frames) >= 120, extra
    with h5py.File(path, swmr=True) as file:
        assert ("decisions" in file) == ("event" in file.attrs)
print("all are whole")
"""


@pytest.mark.integration
def test_a_disk_that_fills_as_a_clip_ends_costs_its_decisions_and_not_the_daemon(tmp_path):
    """A limit on a file's size stands for the disk's end; HDF5 could crash the process there."""
    done = ran("-c", FULL_AT_ITS_END, cwd=tmp_path, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "all are whole\n", "")


def test_a_png_holds_the_picture():
    picture = np.random.default_rng(0).integers(0, 256, (7, 11, 3)).astype(np.uint8)
    png = encode_png(picture)
    # As another program reads it.
    assert (np.rint(255 * matplotlib.image.imread(io.BytesIO(png), "png")) == picture).all()
    assert (decode_png(png)[0] == picture).all()


PNG = encode_png(np.zeros((2, 2, 3), np.uint8), {})
DAMAGED = [b"", b"GIF89a", PNG[:40], PNG.replace(b"IDAT", b"IDOT"), PNG.replace(b"\0{}", b"\0{{")]
DAMAGED += [PNG.replace(b"\x02\x08\x02", b"\x02\x08\x03")]
DAMAGED += [PNG.replace(b"\0\0\0\x02\0\0\0\x02", b"\xff" * 8)]


@pytest.mark.parametrize("data", DAMAGED)
def test_what_is_no_picture_of_ours_is_refused(data):
    with pytest.raises(ValueError, match=r"."):
        decode_png(data)


def test_pictures_of_odd_streams():
    maker = PictureMaker(STREAM)
    assert maker.picture() is None
    maker.push([frame(k) for k in range(10)])
    assert maker.picture() is None
    bad = Frame(np.full(64, np.nan, np.complex64), 1, 10, 0, False, BASEBAND)
    maker.push([bad, *(frame(k) for k in range(11, 130))])
    assert maker.picture().dtype == np.uint8
    silent = PictureMaker(STREAM)
    silent.push([Frame(np.zeros(64, np.complex64), 1, 0, 0, False, BASEBAND)] * 100)
    assert silent.picture().shape[2] == 3


def test_a_clip_is_named_by_its_path_once_a_slow_disk_answers(tmp_path):
    """What was told meanwhile, without a clip, is no name of it."""
    keeper, feeder = make_keeper(tmp_path)
    feeder.hop(3)
    disk = threading.Event()
    keeper._do(disk.wait)
    assert keeper.begin(event(0), feeder.t_s) is None
    keeper.after(feeder.t_s, is_seen=True, event={**event(0), "clip": None})
    assert keeper.named_of(ulid(0)) is None
    disk.set()
    keeper._room.result(60)
    path = tmp_path / "clips" / f"{ulid(0)}.h5"
    assert keeper.named_of(ulid(0)) == str(path)
    feeder.hop()
    assert keeper.close(60.0)
    with h5py.File(path) as file:
        assert json.loads(file.attrs["event"])["clip"] == str(path)


_LATE = """
import sys, threading, time
from pathlib import Path
from h5py._hl.base import phil
from radard.clips.keeper import ClipKeeper
from radard.clips.room import date_last, limit_size, prepare_folder
from radard.config.sections import ClipsSection
from tests.outputs.test_clips import STREAM

keeper = ClipKeeper(ClipsSection(), Path(sys.argv[1]), STREAM, 147, {})
holds = threading.Event()

def slow():
    with phil:
        holds.set()
        time.sleep(2)

keeper._do(slow)
assert holds.wait(60)
closer = threading.Thread(target=lambda: print(keeper.close(0.01)), daemon=sys.argv[2] == "daemon")
closer.start()
closer.join()
"""


@pytest.mark.integration
@pytest.mark.parametrize("closer", ["plain", "daemon"])
def test_a_clip_that_is_late_does_not_hang_the_end_of_the_process(tmp_path, closer):
    """It once did for ever: its thread held the lock of HDF5 when the interpreter ended.

    With several radars the threads that close their clips are daemons.
    """
    done = ran("-c", _LATE, tmp_path, closer)
    assert (done.returncode, done.stdout) == (0, "False\n"), done.stderr


def clip_of(folder, k, at_s=None):
    """The two files of a clip, of a thousand bytes each."""
    for suffix in ("h5", "png"):
        path = folder / f"{str(k) * 26}.{suffix}"
        path.write_bytes(b"x" * 1000)
        if at_s is not None:
            os.utime(path, (at_s, at_s))
    return path


def left_in(folder):
    return "".join(sorted({path.name[0] for path in folder.iterdir()}))


def test_retention_takes_the_oldest_clips_and_nothing_else(tmp_path):
    for k in range(5):
        clip_of(tmp_path, k, 1000 + k)
    (tmp_path / "holiday.h5").write_bytes(b"x" * 10_000)
    limit_size(tmp_path, keep_bytes=6000)
    assert left_in(tmp_path) == "234h"
    limit_size(tmp_path, keep_bytes=0)
    assert left_in(tmp_path) == "4h"


@pytest.mark.parametrize(
    ("free", "floor", "left"), [(5000, 5000, "012"), (5000, 7000, "12"), (0, 6001, "012")]
)
def test_nothing_is_deleted_unless_that_makes_the_room(tmp_path, monkeypatch, free, floor, left):
    for k in range(3):
        clip_of(tmp_path, k, 1000 + k)
    whole = 6000 + free

    def usage(folder):
        used = sum(path.stat().st_size for path in folder.iterdir())
        return shutil._ntuple_diskusage(whole, used, whole - used)

    monkeypatch.setattr("radard.clips.room.shutil.disk_usage", usage)
    with contextlib.nullcontext() if left != "012" or free else pytest.raises(OutputError):
        prepare_folder(tmp_path, free_bytes=floor)
    assert left_in(tmp_path) == left


def test_a_clip_that_a_backup_has_too_makes_no_room_and_stays(tmp_path, monkeypatch):
    folder = tmp_path / "clips"
    folder.mkdir()
    for k in range(3):
        clip_of(folder, k, 1e9 + k)
    for path in folder.iterdir():
        (tmp_path / path.name).hardlink_to(path)
    full = shutil._ntuple_diskusage(9000, 9000, 0)
    monkeypatch.setattr("radard.clips.room.shutil.disk_usage", lambda _: full)
    with pytest.raises(OutputError, match="are free"):
        prepare_folder(folder, free_bytes=1000)
    assert left_in(folder) == "012"


@pytest.mark.parametrize("grain_ns", [1, 2 * 10**9], ids=["ext4", "FAT"])
def test_a_clock_that_was_ahead_takes_no_later_clip(tmp_path, grain_ns):
    """Names tell nothing of the order, and a card may keep times to 2 s."""
    for k in (9, 8, 7):
        clip_of(tmp_path, k, 4e9 - 2 * k)
    for k in (6, 5, 4):
        date_last(clip_of(tmp_path, k))
        for path in tmp_path.iterdir():
            kept_ns = path.stat().st_mtime_ns // grain_ns * grain_ns
            os.utime(path, ns=(kept_ns, kept_ns))
        limit_size(tmp_path, keep_bytes=6000)
    assert left_in(tmp_path) == "456"
