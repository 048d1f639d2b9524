"""JSON Lines into a file: whole lines only, put aside by size, reopened when moved away.

`FILE` is the newest; `FILE.1` the one before it, and so on. Every file begins with the
run's `hello`, that of every sensor, so each can be read by itself. When another program
(logrotate) has moved or removed the file, a new one is made.
"""

import contextlib
import errno
import os
import stat
from pathlib import Path

from radard.config.sink_table import SinkOptions, named_file
from radard.errors import OutputError
from radard.log_file import is_passing
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.stdout import json_line
from radard.outputs.thread_sink import DirectSink
from x2radar.backoff import Backoff

_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NONBLOCK
_BEGINS = frozenset(b"{ \r\n\0")  # a power cut may leave zeros where lines were


class JsonLinesSink(DirectSink):
    """Append records to the FILE of `json:FILE`; pipes and terminals work too, without rotation.

    It rotates nothing if the stream can wait, so that no record is lost.
    """

    def __init__(self, url: str, options: SinkOptions, context: SinkContext) -> None:
        path = named_file(url)
        super().__init__(f"json:{path}", Backoff(0.5, 10.0, str(path)), context, str(path))
        self._path = path
        self._most_bytes = float("inf") if context.can_wait else options.jsonl.rotate_mb * 1e6
        self._n_keep = options.jsonl.keep_files
        self._hellos: dict[str, Record] = {}
        self._fd = -1  # while it is not open
        self._is_regular = True
        self._lacks_hello = False
        self._mode = 0o600
        if _is_other(path):
            raise OutputError(f"--output {self.name}: what stands in that file is no JSON Lines")
        try:
            self._open()
        except OSError as err:
            # A pipe that nobody reads yet may get its reader later, a full disk room.
            may_pass = err.errno == errno.ENXIO or (is_passing(err) and not self.waits)
            if not may_pass:
                msg = f"--output {self.name}: cannot write there: {err.strerror}"
                raise OutputError(msg) from err

    def _deliver(self, record: Record) -> None:
        line = json_line(record).encode("ascii")
        is_hello = record["type"] == "hello"
        if is_hello:
            self._hellos[record.get("sensor", "")] = record
        try:
            size = self._size_unless_moved()
            if size is None:
                self._reopen()
            elif self._is_regular and size and size + len(line) > self._most_bytes:
                self._rotate()
            if self._lacks_hello:
                hellos = "".join(map(json_line, self._hellos.values())).encode("ascii")
                line = hellos if is_hello else hellos + line
            self._append(line)
            self._lacks_hello = False
        except OSError as err:
            raise DeliveryError(err.strerror or str(err)) from err

    def _shut(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _open(self) -> None:
        """Open the file; a new one has the mode of the one before, else its owner alone reads."""
        try:
            self._fd = os.open(self._path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            self._fd = os.open(self._path, _FLAGS | os.O_CREAT, 0o600)
        else:
            os.fchmod(self._fd, self._mode)
        mode = os.fstat(self._fd).st_mode
        self._is_regular = stat.S_ISREG(mode)
        self._mode = stat.S_IMODE(mode) if self._is_regular else self._mode

    def _size_unless_moved(self) -> int | None:
        """Return the bytes in the file; None if it is no longer what has its name."""
        if self._fd >= 0:
            with contextlib.suppress(FileNotFoundError):
                ours = os.fstat(self._fd)
                return ours.st_size if os.path.samestat(self._path.stat(), ours) else None
        return None

    def _reopen(self) -> None:
        """Open the file; a new one holds every `hello` first."""
        self._shut()
        self._open()
        self._lacks_hello = self._is_regular and os.fstat(self._fd).st_size == 0

    def _rotate(self) -> None:
        """Rename FILE to FILE.1, FILE.1 to FILE.2 and so on, delete the last; then reopen."""
        names = [self._path, *(Path(f"{self._path}.{k}") for k in range(1, self._n_keep + 1))]
        names[-1].unlink(missing_ok=True)
        for old, new in zip(reversed(names[:-1]), reversed(names[1:]), strict=True):
            with contextlib.suppress(FileNotFoundError):
                old.rename(new)
        self._reopen()

    def _append(self, line: bytes) -> None:
        """Write a whole line or nothing of it; the next attempt must not begin in its middle."""
        rest = line
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError:
            if len(rest) < len(line):
                if self._is_regular:
                    size = os.fstat(self._fd).st_size
                    os.ftruncate(self._fd, size - (len(line) - len(rest)))
                else:
                    # Nothing can be taken back from a pipe; its reader sees the end of it.
                    self._shut()
            raise


open_from_url = JsonLinesSink


def _is_other(path: Path) -> bool:
    """Return whether a file is of another kind, as a recording or a configuration."""
    # A pipe would wait for its writer.
    if path.is_file():
        with contextlib.suppress(OSError), path.open("rb") as file:
            return not _BEGINS.issuperset(file.read(1))
    return False
