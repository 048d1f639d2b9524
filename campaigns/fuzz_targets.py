"""What the bad-input campaign feeds: each target with good files to begin from.

A target takes a folder and the bytes of an input, and does with them what the programs would do.
An input of several files is joined by `BORDER`.
"""

import contextlib
import hashlib
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from campaigns import fuzz_network
from campaigns.fuzz_mutate import BORDER
from radard.alarm.state_store import StateStore
from radard.config.config import load_config
from radard.detect.calibration import load_calibration
from radard.errors import RadardError
from radard.judge.bundle import load_bundle
from radard.log import EventLog
from x2radar.device.device import X2Radar
from x2radar.errors import X2RadarError
from x2radar.frame import FastTimeAxis, StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.blocks import Block
from x2radar.recording.capture import (
    FROM_MODULE,
    MAGIC,
    OPENED,
    TO_MODULE,
    Capture,
    CaptureWriter,
    capturing,
)
from x2radar.recording.convert import convert
from x2radar.recording.hdf5_file import lookup3
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels
from x2radar.recording.registry import open_recording
from x2radar.recording.trace import describe, read_trace
from x2radar.sim.module.host import connect
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene, scene_names
from x2radar.sim.scene.stage import Stage
from x2radar.wire.protocol import Session

OWN_ERRORS = (X2RadarError, RadardError)
_ROOT = Path(__file__).parents[1]
_SHA_OF_PART = b"sha256-of-the-other-part"
_BASEBAND = FastTimeAxis(
    kind="baseband",
    n_range=24,
    bin_length_m=0.0293,
    range_offset_m=0.6,
    carrier_hz=6.8e9,
    bandwidth_hz=2.3e9,
    sample_rate_hz=41e9,
)
_RF = replace(_BASEBAND, kind="rf", bin_length_m=0.00366)
_SWEEP = {"dac_min": 0, "dac_step": 4, "iterations": 16, "pulses_per_step": 16, "dac_max": 8191}
_META = "xethru_recording_meta.dat"
_DATA = "xethru_baseband_iq_20260301_123000.dat"


@dataclass(frozen=True, slots=True)
class Target:
    """One reader."""

    name: str
    run: Callable[[Path, bytes], None]
    seeds: Callable[[Path], list[bytes]]
    """Makes good inputs, in an empty folder."""


# ---------------------------------------------------------------- recordings


def _read(path: Path) -> None:
    """Read a recording as `info`, `convert` and a replay do, to its end."""
    with open_recording(path) as reader:
        _ = (reader.labels, reader.device, reader.settings, reader.started_utc, reader.run_id)
        _ = (reader.compression, reader.has_decisions)
        for frame in islice(reader.frames(0.01), 3):
            _ = frame.samples.sum()
        for block in reader.blocks():
            _ = block.samples[:1].sum()


def _file(name: str) -> Callable[[Path, bytes], None]:
    def run(folder: Path, data: bytes) -> None:
        (folder / name).write_bytes(data)
        _read(folder / name)

    return run


def _pair(first: str, second: str, look_at: str) -> Callable[[Path, bytes], None]:
    def run(folder: Path, data: bytes) -> None:
        one, _, two = data.partition(BORDER)
        (folder / first).write_bytes(one)
        (folder / second).write_bytes(two)
        _read(folder / look_at)

    return run


def _recording(path: Path, axis: FastTimeAxis = _BASEBAND, n: int = 40) -> Path:
    rng = np.random.default_rng(0)
    samples: Any = (rng.integers(0, 1000, (n, axis.n_range)) * (4 / 256 * 100 / 8192)).astype("f4")
    if axis.kind == "baseband":
        samples = (samples * np.exp(1j * samples)).astype(np.complex64)
    about = {"started_utc": "2026-03-01T12:30:00.250Z", "device": {"name": "module 7"}}
    with RecordingWriter(path, StreamInfo(axis, 60.0, "x"), settings=_SWEEP, **about) as writer:
        counter = np.array([*range(1, n - 4), *range(n, n + 5)], np.uint32)
        writer.write_block(Block(samples, counter, (counter - 1) / 60.0))
    write_labels(path, [(0.0, 0.2, "human"), (0.2, 0.5, "dog")])
    return path


