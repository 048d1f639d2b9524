"""What other programs make of a recording and a user then replays: read, or refused in a line."""

import hashlib
import json
import tarfile
from datetime import datetime

import h5py
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pyarrow import parquet
from scipy.io import loadmat, savemat

from radard.stream.source import ReplaySource
from tests.recording_helpers import COUNTERS, LABELS, RATE_HZ, content, make, refused
from x2radar.commands.convert import convert
from x2radar.commands.info import describe_recording
from x2radar.errors import RecordingError, SettingsError
from x2radar.ports import parse_port
from x2radar.recording.about import Overrides
from x2radar.recording.registry import open_recording


def same(path, source):
    with open_recording(path) as again, open_recording(source) as first:
        for one, two in zip(content(again), content(first), strict=True):
            assert np.array_equal(one, two)
        assert again.stream == first.stream
        assert again.stream.frame_rate_hz == RATE_HZ
        assert (again.device, again.settings) == (first.device, first.settings)
        assert again.labels == LABELS


@pytest.mark.parametrize("kind", ["rf", "baseband"])
@pytest.mark.parametrize(
    "how", [{}, {"do_compression": True}, {"oned_as": "row"}, {"squeeze_me": True}]
)
def test_a_matlab_file_that_scipy_saves_again(tmp_path, kind, how):
    """Any program may write its own words into the head: the variables say what it is."""
    source, _ = make(tmp_path / "in.h5", kind, COUNTERS)
    convert(source, tmp_path / "out.mat")
    found = loadmat(tmp_path / "out.mat", squeeze_me="squeeze_me" in how)
    about = {name: value for name, value in found.items() if not name.startswith("__")}
    savemat(tmp_path / "again.mat", about, **{k: v for k, v in how.items() if k != "squeeze_me"})
    same(tmp_path / "again.mat", source)
    assert describe_recording(tmp_path / "again.mat")["format"] == "mat"


