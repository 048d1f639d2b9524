"""Wire captures: the raw bytes of both directions with their times, to keep and to replay.

They are appended record by record (layout: docs/research/recordings.md), so that a kill loses
nothing but the record being written. A record that is cut off or whose checksum is wrong ends the
capture: what stands before it is good, `Capture.warning` says what was left out.
"""

import json
import os
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from x2radar.device.transport import Transport
from x2radar.errors import WriteError
from x2radar.recording.faults import refuse

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
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
        try:
            self._file = os.open(path, flags, 0o644)
        except FileExistsError as err:
            raise refuse(path, "exists already; captures are never overwritten") from err
        except OSError as err:
            raise refuse(path, f"cannot make a capture there: {err.strerror}") from err
        self._lock = threading.Lock()
        self._begun_ns = time.monotonic_ns()
        self.n_bytes = 0
        self._is_empty = True
        self._append(_HEAD.pack(MAGIC, VERSION, 0, len(head)) + head)

    def add(self, kind: int, data: bytes = b"") -> None:
        """Append one record, with the time of now."""
        with self._lock:
            if self._file < 0:
                return
            self._is_empty = False
            body = _RECORD.pack(kind, time.monotonic_ns() - self._begun_ns, len(data)) + data
            self._append(body + _CRC.pack(zlib.crc32(body)))

    def close(self) -> None:
        """Close the file, and take it away if it is empty; a second call does nothing."""
        with self._lock:
            if self._file >= 0:
                os.close(self._file)
                if self._is_empty:
                    self._path.unlink(missing_ok=True)
            self._file = -1

    def _append(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                n = os.write(self._file, left)
                self.n_bytes += n
                left = left[n:]
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


def capturing(
    connect: Callable[[], Transport], writer: CaptureWriter
) -> Callable[[], CapturingTransport]:
    """Return a way to open a port that captures what goes over it."""
    return lambda: CapturingTransport(connect(), writer)


class Capture:
    """A capture file, which may still be written to; `warning` is what was left out."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.warning: str | None = None
        try:
            with self.path.open("rb") as file:
                head = file.read(_HEAD.size)
                if len(head) < _HEAD.size or head[:8] != MAGIC:
                    raise refuse(path, "not a wire capture")
                _, version, _, n = _HEAD.unpack(head)
                if version != VERSION:
                    raise refuse(path, f"capture version {version}, this reads {VERSION}")
                self._begin = _HEAD.size + n
                about = file.read(n) if n <= _MAX_BYTES else b""
        except OSError as err:
            raise refuse(path, f"cannot be read: {err.strerror}") from err
        try:
            self.about = dict(json.loads(about))
        except (ValueError, TypeError) as err:
            raise refuse(path, "the head of the capture is damaged") from err

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
