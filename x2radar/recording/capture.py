"""Wire captures: the raw bytes of both directions with their times, to keep and to replay.

They are appended record by record (layout: docs/research/recordings.md), so that a kill loses
nothing but the record being written. A record that is cut off or whose checksum is wrong ends the
capture: what stands before it is good, `Capture.warning` says what was left out.

As a recording a capture holds the frames that the driver would have had. The module's bytes go
through the driver's decoder and assembler once to be counted and once to be read, so it needs no
memory of its size. Raw RF frames carry no axis; it follows from the settings in the head.
"""

import contextlib
import json
import struct
import threading
import time
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from x2radar.device.assemble import FrameAssembler
from x2radar.device.transport import Transport
from x2radar.errors import MessageError, SettingsError, WriteError
from x2radar.frame import Frame, Samples
from x2radar.modules.modules import settings_from_mapping
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader
from x2radar.recording.faults import refuse, refuse_taken, unreadable
from x2radar.wire.codec import decode_command, read_messages
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.messages import SetMode, X4Set
from x2radar.wire.wire_ids import Mode, X4Setting

MAGIC = b"X2RADARC"
VERSION = 1
_HEAD = struct.Struct("<8sHHI")
_RECORD = struct.Struct("<BQI")
_CRC = struct.Struct("<I")
_MAX_BYTES = 1 << 26  # a longer head or record is damaged: a read gives 64 KiB at most

FROM_MODULE = 0x3C
TO_MODULE = 0x3E
OPENED = 0x4F
CLOSED = 0x43
_KINDS = frozenset({FROM_MODULE, TO_MODULE, OPENED, CLOSED})


class Chunk(NamedTuple):
    """One record of a capture: its kind, seconds since the capture's start, and the bytes."""

    kind: int
    t_s: float
    data: bytes


class CaptureWriter:
    """Append what a wire carries to a new file, for any thread; or RecordingError."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self._path = path
        head = json.dumps(dict(about), default=str).encode()
        refuse_taken(path)
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as err:
            raise refuse(path, f"cannot make a capture there: {err.strerror}") from err
        self._lock = threading.Lock()
        self._begun_ns = time.monotonic_ns()
        self._is_empty = True
        self._append(_HEAD.pack(MAGIC, VERSION, 0, len(head)) + head)

    def add(self, kind: int, data: bytes = b"") -> None:
        """Append one record, with the time of now."""
        with self._lock:
            if self._file.closed:
                return
            self._is_empty = False
            body = _RECORD.pack(kind, time.monotonic_ns() - self._begun_ns, len(data)) + data
            self._append(body + _CRC.pack(zlib.crc32(body)))

    def close(self) -> None:
        """Close the file, and take it away if it is empty; a second call does nothing."""
        with self._lock:
            if self._is_empty and not self._file.closed:
                self._path.unlink(missing_ok=True)
            self._file.close()

    def _append(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) or 0 :]
        except OSError as err:
            raise WriteError.of(self._path, err) from err


class CapturingTransport:
    """A transport that keeps a copy of everything it carries."""

    def __init__(self, inner: Transport, writer: CaptureWriter) -> None:
        self._inner = inner
        self._writer = writer
        self._open = True
        writer.add(OPENED, bytes([self.is_usb]))

    @property
    def is_usb(self) -> bool:
        """Whether the inner transport says that it sits on USB."""
        return bool(getattr(self._inner, "is_usb", False))

    def read(self, timeout_s: float) -> bytes:
        """Read from the inner transport, and write what came into the capture."""
        data = self._inner.read(timeout_s)
        if data:
            self._writer.add(FROM_MODULE, data)
        return data

    def write(self, data: bytes) -> None:
        """Write `data` into the capture, then to the inner transport."""
        # First: an answer must not stand before its question.
        if data:
            self._writer.add(TO_MODULE, bytes(data))
        self._inner.write(data)

    def close(self) -> None:
        """Close the inner transport; the capture stays open."""
        if self._open:
            self._open = False
            self._inner.close()
            self._writer.add(CLOSED)


class Capture:
    """A capture file, which may still be written to; `warning` is what was left out."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.warning: str | None = None
        with unreadable(path), self.path.open("rb") as file:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size or head[:8] != MAGIC:
                raise refuse(path, "not a wire capture")
            _, version, _, n = _HEAD.unpack(head)
            if version != VERSION:
                raise refuse(path, f"capture version {version}, this reads {VERSION}")
            self._begin = _HEAD.size + n
            self.about = dict(json.loads(file.read(n) if n <= _MAX_BYTES else b""))

    def chunks(self) -> Iterator[Chunk]:
        """Yield the whole records in order."""
        with self.path.open("rb") as file:
            file.seek(self._begin)
            while head := file.read(_RECORD.size):
                begin = file.tell() - len(head)
                kind, t_ns, n = _RECORD.unpack(head.ljust(_RECORD.size, b"\0"))
                is_sound = kind in _KINDS and n <= _MAX_BYTES
                data = file.read(n) if is_sound else b""
                crc = _CRC.pack(zlib.crc32(data, zlib.crc32(head)))
                if not is_sound or file.read(_CRC.size) != crc:
                    left = self.path.stat().st_size - begin
                    why = f"cut off or damaged; the last {left} bytes are left out"
                    self.warning = f"{self.path}: {why}"
                    return
                yield Chunk(kind, t_ns / 1e9, data)