@pytest.mark.parametrize("kind", ["rf", "baseband"])
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("shape", [(-1, 1), (1, -1), (-1,)])
def test_a_numpy_archive_in_fortran_order_with_columns_or_rows(tmp_path, kind, save, shape):
    source, _ = make(tmp_path / "in.h5", kind, COUNTERS)
    convert(source, tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as archive:
        found = dict(archive)
    found["samples"] = np.asfortranarray(found["samples"])
    found |= {name: found[name].reshape(shape) for name in ("counter", "t_s")}
    save(tmp_path / "again.npz", **found)
    same(tmp_path / "again.npz", source)


@pytest.mark.parametrize("shape", [(-1, 1), (1, -1)])
@pytest.mark.parametrize("version", ["1", b"1", "1.0", 1.0, np.array([1], np.uint8)])
def test_hdf5_with_columns_or_rows_and_its_version_as_text(tmp_path, shape, version):
    source, _ = make(tmp_path / "in.h5", counters=COUNTERS)
    again, _ = make(tmp_path / "again.h5", counters=COUNTERS)
    with h5py.File(again, "r+") as file:
        for name in ("counter", "t_s"):
            values = file[f"frames/{name}"][()].reshape(shape)
            del file[f"frames/{name}"]
            file[f"frames/{name}"] = values
        file.attrs["format_version"] = version
        file.attrs["frame_rate_hz"] = str(RATE_HZ)
    same(again, source)


@pytest.mark.parametrize("by_s", [-1e9, -1.0, 1e9, 1e15])
def test_a_clock_of_a_file_that_begins_elsewhere_costs_no_frame(tmp_path, by_s):
    """As one that counts from a trigger, or from 1970; before, those below 0 were left out."""
    path, samples = make(tmp_path / "in.h5")
    with h5py.File(path, "r+") as file:
        file["frames/t_s"][...] += by_s
    with open_recording(path) as reader:
        assert [frame.index for frame in reader.frames()] == list(range(len(samples)))


@pytest.mark.parametrize("value", [0, 7, slice(None, None, -1)])
def test_counters_that_do_not_count_are_refused(tmp_path, value):
    """Before, all frames were left out as repeats, or each was a restart of the module."""
    path, samples = make(tmp_path / "in.h5")
    with h5py.File(path, "r+") as file:
        counter = file["frames/counter"]
        counter[...] = counter[()][value] if isinstance(value, slice) else value
    refused(path, "counters that do not count")
    if isinstance(value, slice):
        return
    for n in (1, 2):
        make(tmp_path / f"{n}.h5", counters=[value] * n, samples=samples[:n])
        assert len(list(open_recording(tmp_path / f"{n}.h5").frames())) == 1


@pytest.mark.parametrize("form", ["npz", "mat", "hdf5"])
def test_a_replay_takes_a_file_for_what_its_user_says(tmp_path, form):
    source, samples = make(tmp_path / "in.h5")
    odd = tmp_path / "odd.framelogger"
    convert(source, odd, out_kind=form)
    replay = ReplaySource(parse_port(f"replay:{odd}?from={form}"), None)
    assert np.array_equal([frame.samples for frame in replay.frames()], samples)
    with pytest.raises(RecordingError, match="not a FrameLogger file"):
        ReplaySource(parse_port(f"replay:{odd}?from=framelogger"), None)
    for wrong in ("cow", "parquet"):
        with pytest.raises(SettingsError, match=f"'{wrong}' is no format that is read"):
            ReplaySource(parse_port(f"replay:{odd}?from={wrong}"), None)


def sigmf(path, change=None, before=b"", behind=b"", **about):
    """A pair of ours, changed as other programs write such; returns the recording it is of."""
    source, _ = make(path / "in.h5", counters=COUNTERS)
    convert(source, path / "out.sigmf-meta")
    data = before + (path / "out.sigmf-data").read_bytes() + behind
    (path / "out.sigmf-data").write_bytes(data)
    root = json.loads((path / "out.sigmf-meta").read_text())
    root["global"] |= {"core:sha512": hashlib.sha512(data).hexdigest()} | about
    if change:
        change(root)
    (path / "out.sigmf-meta").write_text(json.dumps(root))
    return source


@pytest.mark.parametrize(("n_before", "n_behind"), [(64, 0), (0, 3), (1000, 512), (7, 4096)])
def test_bytes_in_front_of_and_behind_the_frames_are_left_out(tmp_path, n_before, n_behind):
    """They shifted every frame, without a word."""
    source = sigmf(
        tmp_path,
        lambda root: root["captures"][0].update({"core:header_bytes": n_before}),
        b"h" * n_before,
        b"t" * n_behind,
        **{"core:trailing_bytes": n_behind},
    )
    same(tmp_path / "out.sigmf-meta", source)
    assert open_recording(tmp_path / "out.sigmf-meta").warning is None


def put(place, name, value):
    def change(root):
        at = root["captures"][0] if place == "capture" else root["captures"][-1]
        at = root["annotations"][0] if place == "annotation" else at
        (root["global"] if place == "global" else at)[name] = value

    return change


def test_a_pair_of_another_program(tmp_path):
    """Any of its names opens it; what it does not say is asked for, or is the usual."""
    sigmf(tmp_path)
    meta = tmp_path / "out.sigmf-meta"
    root = json.loads(meta.read_text())
    ours = [name for name in root["global"] if name.startswith("x2radar:")]
    extension = {"name": "antenna", "version": "1.0.0", "optional": True}
    usual = {"core:offset": 0, "core:dataset": "out.sigmf-data", "core:extensions": [extension]}
    named = {"x2radar:bin_length_m": 0.03, "x2radar:phase_sign": 1}
    plain = {k: v for k, v in root["global"].items() if k not in {*ours, "core:sha512"}}
    captures = [{"core:sample_start": 0, "core:frequency": 7e9}]
    data = tmp_path / "out.sigmf-data"
    samples = np.frombuffer(data.read_bytes(), "<c8").reshape(len(COUNTERS), -1)
    data.write_bytes(data.read_bytes() + b"123")
    meta.write_text(json.dumps({"global": plain | usual | named, "captures": captures}))
    for name in ("out.sigmf-meta", "out.sigmf-data", "out"):
        with open_recording(tmp_path / name) as reader:
            assert np.array_equal(content(reader)[0], samples.conj())
            assert [f.counter for f in reader.frames()] == list(range(1, len(COUNTERS) + 1))
            assert reader.stream.axis.carrier_hz == 7e9
            assert "cut off" in reader.warning
    meta.write_text(json.dumps({"global": plain, "captures": captures}))
    refused(meta, "--bin-length")
    known = Overrides(bin_length_m=0.05)
    assert open_recording(meta, overrides=known).stream.axis.bin_length_m == 0.05


ELSEWHERE = [
    *(("core:metadata_only", True), ("core:offset", 100), ("core:dataset", "elsewhere.bin")),
    ("core:extensions", [{"name": "antenna", "version": "1.0.0", "optional": False}]),
    *(("core:extensions", 7), ("x2radar:bin_length_m", {"a": 1})),
    *(("core:num_channels", n) for n in (1 << 40, True, 1e9)),
    ("core:datatype", ["cf32_le"] * 5000),
    *(("core:sample_rate", rate) for rate in ("x" * 100_000, [1], 10**400)),
]


@pytest.mark.parametrize("value", ["a", 1.5, -1, None, True, [1], 10**40])
@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("capture", "core:sample_start"),
        ("capture", "core:header_bytes"),
        ("capture", "x2radar:counter"),
        ("global", "core:trailing_bytes"),
        ("annotation", "core:sample_start"),
        ("annotation", "core:sample_count"),
    ],
)
def test_what_is_no_whole_number_is_refused_in_words(tmp_path, place, name, value):
    sigmf(tmp_path, put(place, name, value))
    assert "Error" not in refused(tmp_path / "out.sigmf-meta", f"'{name}' is")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put("global", "core:sha512", "0" * 128), "core:sha512"),
        (put("global", "core:sha512", 5), "core:sha512"),
        (put("last capture", "core:header_bytes", 8), "core:header_bytes between frames"),
        (put("capture", "core:header_bytes", 1 << 40), "no frames"),
        (put("last capture", "core:frequency", 5e9), "core:frequency changes"),
        (put("global", "core:trailing_bytes", 1 << 40), "no frames"),
        *((put("annotation", "x2radar:t_s", t_s), "damaged") for t_s in ("ab", [1], ["a", "b"])),
        # Of other samples than those beside it, or of none that anybody has.
        *((put("global", name, value), ".") for name, value in ELSEWHERE),
    ],
)
def test_a_pair_that_does_not_add_up_is_refused(tmp_path, change, words):
    sigmf(tmp_path, change)
    assert len(refused(tmp_path / "out.sigmf-meta", words)) <= 2000


