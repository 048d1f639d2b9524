"""Byte pipes: a serial port or pyserial URL, a pair in memory, a pseudo-terminal.

`read` waits for the first bytes, empty when the time is over; `write` sends everything; both raise
`TransportClosed` once the far end or the port is gone.
"""

import contextlib
import errno
import os
import re
import select
import threading
import tty
from collections import deque
from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path
from typing import Protocol

import serial

from x2radar.errors import NoPort, PortBusy, PortDenied, PortError, PortNotFound, TransportClosed

_READ_SIZE = 1 << 16  # most bytes of one read: more than any system's buffer of a serial port
_WRITE_TIMEOUT_S = 5.0  # until a port counts as gone: ten times what its buffers take
_BAUD = 115_200  # of XeThru modules; ports on USB ignore it
_MAX_UNREAD = 1 << 17  # bytes that wait in memory before who writes more waits
TTY_CLASS = Path("/sys/class/tty")


class Transport(Protocol):
    """A two-way byte pipe."""

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that are there; wait up to `timeout_s` for the first one."""

    def write(self, data: bytes) -> None:
        """Send all of `data`."""

    def close(self) -> None:
        """Close this end; a second call does nothing."""


class SerialTransport:
    """A serial port or pyserial `url`, locked exclusively while it is open; or PortError."""

    def __init__(self, url: str) -> None:
        try:
            if "://" in url:
                self._serial = serial.serial_for_url(url, baudrate=_BAUD, timeout=0)
            else:
                self._serial = serial.Serial(url, baudrate=_BAUD, timeout=0, exclusive=True)
            self._serial.write_timeout = _WRITE_TIMEOUT_S
        except (serial.SerialException, OSError, ValueError, re.error) as err:
            raise _port_error(url, err) from err
        self.url = url

    @property
    def is_usb(self) -> bool:
        """Whether the port sits on USB and so vanishes while its module restarts."""
        # Names that udev gives, such as those in /dev/serial/by-id, are links.
        device = TTY_CLASS / Path(self.url).resolve().name / "device"
        return device.exists() and "/usb" in str(device.resolve())

    def read(self, timeout_s: float) -> bytes:
        """Return what the port has received; wait up to `timeout_s` for the first byte."""
        first = b""
        try:
            if not self._serial.in_waiting:
                self._set_timeout(timeout_s)
                first = self._serial.read(1)
                if not first:
                    return b""
            waiting = self._serial.in_waiting
            if waiting and self.url.startswith("socket://"):
                # pyserial says 1 for any number of bytes on a socket.
                self._set_timeout(0)
                waiting = _READ_SIZE
            rest: bytes = self._serial.read(min(waiting, _READ_SIZE))
            return first + rest
        except (serial.SerialException, OSError, TypeError) as err:
            # TypeError: pyserial reads from a descriptor that another thread has closed.
            if first:
                # What was read counts; the next read meets the end again.
                return first
            raise TransportClosed(f"{self.url}: the port is gone ({err})") from err

    def _set_timeout(self, timeout_s: float) -> None:
        # pyserial configures the whole port again for this, over rfc2217 through the network.
        if self._serial.timeout != timeout_s:
            self._serial.timeout = timeout_s

    def write(self, data: bytes) -> None:
        """Send all of `data`; raises TransportClosed when the port is gone."""
        try:
            self._serial.write(data)
        except (serial.SerialException, OSError, TypeError) as err:
            raise TransportClosed(f"{self.url}: the port is gone ({err})") from err

    def close(self) -> None:
        """Close the port, and the socket that pyserial leaves open."""
        # pyserial 3.5 leaves a socket open whose far end went first.
        leaked = getattr(self._serial, "_socket", None)
        self._serial.close()
        if leaked is not None:
            leaked.close()


def _port_error(url: str, err: Exception) -> PortError:
    # pyserial puts what the system said into a text of its own.
    inner = err.__context__ if isinstance(err.__context__, OSError) else err
    number = getattr(inner, "errno", None)
    text = str(err)
    if number in {errno.EACCES, errno.EPERM} or "Permission denied" in text:
        cure = "add yourself to the group 'dialout' (log in again), or use a udev rule"
        return PortDenied(f"{url}: permission denied; {cure}")
    if number == errno.EBUSY or "exclusively lock" in text or "Resource busy" in text:
        return PortBusy(f"{url}: in use by another program; close that program first")
    if number in {errno.ENOENT, errno.ENXIO, errno.ENODEV} or "No such file" in text:
        return PortNotFound(f"{url}: no such port; is the module plugged in?")
    if number in {errno.EISDIR, errno.ENOTTY} or "Inappropriate ioctl" in text:
        return NoPort(f"{url}: is no serial port")
    return PortError(f"{url}: cannot be opened: {getattr(inner, 'strerror', None) or text}")


class MemoryTransport:
    """One end of a pair in memory, bounded, so that a fast writer waits; see `memory_pair`."""

    _far: "MemoryTransport"

    def __init__(self, changed: threading.Condition, *, keeps_pieces: bool) -> None:
        self._changed = changed
        self._keeps_pieces = keeps_pieces
        self._unread: deque[bytes] = deque()
        self._is_closed = False

    def read(self, timeout_s: float) -> bytes:
        """Return what the far end wrote; wait up to `timeout_s` for the first byte."""
        with self._waited(lambda: bool(self._unread), max(timeout_s, 0)):
            n = min(1, len(self._unread)) if self._keeps_pieces else len(self._unread)
            return b"".join(self._unread.popleft() for _ in range(n))

    def write(self, data: bytes) -> None:
        """Send `data`; waits while the far end has much to read."""
        unread = self._far._unread
        with self._waited(lambda: not self._is_over() and sum(map(len, unread)) < _MAX_UNREAD):
            unread.append(bytes(data))

    def close(self) -> None:
        """Close both directions; what was not read here is dropped."""
        with self._changed:
            self._is_closed = True
            self._unread.clear()
            self._changed.notify_all()

    def _is_over(self) -> bool:
        return self._is_closed or self._far._is_closed

    @contextlib.contextmanager
    def _waited(self, is_ready: Callable[[], bool], wait_s: float | None = None) -> Iterator[None]:
        """Wait for what is to be changed; TransportClosed if it will never be ready."""
        with self._changed:
            self._changed.wait_for(lambda: is_ready() or self._is_over(), wait_s)
            if self._is_over() and not is_ready():
                raise TransportClosed("the far end of the memory pair is closed")
            yield
            self._changed.notify_all()


def memory_pair(*, keeps_pieces: bool = False) -> tuple[MemoryTransport, MemoryTransport]:
    """Return two connected ends; with `keeps_pieces` a read returns what one write sent."""
    changed = threading.Condition()
    near, far = (MemoryTransport(changed, keeps_pieces=keeps_pieces) for _ in "nf")
    near._far, far._far = far, near
    return near, far


class PtyTransport:
    """The master side of a pseudo-terminal; the slave side is kept open for who comes back."""

    def __init__(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.path = os.ttyname(slave)
        self._master, self._slave = FileIO(master, "r+"), FileIO(slave)

    def read(self, timeout_s: float) -> bytes:
        """Return what was written to the terminal; wait up to `timeout_s` for it."""
        with self._still_open():
            ready, _, _ = select.select([self._master], [], [], max(timeout_s, 0))
            return self._master.read(_READ_SIZE) or b"" if ready else b""

    def write(self, data: bytes) -> None:
        """Send all of `data`; waits while the terminal's buffer is full."""
        left = memoryview(data)
        while left:
            with self._still_open():
                select.select([], [self._master], [], 1.0)
                left = left[self._master.write(left) or 0 :]

    @contextlib.contextmanager
    def _still_open(self) -> Iterator[None]:
        """Raise TransportClosed if the terminal is closed, before or meanwhile: a ValueError."""
        try:
            yield
        except (OSError, ValueError) as err:
            raise TransportClosed(f"{self.path}: the pseudo-terminal is closed") from err

    def close(self) -> None:
        """Close both ends of the terminal."""
        self._master.close()
        self._slave.close()
