"""What the bad-input campaign feeds: each target with good files to begin from.

A target takes a folder and the bytes of an input, and does with them what the programs would do.
An input of several files is joined by `BORDER`.
"""

import contextlib
import hashlib
import io
import json
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Literal

import h5py
import numpy as np
import scipy.io

from campaigns import fuzz_network
from campaigns.fuzz_network import BORDER
from radard.alarm.sensor_state import StateStore
from radard.config.config import load_config
from radard.detect.calibration import load_calibration
from radard.errors import RadardError
from radard.judge.bundle import load_bundle
from radard.log import EventLog
from tests.clutter_helpers import calibration
from tests.radar_helpers import BASEBAND
from tests.recording_helpers import captured, make, quanta
from x2radar.commands.convert import convert
from x2radar.commands.decode import describe, read_trace
from x2radar.errors import X2RadarError
from x2radar.modules.x2 import RadarSettings
from x2radar.recording import capture
from x2radar.recording.hdf5_reader import lookup3
from x2radar.recording.registry import open_recording
from x2radar.sim.scene.scene import load_scene, scene_names
from x2radar.sim.scene.stage import Stage
from x2radar.wire.codec import read_messages
from x2radar.wire.framing import PacketDecoder

_ROOT = Path(__file__).parents[1]
_SHA_OF_PART = b"sha256-of-the-other-part"
_META = "xethru_recording_meta.dat"
_DATA = "xethru_baseband_iq_20260301_123000.dat"


def _read(path: Path) -> None:
    """Read a recording as `info`, `convert` and a replay do, to its end."""
    with open_recording(path) as reader:
        _ = (reader.labels, reader.device, reader.settings, reader.started_utc, reader.run_id)
        _ = (reader.compression, reader.has_decisions)
        for frame in islice(reader.frames(0.01), 3):
            _ = frame.samples.sum()
        for block in reader.blocks():
            _ = block.samples[:1].sum()


def _files(*names: str, look_at: str | None = None) -> Callable[[Path, bytes], None]:
    """Return what writes the parts of an input under `names` and reads the recording there."""

    def run(folder: Path, data: bytes) -> None:
        parts = data.split(BORDER, len(names) - 1)
        for name, part in zip(names, [*parts, b""], strict=False):
            (folder / name).write_bytes(part)
        _read(folder / (names[0] if look_at is None else look_at))

    return run


def _hdf5_seeds(folder: Path) -> list[bytes]:
    """Return our own file, the same as one that is being written, and two of other libraries."""
    ours, _ = make(folder / "ours.h5")
    flagged = bytearray(ours.read_bytes())
    flagged[11] |= 0b101
    struct.pack_into("<I", flagged, 44, lookup3(bytes(flagged[:44])))
    out = [ours.read_bytes(), bytes(flagged)]
    for libver in ("earliest", "latest"):
        path = folder / f"{libver}.h5"
        with h5py.File(ours) as source, h5py.File(path, "w", libver=libver) as file:
            file.attrs.update(source.attrs)
            for name in ("frames/counter", "frames/t_s", "labels/t0_s", "labels/t1_s"):
                file[name] = source[name][()]
            file["labels/label"] = source["labels/label"][()]
            samples = source["frames/samples"][()]
            file.create_dataset("frames/samples", data=samples, chunks=True, compression="gzip")
        out.append(path.read_bytes())
    return out


def _converted(kind: str, name: str, *kinds: str) -> Callable[[Path], list[bytes]]:
    """Make seeds of a format by converting a recording of each kind of samples."""

    def seeds(folder: Path) -> list[bytes]:
        out = []
        for of in kinds:
            made = folder / of / name
            made.parent.mkdir()
            convert(make(folder / f"{of}.h5", of)[0], made, out_kind=kind)
            files = sorted(made.iterdir()) if made.is_dir() else sorted(made.parent.iterdir())
            out.append(BORDER.join(file.read_bytes() for file in files))
        return out

    return seeds


def _npz_seeds(folder: Path) -> list[bytes]:
    alone = io.BytesIO()
    np.savez_compressed(alone, samples=quanta(30, 8))
    return [*_converted("npz", "a.npz", "baseband", "rf")(folder), alone.getvalue()]


def _p4xx_seeds(folder: Path) -> list[bytes]:
    scn = np.empty((1, 30), [("T", object), ("scn", object), ("Tstrt", object)])
    for k in range(30):
        scn[0, k] = (np.int32(1000 + 33 * k), np.arange(k, k + 24, dtype=np.int32), 17_499)
    out = []
    for packed in (False, True):
        scipy.io.savemat(folder / "a.mat", {"scn": scn, "cfg": np.zeros(3)}, do_compression=packed)
        out.append((folder / "a.mat").read_bytes())
    return out


def _session(folder: Path, output: Literal["rf", "iq", "ap"]) -> Path:
    path = folder / f"{output}.x2cap"
    captured(path, RadarSettings(output=output), n=3)
    return path


