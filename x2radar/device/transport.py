"""Byte pipes: a serial port or pyserial URL, a pair of sockets, a pseudo-terminal.

`read` waits for the first bytes, empty when the time is over; `write` sends everything; both raise
`TransportClosed` once the far end or the port is gone.
"""

import contextlib
import errno
import os
import re
import select
import socket
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import serial

from x2radar.errors import NoPort, PortBusy, PortDenied, PortError, PortNotFound, TransportClosed

_READ_SIZE = 1 << 16  # most bytes of one read: more than any system's buffer of a serial port

_WRITE_TIMEOUT_S = 5.0  # until a port counts as gone: ten times what its buffers take

_BAUD = 115_200  # of XeThru modules; ports on USB ignore it
TTY_CLASS = Path("/sys/class/tty")


class Transport(Protocol):
    """A two-way byte pipe."""

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that are there; wait up to `timeout_s` for the first one.

        Raises TransportClosed when the pipe has ended and everything was read.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`; raises TransportClosed when nobody can receive it."""
        ...

    def close(self) -> None:
        """Close this end; a second call does nothing."""
        ...


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


class DescriptorTransport:
    """A pipe behind a descriptor; `others` are closed with it, `name` is for messages."""

    is_usb = False

    def __init__(self, descriptor: int, *others: int, name: str) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor, self._others, self._name = descriptor, others, name

    def read(self, timeout_s: float) -> bytes:
        """Return what the far end wrote; wait up to `timeout_s` for the first byte."""
        with self._open() as descriptor:
            ready, _, _ = select.select([descriptor], [], [], max(timeout_s, 0))
            if not ready:
                return b""
            if data := os.read(self._descriptor, _READ_SIZE):
                return data
        raise TransportClosed(f"{self._name}: its far end is closed")

    def write(self, data: bytes) -> None:
        """Send all of `data`; waits while the system's buffer is full."""
        left = memoryview(data)
        while left:
            with self._open() as descriptor, contextlib.suppress(BlockingIOError):
                _, ready, _ = select.select([], [descriptor], [], 1.0)
                left = left[os.write(self._descriptor, left) if ready else 0 :]

    @contextlib.contextmanager
    def _open(self) -> Iterator[int]:
        """Lend the descriptor; closed before or meanwhile means TransportClosed."""
        try:
            # select refuses -1 with a ValueError.
            yield self._descriptor
        except (OSError, ValueError) as err:
            raise TransportClosed(f"{self._name} is closed") from err

    def close(self) -> None:
        """Close this end; what was not read here is dropped."""
        descriptors = self._descriptor, *self._others
        self._descriptor, self._others = -1, ()
        for descriptor in descriptors:
            if descriptor >= 0:
                os.close(descriptor)


def socket_pair(*, keeps_pieces: bool = False) -> tuple[DescriptorTransport, DescriptorTransport]:
    """Return two connected ends; with `keeps_pieces` a read gives what one write has sent."""
    kind = socket.SOCK_SEQPACKET if keeps_pieces else socket.SOCK_STREAM
    near, far = (
        DescriptorTransport(end.detach(), name="the pair of sockets")
        for end in socket.socketpair(socket.AF_UNIX, kind)
    )
    return near, far


class PtyTransport(DescriptorTransport):
    """The master side of a pseudo-terminal; the slave side is kept open for who comes back."""

    def __init__(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        super().__init__(master, slave, name=f"{self.path}: the pseudo-terminal")
