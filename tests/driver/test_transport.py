"""One contract for every byte pipe, and the errors of ports that do not open."""

import errno
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from tests.device_helpers import in_thread
from x2radar.device import transport as transport_module
from x2radar.device.transport import PtyTransport, SerialTransport, Transport, memory_pair
from x2radar.errors import NoPort, PortBusy, PortDenied, PortError, PortNotFound, TransportClosed

pytestmark = pytest.mark.integration
Ends = tuple[Transport, Transport]
LONG_S = 60.0


class SocketEnd:
    """The far end of a TCP connection: a socket with a transport's methods."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection

    def read(self, timeout_s: float) -> bytes:
        self._socket.settimeout(timeout_s)
        try:
            return self._socket.recv(1 << 16)
        except TimeoutError:
            return b""

    def write(self, data: bytes) -> None:
        self._socket.settimeout(LONG_S)
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


def pty_ends() -> Ends:
    far = PtyTransport()
    return SerialTransport(far.path), far


def socket_ends() -> Ends:
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = SerialTransport(f"socket://127.0.0.1:{server.getsockname()[1]}")
        return near, SocketEnd(server.accept()[0])


@pytest.fixture(params=[memory_pair, pty_ends, socket_ends])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    near, far = request.param()
    yield near, far
    near.close()
    far.close()


def read_all(end: Transport, n_bytes: int) -> bytes:
    out = bytearray()
    give_up_s = time.monotonic() + LONG_S
    while len(out) < n_bytes and time.monotonic() < give_up_s:
        out += end.read(0.5)
    return bytes(out)


def read_until_closed(end: Transport) -> bytes:
    out = bytearray()
    try:
        while True:
            out += end.read(1.0)
    except TransportClosed:
        return bytes(out)


def write_until_closed(end: Transport) -> None:
    # A socket notices with the answer to the first bytes that it sends.
    for _ in range(500):
        end.write(b"x" * 1000)
        time.sleep(0.002)


ALL_BYTES = bytes(range(256))


def test_data_both_ways_or_nothing_in_time(ends: Ends) -> None:
    near, far = ends
    near.write(b"")
    near.write(ALL_BYTES)
    assert read_all(far, 256) == ALL_BYTES
    far.write(ALL_BYTES[::-1])
    assert read_all(near, 256) == ALL_BYTES[::-1]
    started_s = time.monotonic()
    assert near.read(0.05) == b""
    assert 0.04 < time.monotonic() - started_s < 2
    assert near.read(0) == b""


@pytest.mark.parametrize("near_writes", [True, False])
def test_big_transfer_keeps_its_order(ends: Ends, near_writes: bool) -> None:
    writer, reader = ends if near_writes else ends[::-1]
    data = b"".join(k.to_bytes(4, "big") for k in range(100_000))
    thread = in_thread(lambda: [writer.write(data[k : k + 7000]) for k in range(0, 400_000, 7000)])
    assert read_all(reader, len(data)) == data
    thread.join(LONG_S)
    assert not thread.is_alive()


def test_a_read_wakes_up_for_the_first_byte_and_for_the_end(ends: Ends) -> None:
    near, far = ends
    started_s = time.monotonic()
    threading.Timer(0.05, far.write, [b"z"]).start()
    assert near.read(LONG_S) == b"z"
    threading.Timer(0.05, far.close).start()
    with pytest.raises(TransportClosed):
        near.read(LONG_S)
    assert time.monotonic() - started_s < LONG_S / 2


def test_reads_and_writes_with_a_closed_far_end(ends: Ends) -> None:
    near, far = ends
    far.close()
    assert read_until_closed(near) == b""
    with pytest.raises(TransportClosed):
        near.read(0)
    with pytest.raises(TransportClosed):
        write_until_closed(near)


def test_use_after_close(ends: Ends) -> None:
    near, far = ends
    far.write(b"unread")
    near.close()
    near.close()
    with pytest.raises(TransportClosed):
        near.read(0.01)
    with pytest.raises(TransportClosed):
        near.write(b"x")


@pytest.mark.parametrize("make", [memory_pair, socket_ends])
@pytest.mark.parametrize("last", [b"x", b"last words" * 100])
def test_what_was_sent_before_the_end_is_read(make: Callable, last: bytes) -> None:
    near, far = make()
    far.write(last)
    far.close()
    assert read_until_closed(near) == last
    near.close()


def test_only_a_port_on_usb_is_usb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    far = PtyTransport()
    link = tmp_path / "usb-XeThru-port0"
    link.symlink_to(far.path)
    near = SerialTransport(str(link))
    assert near.url == str(link)
    assert not near.is_usb
    # The kernel's view of a device on USB, built by hand.
    bus = tmp_path / "devices" / "usb1" / "1-1"
    bus.mkdir(parents=True)
    tty = tmp_path / "class" / Path(far.path).name
    tty.mkdir(parents=True)
    (tty / "device").symlink_to(bus)
    monkeypatch.setattr(transport_module, "TTY_CLASS", tmp_path / "class")
    assert near.is_usb
    near.close()
    far.close()


def test_ports_that_are_not_there_or_are_none(tmp_path: Path) -> None:
    with pytest.raises(PortNotFound, match="plugged in"):
        SerialTransport(str(tmp_path / "ttyNONE"))
    file = tmp_path / "file"
    file.write_text("")
    for path in (file, tmp_path, "/dev/null"):
        with pytest.raises(NoPort, match="is no serial port"):
            SerialTransport(str(path))
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(PortError, match="cannot be opened: Connection refused"):
        SerialTransport(f"socket://127.0.0.1:{port}")
    with pytest.raises(PortError, match="cannot be opened") as caught:
        SerialTransport("hwgrep://(")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("error", "kind", "exit_code"),
    [
        (PermissionError(errno.EACCES, os.strerror(errno.EACCES)), PortDenied, 77),
        (serial.SerialException(errno.EPERM, "could not open port"), PortDenied, 77),
        (serial.SerialException("could not open port: Permission denied"), PortDenied, 77),
        (OSError(errno.EBUSY, os.strerror(errno.EBUSY)), PortBusy, 66),
        (serial.SerialException("Could not exclusively lock port x"), PortBusy, 66),
        (FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)), PortNotFound, 66),
        (OSError(errno.ENXIO, os.strerror(errno.ENXIO)), PortNotFound, 66),
        (serial.SerialException("[Errno 2] No such file or directory"), PortNotFound, 66),
        (ValueError("invalid URL"), PortError, 66),
    ],
)
def test_foreign_errors_get_their_class(monkeypatch, error, kind, exit_code) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(PortError, match=r"^/dev/ttyACM0: ") as caught:
        SerialTransport("/dev/ttyACM0")
    assert (type(caught.value), caught.value.exit_code) == (kind, exit_code)