def _decoder_seeds(folder: Path) -> list[bytes]:
    out = [(_ROOT / "tests" / "data" / "trace.txt").read_bytes()[:20_000]]
    for output in ("rf", "iq", "ap"):
        chunks = list(capture.Capture(_session(folder, output)).chunks())
        out += [
            b"".join(each.data for each in chunks if each.kind == kind)[:8000]
            for kind in (capture.TO_MODULE, capture.FROM_MODULE)
        ]
    return out


def _capture_seeds(folder: Path) -> list[bytes]:
    return [_session(folder, output).read_bytes()[:400_000] for output in ("rf", "iq")]


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
    list(describe(read_trace(data)))
    decoder = PacketDecoder()
    for at in range(0, len(data), 500):
        list(read_messages(decoder, data[at : at + 500]))


def _scene(folder: Path, data: bytes) -> None:
    (folder / "a.yaml").write_bytes(data)
    stage = Stage(load_scene(str(folder / "a.yaml")), 0, 60.0)
    stage.next_block(8)


def _scene_seeds(_folder: Path) -> list[bytes]:
    files = _ROOT / "x2radar" / "sim" / "scenes"
    shared = b"description: &a {a: 1}\nsteps:\n- <<: [" + b"*a, " * 3000 + b"*a]\n"
    return [*((files / f"{name}.yaml").read_bytes() for name in scene_names()), shared]


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
    return [text, made, several]


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
        raw |= {"onnx_sha256": _SHA_OF_PART.decode(), "training": {}, "metrics": {}}
        network = (_ROOT / "models" / "fast.onnx").read_bytes()
        out.append(json.dumps(raw).encode() + BORDER + network)
    return out


def _calibration(folder: Path, data: bytes) -> None:
    path = folder / "a.json"
    path.write_bytes(data)
    made = load_calibration(path)
    list(made.stale(device="x", software="1", now=datetime(2026, 3, 1, tzinfo=UTC)))
    _ = made.text()
    made.check(BASEBAND, 60.0)


def _calibration_seeds(_folder: Path) -> list[bytes]:
    raw = json.loads(calibration(n_range=BASEBAND.n_range).text())
    raw["noise_floor_db"][1::2] = [None] * (BASEBAND.n_range // 2)
    made = {"made_utc": "2026-02-01T12:00:00Z", "device": "x", "n_dwells": 600}
    return [json.dumps({**raw, **more}).encode() for more in ({}, {"provenance": made})]


def _state(_folder: Path, data: bytes) -> None:
    log = EventLog(None)
    log.keep("panel radar", data.decode(errors="surrogateescape"))
    store = StateStore(log, "radar")
    store.save(store.load(is_armed=True).model_copy(update={"is_armed": False}))


def _state_seeds(_folder: Path) -> list[bytes]:
    alarm = {"alarm_id": f"{1:026d}", "alarm_reason": "human at 2.1 m", "alarm_peak": 0.97}
    return [json.dumps({"is_armed": True, **alarm}).encode(), b'{"is_armed": false}\n']


_BOTH = ("baseband", "rf")
_SIGMF = ("a.sigmf-data", "a.sigmf-meta")
Target = tuple[Callable[[Path, bytes], None], Callable[[Path], list[bytes]]]
TARGETS: Mapping[str, Target] = {
    "decoder": (_decode, _decoder_seeds),
    "hdf5": (_files("a.h5"), _hdf5_seeds),
    "xethru": (_files(_DATA, _META, look_at=""), _converted("xethru", "a", "baseband")),
    "framelogger": (_files("a.framelogger"), _converted("framelogger", "a.framelogger", "rf")),
    "p4xx": (_files("a.mat"), _p4xx_seeds),
    "mat": (_files("a.mat"), _converted("mat", "a.mat", *_BOTH)),
    "npz": (_files("a.npz"), _npz_seeds),
    "sigmf": (_files(*_SIGMF, look_at=_SIGMF[1]), _converted("sigmf", _SIGMF[1], *_BOTH)),
    "capture": (_capture, _capture_seeds),
    "scene": (_scene, _scene_seeds),
    "config": (_config, _config_seeds),
    "bundle": (_bundle, _bundle_seeds),
    "calibration": (_calibration, _calibration_seeds),
    "state": (_state, _state_seeds),
    **fuzz_network.ROWS,
}
"""What runs an input, and what makes good ones in an empty folder."""


def verdict(run: Callable[[], None]) -> tuple[str, str]:
    """Return what became of an input: 'fine', 'over_memory' or 'unhandled', and a line on it."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            run()
    except Exception as err:  # noqa: BLE001 - this is what is asked
        text = f"{type(err).__name__}: {' '.join(str(err).split())}"
        if any(isinstance(each, MemoryError) for each in _causes(err)):
            return "over_memory", text
        if not isinstance(err, X2RadarError | RadardError):
            return "unhandled", text
        if len(str(err)) > 4000 or isinstance(err, RecursionError):
            return "unhandled", f"a message of {len(str(err))} characters"
    return "fine", ""


def _causes(err: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and all that led to it."""
    while err is not None:
        yield err
        err = err.__cause__ or err.__context__
