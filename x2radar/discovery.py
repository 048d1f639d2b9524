"""Find the module: list serial ports, and ask each one whether a module answers.

USB ids are those of the X4 modules and of common adapters (documented in the maker's own
Python package); those of the X2 modules are known to nobody, so an unknown id excludes
nothing. A port that another program holds is left alone.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from x2radar import framing
from x2radar.codec import decode_response, encode
from x2radar.errors import (
    MessageError,
    PortBusy,
    PortDenied,
    PortError,
    PortNotFound,
    TransportClosed,
)
from x2radar.framing import Packet, PacketDecoder
from x2radar.messages import Ping, Unknown
from x2radar.transport import SerialTransport

ANSWER_S = 0.3

USB_IDS: dict[tuple[int, int], str] = {
    (0x03EB, 0x6124): "XeThru X4 module (documented)",
    (0x03EB, 0x2404): "XeThru bootloader (documented); perhaps an X2 module (inferred)",
    (0x0403, 0x6001): "FTDI serial adapter (documented as used with modules)",
    (0x0403, 0x6014): "FTDI FT232H adapter (documented as used with X2 kits)",
}


@dataclass(frozen=True, slots=True)
class PortRow:
    """A serial port of this machine.

    Attributes
    ----------
    path : str
        Device path.
    usb_id : str
        ``03eb:6124``, or empty.
    product, serial_number : str
        As the port says; empty when unknown.
    by_id : str
        The stable link under /dev/serial/by-id, or empty.
    known : str
        What is known of this USB id.
    """

    path: str
    usb_id: str
    product: str
    serial_number: str
    by_id: str
    known: str


def list_ports() -> list[PortRow]:
    """Return every serial port of this machine, by path."""
    # Late: looking through the system's devices is slow, and most runs name their port.
    from serial.tools import list_ports as tool  # noqa: PLC0415

    rows = []
    for port in sorted(tool.comports(), key=lambda p: p.device):
        usb = (port.vid, port.pid) if port.vid is not None and port.pid is not None else None
        rows.append(
            PortRow(
                path=port.device,
                usb_id=f"{usb[0]:04x}:{usb[1]:04x}" if usb else "",
                product=port.product or "",
                serial_number=port.serial_number or "",
                by_id=_by_id(port.device),
                known=USB_IDS.get(usb, "") if usb else "",
            )
        )
    return rows


def answers(path: str, wait_s: float = ANSWER_S) -> bool:
    """Say whether a module answers a ping on a port, or is streaming there.

    Parameters
    ----------
    path : str
        Device path.
    wait_s : float
        How long to listen, in seconds.

    Returns
    -------
    bool
        True on the first sound packet that this driver knows.

    Raises
    ------
    PortError
        If the port cannot be opened.
    """
    transport = SerialTransport(path)
    decoder = PacketDecoder()
    try:
        transport.write(framing.encode(encode(Ping())))
        until_s = time.monotonic() + wait_s
        while (left_s := until_s - time.monotonic()) > 0:
            for item in decoder.feed(transport.read(left_s)):
                if isinstance(item, Packet) and _is_known(item.data):
                    return True
    except TransportClosed:
        return False
    finally:
        transport.close()
    return False


def find_module(candidates: Iterable[str] | None = None, wait_s: float = ANSWER_S) -> str:
    """Return the only port on which a module answers.

    Parameters
    ----------
    candidates : iterable of str, optional
        Ports to ask; all of this machine by default.
    wait_s : float
        How long to listen on each, in seconds.

    Raises
    ------
    PortNotFound
        If none or several answer; the message lists what was found.
    """
    paths = list(candidates) if candidates is not None else [row.path for row in list_ports()]
    found: list[str] = []
    silent: list[str] = []
    for path in paths:
        try:
            (found if answers(path, wait_s) else silent).append(path)
        except PortBusy:
            silent.append(f"{path} (in use)")
        except PortDenied:
            silent.append(f"{path} (no permission)")
        except PortError:
            silent.append(f"{path} (cannot be opened)")
    if len(found) == 1:
        return found[0]
    if found:
        msg = f"modules answer on {', '.join(found)}; name one of them with --port"
        raise PortNotFound(msg)
    where = f"asked: {', '.join(silent)}" if silent else "there is no serial port"
    msg = f"no module answers; {where}"
    raise PortNotFound(msg)


def _is_known(data: bytes) -> bool:
    try:
        return not isinstance(decode_response(data), Unknown)
    except MessageError:
        return False


def _by_id(path: str) -> str:
    folder = Path("/dev/serial/by-id")
    if not folder.is_dir():
        return ""
    real = Path(path).resolve()
    return next((str(link) for link in folder.iterdir() if link.resolve() == real), "")