def test_a_key_of_a_pair_that_stands_twice_and_an_archive_are_refused(tmp_path):
    sigmf(tmp_path)
    meta = tmp_path / "out.sigmf-meta"
    meta.write_text(meta.read_text().replace('{"global": {', '{"global": {}, "global": {'))
    refused(meta, r"the key .* stands twice")
    with tarfile.open(tmp_path / "all.sigmf", "w") as archive:
        archive.add(meta)
    refused(tmp_path / "all.sigmf", "an archive; unpack it")


COLUMNS = {"rf": ["samples"], "baseband": ["samples_i", "samples_q"]}


def whole(parts):
    """Samples of their real and imaginary parts, or of the real ones alone."""
    return sum(np.array(part) * factor for part, factor in zip(parts, (1, 1j), strict=False))


def written(tmp_path, name, kind, **about):
    source, samples = make(tmp_path / "in.h5", kind, COUNTERS, **about)
    convert(source, tmp_path / name)
    return tmp_path / name, samples


def test_a_matlab_file_that_lost_its_counters_is_refused(tmp_path):
    path, _ = written(tmp_path, "out.mat", "rf")
    path.write_bytes(path.read_bytes().replace(b"counter", b"counted"))
    refused(path, "lacks counter")


def test_too_much_for_a_matlab_file_is_said_before_it_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr("x2radar.recording.formats.matlab.MAX_BYTES", 100)
    with pytest.raises(ValueError, match="too many for a MATLAB file"):
        written(tmp_path, "out.mat", "rf")
    assert [path.name for path in tmp_path.iterdir()] == ["in.h5"]


@pytest.mark.parametrize("kind", COLUMNS)
def test_pyarrow_reads_our_parquet_files(tmp_path, kind):
    path, samples = written(tmp_path, "out.parquet", kind)
    table = parquet.read_table(path)
    assert table["counter"].to_pylist() == COUNTERS
    assert table.column_names == ["counter", "t_s", *COLUMNS[kind]]
    assert np.array_equal(whole([np.stack(table[n].to_numpy()) for n in COLUMNS[kind]]), samples)
    about = json.loads(table.schema.metadata[b"x2radar"])
    assert (about["frame_rate_hz"], about["n_range"]) == (RATE_HZ, samples.shape[1])
    assert about["labels"] == [list(label) for label in LABELS]
    assert about["device"]["serial"] == "42"


@pytest.mark.parametrize("kind", COLUMNS)
def test_the_decoder_of_ros2_reads_our_mcap_files(tmp_path, kind):
    path, samples = written(tmp_path, "out.mcap", kind)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        about = {each.name: each.metadata for each in reader.iter_metadata()}["x2radar"]
        frames = list(reader.iter_decoded_messages(topics=["/radar/frames"]))
        labels = [json.loads(each.data) for *_, each in reader.iter_messages("/radar/labels")]
    assert [row.decoded_message.counter for row in frames] == COUNTERS
    parts = [[getattr(row.decoded_message, name) for row in frames] for name in COLUMNS[kind]]
    assert np.array_equal(whole(parts).astype(samples.dtype), samples)
    start_s = datetime.fromisoformat("2026-03-01T12:30:00.250Z").timestamp()
    row = frames[5]
    assert row.message.log_time / 1e9 == pytest.approx(start_s + row.decoded_message.t_s)
    assert float(about["frame_rate_hz"]) == RATE_HZ
    assert [(each["t0_s"], each["t1_s"], each["label"]) for each in labels] == LABELS