def _hdf5_seeds(folder: Path) -> list[bytes]:
    ours = _recording(folder / "ours.h5")
    out = [ours.read_bytes()]
    flagged = bytearray(out[0])
    flagged[11] |= 0b101
    struct.pack_into("<I", flagged, 44, lookup3(bytes(flagged[:44])))
    out.append(bytes(flagged))
    for libver in ("earliest", "latest"):
        old = folder / f"{libver}.h5"
        with h5py.File(ours) as source, h5py.File(old, "w", libver=libver) as file:
            file.attrs.update(source.attrs)
            for name in ("samples", "counter", "t_s"):
                packing = {"chunks": True, "compression": "gzip"} if name == "samples" else {}
                file.create_dataset(f"frames/{name}", data=source[f"frames/{name}"][()], **packing)
            for name in ("t0_s", "t1_s", "label"):
                file[f"labels/{name}"] = source[f"labels/{name}"][()]
        out.append(old.read_bytes())
    for k, hostile in enumerate(_HOSTILE):
        path = folder / f"hostile_{k}.h5"
        path.write_bytes(out[2])
        with h5py.File(path, "r+") as file:
            hostile(file)
        out.append(path.read_bytes())
    return out


def _put(name: str, **options: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        if name in file:
            del file[name]
        if "link" in options:
            file[name] = options["link"]
        else:
            file.create_dataset(name, **options)

    return change


def _virtual(file: h5py.File) -> None:
    del file["frames/samples"]
    layout = h5py.VirtualLayout(shape=(40, 24), dtype=np.complex64)
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", shape=(40, 24))
    file.create_virtual_dataset("frames/samples", layout)


def _attribute(name: str, value: Any, **options: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file.attrs.create(name, value, **options)

    return change


def _reference(file: h5py.File) -> None:
    file.attrs["device"] = file["frames"].ref
    del file["labels/label"]
    file.create_dataset("labels/label", (2,), h5py.ref_dtype)


_SAMPLES, _COUNTER = "frames/samples", "frames/counter"
_HUGE = (1 << 33, 24)
_HOSTILE: tuple[Callable[[h5py.File], None], ...] = (
    _put(_SAMPLES, link=h5py.ExternalLink("/etc/passwd", "/")),
    _put(_SAMPLES, link=h5py.SoftLink("/frames/counter")),
    _put("frames/t_s", link=h5py.SoftLink("/frames/t_s")),
    _virtual,
    _put(_SAMPLES, shape=(40, 24), dtype="c8", external=[("/etc/passwd", 0, 40 * 24 * 8)]),
    _put(_SAMPLES, shape=_HUGE, dtype="c8", chunks=(60, 24), compression="gzip"),
    _put(
        _SAMPLES, shape=(1 << 22, 16384), dtype="c8", chunks=(1 << 12, 16384), compression="gzip"
    ),
    _put(_SAMPLES, shape=(40, 1 << 30), dtype="c8", chunks=(1, 1 << 16)),
    _put(_COUNTER, shape=(1 << 40,), dtype="u4", chunks=(1 << 28,), compression="gzip"),
    _put(_COUNTER, data=np.array([b"a"] * 40)),
    _put("frames/t_s", data=np.full(40, np.nan)),
    _put("frames/t_s", data=np.array([[1.0]] * 40)),
    _put("labels/label", data=np.arange(3)),
    _put("labels/label", shape=(1 << 30,), dtype=h5py.string_dtype(), chunks=(1 << 20,)),
    _put("labels", data=np.arange(3)),
    _attribute("device", ["a"] * 100),
    _attribute("frame_rate_hz", np.zeros(1000)),
    _attribute("format_version", 1e300),
    _attribute("kind", h5py.Empty("f4")),
    _attribute("settings", "[" * 60_000),
    _attribute("run_id", np.zeros(3, [("a", "i4"), ("b", "f8")])),
    _reference,
)


def _converted(kind: str, name: str, *axes: FastTimeAxis) -> Callable[[Path], list[bytes]]:
    """Make seeds of a format by converting a recording of each axis."""

    def make(folder: Path) -> list[bytes]:
        out = []
        for k, axis in enumerate(axes):
            made = folder / str(k) / name
            made.parent.mkdir()
            convert(_recording(folder / f"{k}.h5", axis), made, out_kind=kind)
            files = sorted(made.iterdir()) if made.is_dir() else sorted(made.parent.iterdir())
            out.append(BORDER.join(file.read_bytes() for file in files))
        return out

    return make


def _npz_seeds(folder: Path) -> list[bytes]:
    out = _converted("npz", "a.npz", _BASEBAND, _RF)(folder)
    for names in ({"samples": np.ones((30, 8), "f4")}, {"samples": np.array([{}], object)}):
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **names)
        out.append(buffer.getvalue())
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("samples.npy", np.lib.format.magic(1, 0) + _npy_head((1 << 40, 24)))
        archive.writestr("counter.npy", bytes(1 << 24))
        archive.writestr("t_s.npy", np.lib.format.magic(2, 0) + b"\xff" * 4 + bytes(1 << 20))
    return [*out, bomb.getvalue()]


def _npy_head(shape: tuple[int, int]) -> bytes:
    head = repr({"descr": "<c8", "fortran_order": False, "shape": shape}).encode().ljust(116)
    return struct.pack("<H", len(head) + 1) + head + b"\n"


def _mat_seeds(folder: Path) -> list[bytes]:
    scn = np.empty((1, 30), [("T", object), ("scn", object), ("Tstrt", object)])
    for k in range(30):
        scn[0, k] = (np.int32(1000 + 33 * k), np.arange(k, k + 24, dtype=np.int32), 17_499)
    out = []
    for packed in (False, True):
        scipy.io.savemat(folder / "a.mat", {"scn": scn, "cfg": np.zeros(3)}, do_compression=packed)
        out.append((folder / "a.mat").read_bytes())
    head = out[0][:128]
    bomb = zlib.compress(bytes(1 << 25))
    struct_of_none = _mat_element(
        14, _mat_element(6, struct.pack("<II", 2, 0)) + _dims((1 << 31) - 1)
    )
    cell = _mat_element(14, _mat_element(6, struct.pack("<II", 1, 0)) + _dims((1 << 31) - 1))
    out.append(head + struct.pack("<II", 15, len(bomb)) + bomb)
    return [*out, head + struct_of_none, head + cell]


def _dims(n: int) -> bytes:
    names = struct.pack("<HHI", 5, 4, 4) + _mat_element(1, b"scn\0")
    return _mat_element(5, struct.pack("<ii", 1, n)) + _mat_element(1, b"scn") + names


def _mat_element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")


# ---------------------------------------------------------------- the wire


def _wire(folder: Path, **options: Any) -> tuple[bytes, bytes, bytes]:
    """Return the bytes of a short session: to the module, from it, and the capture's head."""
    path = folder / f"{options}.x2cap"
    settings = RadarSettings(**options)
    writer = CaptureWriter(path, {"settings": {"output": settings.output}, "port": "sim:dog"})
    module = capturing(
        lambda: connect(lambda: SimulatedModule(load_scene("dog"), 1), None), writer
    )
    with X2Radar(module, settings) as radar:
        for _ in islice(radar.frames(), 3):
            pass
    writer.close()
    kinds: dict[int, bytes] = {TO_MODULE: b"", FROM_MODULE: b""}
    for chunk in Capture(path).chunks():
        if chunk.kind in kinds:
            kinds[chunk.kind] += chunk.data
    head = path.read_bytes()
    n = struct.unpack_from("<I", head, len(MAGIC) + 4)[0]
    return kinds[TO_MODULE], kinds[FROM_MODULE][:30_000], head[: len(MAGIC) + 8 + n]


def _decoder_seeds(folder: Path) -> list[bytes]:
    trace = (_ROOT / "tests" / "data" / "trace.txt").read_bytes()
    sessions = [_wire(folder, output=output)[:2] for output in ("rf", "iq", "ap")]
    return [trace[:20_000], *(data[:8000] for session in sessions for data in session)]


def _capture_seeds(folder: Path) -> list[bytes]:
    out = []
    for output in ("rf", "iq"):
        to, back, head = _wire(folder, output=output)
        records = ((OPENED, b"\0"), (TO_MODULE, to), (FROM_MODULE, back), (FROM_MODULE, back))
        out.append(head + b"".join(_record(kind, data) for kind, data in records))
    return out


def _record(kind: int, data: bytes) -> bytes:
    body = struct.pack("<BQI", kind, 1_000_000, len(data)) + data
    return body + struct.pack("<I", zlib.crc32(body))


def _capture(folder: Path, data: bytes) -> None:
    """Read a capture whose records have good checksums, as a hostile hand would give them."""
    at = 16 + int.from_bytes(data[12:16], "little")
    out = bytearray(data)
    while at + 13 < len(out):
        end = at + 13 + int.from_bytes(out[at + 9 : at + 13], "little")
        if end + 4 > len(out):
            break
        struct.pack_into("<I", out, end, zlib.crc32(out[at:end]))
        at = end + 4
    (folder / "a.x2cap").write_bytes(out)
    _read(folder / "a.x2cap")


def _decode(_folder: Path, data: bytes) -> None:
    for _ in describe(read_trace(data)):
        pass
    session = Session()
    for at in range(0, len(data), 500):
        session.receive(data[at : at + 500])
        while session.next_event() is not None:
            pass


# ---------------------------------------------------------------- text


def _scene(folder: Path, data: bytes) -> None:
    (folder / "a.yaml").write_bytes(data)
    stage = Stage(load_scene(str(folder / "a.yaml")), 0, 60.0)
    stage.next_block(8)


def _scene_seeds(_folder: Path) -> list[bytes]:
    files = _ROOT / "x2radar" / "sim" / "scenes"
    return [
        b"steps:\n- body: human\n  duration_s:\n" + _laughs(b"  "),
        b"description: &a {a: 1}\nsteps:\n- <<: [" + b"*a, " * 3000 + b"*a]\n",
        *((files / f"{name}.yaml").read_bytes() for name in scene_names()),
    ]


def _laughs(indent: bytes) -> bytes:
    """Return a YAML list of some hundred bytes that stands for 4^24 values."""
    lines = [b"- &a [x, x]"]
    lines += [b"- &%c [*%c, *%c, *%c, *%c]" % (k + 1, k, k, k, k) for k in range(97, 121)]
    return b"".join(indent + line + b"\n" for line in lines)


def _config(folder: Path, data: bytes) -> None:
    (folder / "a.yaml").write_bytes(data)
    load_config(folder / "a.yaml", environ={"STATE_DIRECTORY": str(folder)})


def _config_seeds(_folder: Path) -> list[bytes]:
    text = (_ROOT / "config.yaml").read_bytes()
    made = (
        b"sensor: {name: hall, port: 'sim:dog'}\nzones: {include: [[0.5, 2.0]]}\n"
        b"output: [json, 'mqtt://h/p']\nalarm: {entry_delay_s: 30}\ndecision: {pet_limit: 0.8}\n"
    )
    several = b"sensors:\n  a: {port: 'sim:dog', gate: {adapt_db: 6}}\n  b: {port: 'sim:fan'}\n"
    return [text, made, several, b"output:\n" + _laughs(b"  ")]


def _bundle(folder: Path, data: bytes) -> None:
    sidecar, _, network = data.partition(BORDER)
    digest = hashlib.sha256(network).hexdigest().encode()
    (folder / "a.json").write_bytes(sidecar.replace(_SHA_OF_PART, digest))
    (folder / "a.onnx").write_bytes(network)
    load_bundle(str(folder / "a.onnx"))


def _bundle_seeds(_folder: Path) -> list[bytes]:
    out = []
    for name in ("fast", "thesis"):
        raw = json.loads((_ROOT / "models" / f"{name}.json").read_bytes())
        raw["onnx_sha256"] = _SHA_OF_PART.decode()
        for key in ("training", "metrics"):
            raw.pop(key, None)
        network = (_ROOT / "models" / "fast.onnx").read_bytes()
        out.append(json.dumps(raw).encode() + BORDER + network)
    return out


def _calibration(folder: Path, data: bytes) -> None:
    path = folder / "a.json"
    path.write_bytes(data)
    made = load_calibration(path)
    list(made.stale(device="x", software="1", now=datetime(2026, 3, 1, tzinfo=UTC)))
    _ = made.text()
    made.check(_BASEBAND, 60.0)


def _calibration_seeds(_folder: Path) -> list[bytes]:
    raw: dict[str, Any] = {
        "format": "radard-calibration",
        "format_version": 2,
        "frame_rate_hz": 60.0,
        "bin_length_m": 0.0293,
        "range_offset_m": 0.6,
        "noise_floor_db": [-60.0, None] * 12,
        "threshold_db": [6.5] * 24,
    }
    provenance = {"made_utc": "2026-02-01T12:00:00Z", "device": "x", "n_dwells": 600}
    return [json.dumps(raw).encode(), json.dumps(raw | {"provenance": provenance}).encode()]


def _state(_folder: Path, data: bytes) -> None:
    log = EventLog(None)
    log.keep("panel radar", data.decode(errors="surrogateescape"))
    store = StateStore(log, "radar")
    store.save(store.load(is_armed=True).model_copy(update={"is_armed": False}))


def _state_seeds(_folder: Path) -> list[bytes]:
    kept = {
        "is_armed": True,
        "alarm_id": "01J0000000000000000000000A",
        "alarm_reason": "human at 2.1 m",
        "alarm_peak": 0.97,
    }
    return [json.dumps(kept).encode(), b'{"is_armed": false}\n']


def _framelogger_seeds(folder: Path) -> list[bytes]:
    return _converted("framelogger", "a.framelogger", _RF)(folder)


_ROWS = (
    Target("decoder", _decode, _decoder_seeds),
    Target("hdf5", _file("a.h5"), _hdf5_seeds),
    Target("xethru", _pair(_DATA, _META, ""), _converted("xethru", "a", _BASEBAND)),
    Target("framelogger", _file("a.framelogger"), _framelogger_seeds),
    Target("p4xx", _file("a.mat"), _mat_seeds),
    Target("mat", _file("a.mat"), _converted("mat", "a.mat", _BASEBAND, _RF)),
    Target("npz", _file("a.npz"), _npz_seeds),
    Target(
        "sigmf",
        _pair("a.sigmf-data", "a.sigmf-meta", "a.sigmf-meta"),
        _converted("sigmf", "a.sigmf-meta", _BASEBAND, _RF),
    ),
    Target("capture", _capture, _capture_seeds),
    Target("scene", _scene, _scene_seeds),
    Target("config", _config, _config_seeds),
    Target("bundle", _bundle, _bundle_seeds),
    Target("calibration", _calibration, _calibration_seeds),
    Target("state", _state, _state_seeds),
    *(Target(*row) for row in fuzz_network.ROWS),
)
TARGETS: Mapping[str, Target] = {row.name: row for row in _ROWS}


def cause(err: BaseException) -> Iterator[BaseException]:
    """Yield an error and all that led to it."""
    seen: BaseException | None = err
    while seen is not None:
        yield seen
        seen = seen.__cause__ or seen.__context__


def verdict(run: Callable[[], None]) -> tuple[str, str]:
    """Return what became of an input: 'fine', 'over_memory' or 'unhandled', and a line on it."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            run()
    except Exception as err:  # noqa: BLE001 - this is what is asked
        kinds = [type(each) for each in cause(err)]
        text = f"{type(err).__name__}: {' '.join(str(err).split())}"
        if any(issubclass(kind, MemoryError) for kind in kinds):
            return "over_memory", text
        if not isinstance(err, OWN_ERRORS):
            return "unhandled", text
        if len(str(err)) > 4000 or any(issubclass(kind, RecursionError) for kind in kinds[:1]):
            return "unhandled", f"a message of {len(str(err))} characters"
    return "fine", ""