class Reader(BlockReader):
    """Read the frames of a capture."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        self._capture = Capture(path)
        about = self._capture.about
        said = about.get("settings")
        try:
            self._module = settings_from_mapping(dict(said or {}))
        except (SettingsError, TypeError, ValueError) as err:
            # Of another version: as far as this one knows them.
            self._module = RadarSettings()
            self._warnings.append(
                f"{path}: settings that are not known ({err}); an X2's are assumed"
            )
        host = PacketDecoder()
        # Where the host starts a stream, what came before is not its own.
        starts = (k for k, chunk in enumerate(self._capture.chunks()) if _starts(host, chunk))
        self._first_chunk = next(starts, 0)
        found = [(frame.counter, frame.axis) for frame in self._decoded()]
        if not found:
            raise refuse(path, "no frames in it")
        axis = found[0][1]
        if {(each.kind, each.n_range) for _, each in found} != {(axis.kind, axis.n_range)}:
            raise refuse(path, "its frames change their shape on the way")
        self._counter = np.array([counter for counter, _ in found], np.uint32)
        self.n_frames = len(found)
        known = {"frame_rate_hz": self._module.frame_rate_hz, **asdict(axis)}
        known |= {"started_utc": about.get("started_utc"), "settings": said}
        self._keep((axis.kind, axis.n_range), known, str(about.get("port") or path.name))
        self._warnings += [self._capture.warning] if self._capture.warning else []
        if self._n_damaged:
            self._warn(f"{self._n_damaged} damaged stretches")
        self._at, self._rest = self.n_frames, self._decoded()

    def read_samples(self, first: int, last: int) -> Samples:
        # Block after block is one pass.
        if first < self._at:
            self._rest, self._at = self._decoded(), 0
        wanted = list(islice(self._rest, first - self._at, last - self._at))
        self._at = last
        return self._falling(np.stack([f.samples for f in wanted]))

    def _decoded(self) -> Iterator[Frame]:
        module, assembler = PacketDecoder(), FrameAssembler(self._module)
        self._n_damaged = 0
        for k, chunk in enumerate(self._capture.chunks()):
            if chunk.kind == OPENED:
                module = PacketDecoder()
            messages = read_messages(module, chunk.data) if chunk.kind == FROM_MODULE else ()
            for message in messages:
                if message is None:
                    self._n_damaged += 1
                elif k >= self._first_chunk and (frame := assembler.frame(message, chunk.t_s)):
                    yield frame


def _starts(host: PacketDecoder, chunk: Chunk) -> bool:
    """Return whether the host's bytes in `chunk` end a command that starts a stream."""
    for item in host.feed(chunk.data) if chunk.kind == TO_MODULE else ():
        with contextlib.suppress(MessageError):
            match decode_command(item.data) if isinstance(item, Packet) else None:
                case SetMode(Mode.RUN | Mode.MANUAL):
                    return True
                case X4Set(X4Setting.FPS, (rate_hz,)) if rate_hz > 0:
                    return True
    return False
