"""Fields of recordings that are of another kind, or mean other samples: honoured, or refused."""

import os
from datetime import UTC, datetime

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.config.quiet_hours import recorded_clock
from tests.recording_helpers import make, refused, run
from x2radar.commands.convert import convert
from x2radar.errors import RecordingError
from x2radar.recording.registry import FORMATS, WRITABLE, check_no_recording, open_recording
from x2radar.wall_clock import parse_utc

N = 150


@pytest.fixture
def archive(tmp_path):
    """Makes an archive of a good recording with other fields; None leaves one out."""
    source, _ = make(tmp_path / "good.h5")
    convert(source, tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        good = dict(file)

    def made(**changes):
        fields = {k: v for k, v in (good | changes).items() if v is not None}
        np.savez(tmp_path / "other.npz", **fields)
        return tmp_path / "other.npz"

    return made


def column(value, dtype=np.float64):
    out = np.arange(1, N + 1).astype(dtype)
    out[5] = value
    return out


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"counter": column(np.nan)}, "counters that are no numbers"),
        ({"counter": column(-np.inf)}, "counters that are no numbers"),
        ({"counter": column(1e300)}, "counters that are no numbers"),
        ({"counter": column(0.5)}, "counters that are no numbers"),
        ({"t_s": column(np.nan)}, "times of frames that are no numbers"),
        ({"t_s": column(np.inf)}, "times of frames that are no numbers"),
        ({"frame_rate_hz": 1e30}, "'frame_rate_hz' is 1e"),
        ({"frame_rate_hz": 1e-30}, "'frame_rate_hz' is 1e"),
        ({"bin_length_m": 1e30}, "'bin_length_m' is 1e"),
        ({"carrier_hz": 1e300}, "'carrier_hz' is 1e"),
        ({"range_offset_m": -1e300}, "'range_offset_m' is -1e"),
        ({"labels_t0_s": np.array([0.0, np.nan])}, "labels with times"),
        ({"labels_t0_s": np.array([0.0])}, "damaged"),
        ({"labels_t0_s": None}, "labels lack one"),
    ],
    ids=str,
)
def test_what_is_no_number_and_no_radars_is_refused_in_one_line(capsys, archive, changes, words):
    code, out, err = run(capsys, "info", str(archive(**changes)), "--json")
    assert (code, out) == (66, "")
    assert words in err
    assert err.count("\n") == 1


def test_labels_may_be_bytes_and_a_start_may_be_unknown(archive, tmp_path):
    with open_recording(archive(labels_label=np.array([b"human", b"dog"]))) as reader:
        assert [label for _, _, label in reader.labels] == ["human", "dog"]
    convert(archive(started_utc=None), tmp_path / "out.h5")
    with h5py.File(tmp_path / "out.h5") as file:
        assert file.attrs["started_utc"] == ""


def test_samples_beyond_single_precision_are_infinite_without_a_word(archive):
    with open_recording(archive(samples=np.full((N, 8), 1e39 + 0j))) as reader:
        assert not np.isfinite(next(reader.frames()).samples).any()


@pytest.mark.parametrize("form", list(FORMATS))
@pytest.mark.parametrize("is_named", [True, False])
def test_a_pipe_is_no_recording_and_nobody_waits_for_it(tmp_path, form, is_named):
    path = tmp_path / f"pipe{FORMATS[form].suffixes[0]}"
    os.mkfifo(path)
    refused(path, "is no file", kind=form if is_named and FORMATS[form].reader else None)


@given(st.text(max_size=40) | st.datetimes().map(lambda when: when.isoformat()))
def test_any_start_can_be_gone_on_from(text):
    started = parse_utc(text)
    assert (recorded_clock(text)(1e9) is None) == (started is None)
    assert started is None or started.tzinfo is UTC


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("9999-12-31T23:59:59Z", None),
        ("0001-01-01T00:00:00+14:00", None),
        ("yesterday", None),
        ("2026-03-01T12:00:00", datetime(2026, 3, 1, 12, tzinfo=UTC)),
        ("2026-03-01T12:00:00+14:00", datetime(2026, 2, 28, 22, tzinfo=UTC)),
    ],
)
def test_a_start_without_a_zone_is_utc_and_one_out_of_time_is_none(text, expected):
    assert parse_utc(text) == expected


@pytest.mark.parametrize("form", WRITABLE)
def test_the_same_recording_makes_the_same_file_whenever_and_wherever(
    tmp_path, monkeypatch, archive, form
):
    """Times of a start without a zone were those of the computer's own; of one without, now."""
    import time

    from x2radar import wall_clock

    made = []
    source = archive(started_utc="2026-03-01T12:00:00")
    if form == "framelogger":
        source, _ = make(tmp_path / "rf.h5", "rf")
    for zone, now_s in (("UTC", 1.7e9), ("Asia/Tokyo", 1.8e9)):
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        monkeypatch.setattr(time, "time", lambda now_s=now_s: now_s)
        monkeypatch.setattr(wall_clock, "now_s", lambda now_s=now_s: now_s)
        folder = tmp_path / zone.replace("/", "")
        folder.mkdir()
        convert(source, folder / f"same{FORMATS[form].suffixes[0]}", out_kind=form)
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        made.append([(path.name, path.read_bytes()) for path in files])
    monkeypatch.undo()
    time.tzset()
    assert made[0] == made[1]


@pytest.mark.parametrize("form", [form for form in WRITABLE if FORMATS[form].reader])
def test_a_recording_is_known_whatever_it_is_called(tmp_path, form):
    source, _ = make(tmp_path / "good.h5", "rf" if form == "framelogger" else "baseband")
    out = tmp_path / f"made{FORMATS[form].suffixes[0]}"
    convert(source, out, out_kind=form)
    for path in FORMATS[form].files(out):
        if path.is_file():
            with pytest.raises(RecordingError, match="is not overwritten"):
                check_no_recording(path)
    if FORMATS[form].magic and form != "mat":
        out.rename(tmp_path / "table.csv")
        with pytest.raises(RecordingError, match="is not overwritten"):
            check_no_recording(tmp_path / "table.csv")
    (tmp_path / "plain.csv").write_text("a,b\n")
    check_no_recording(tmp_path / "plain.csv")
    check_no_recording(tmp_path / "nothing.h5")
