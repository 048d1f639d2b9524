"""Find the module: list serial ports, and ask each one whether a module answers.

USB ids are those of the X4 modules and of common adapters; those of the X2 modules are
known to nobody, so an unknown id excludes nothing. A port gets one ping and nothing else,
and a port that another program holds is left alone.
"""

import contextlib
import os
import time
from dataclasses import dataclass
from pathlib import Path

from x2radar import errors
from x2radar.device.transport import SerialTransport
from x2radar.wire import framing, wire_ids
from x2radar.wire.codec import encode, read_messages
from x2radar.wire.messages import Message, Ping, Pong, Unknown

_ANSWER_S = 0.3  # how long a port is listened to: a module answers a ping within milliseconds

_BY_ID = Path("/dev/serial/by-id")
_LOCK_FOLDERS = (Path("/run/lock"), Path("/var/lock"))
_MAX_AT_ONCE = 16  # ports asked at the same time: more than most machines have

USB_IDS = {
    "03eb:6124": ("XeThru X4 module (Atmel CDC)", "documented"),
    "03eb:2404": ("XeThru bootloader; perhaps an X2 module", "inferred"),
    "0403:6001": ("FTDI serial adapter, as used with XeThru modules", "documented"),
    "0403:6014": ("FTDI FT232H adapter, as used with X2 kits", "documented"),
}
"""What is known of a USB id, and how: see docs/research/hardware.md. The bootloader's is
documented; that an X2 module may have it too is inferred from its being the maker's default."""


@dataclass(frozen=True, slots=True)
class PortRow:
    """A serial port of this machine; texts are empty where nothing is known."""

    path: str
    usb_id: str = ""  # vendor and product, as in ``03eb:6124``
    manufacturer: str = ""
    product: str = ""
    serial_number: str = ""
    by_id: str = ""  # the stable link under /dev/serial/by-id
    known: str = ""
    known_from: str = ""  # what is known of this USB id, and how: 'documented' or 'inferred'


def list_ports() -> list[PortRow]:
    """Return every serial port of this machine, by path; opens none of them."""
    # Late: looking through the system's devices is slow, and most runs name their port.
    from serial.tools import list_ports as tool  # noqa: PLC0415

    links = {link.resolve(): str(link) for link in _BY_ID.glob("*")}
    rows = []
    for port in sorted(tool.comports()):
        is_usb = port.vid is not None and port.pid is not None
        usb_id = f"{port.vid:04x}:{port.pid:04x}" if is_usb else ""
        said = (port.manufacturer or "", port.product or "", port.serial_number or "")
        known = USB_IDS.get(usb_id, ("", ""))
        by_id = links.get(Path(port.device).resolve(), "")
        rows.append(PortRow(port.device, usb_id, *said, by_id, *known))
    return rows


def find_module() -> str:
    """Return the only port on which a module answers; PortNotFound if none or several do."""
    # Opening an rfcomm device sets up a radio connection.
    candidates = [row.path for row in list_ports() if "/rfcomm" not in row.path]
    paths = list({os.path.realpath(path): path for path in candidates}.values())
    if not paths:
        raise errors.PortNotFound(
            "no module answers: there is no serial port; is the module plugged in?"
        )
    # Late, as above.
    from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415

    with ThreadPoolExecutor(min(len(paths), _MAX_AT_ONCE)) as pool:
        states = dict(zip(paths, pool.map(port_state, paths), strict=True))
    found = [path for path, (is_module, _) in states.items() if is_module]
    if len(found) == 1:
        return found[0]
    several = "several modules answer; name one of them as the port"
    why = several if found else "no module answers; asked"
    listed = ", ".join(f"{path} ({state})" for path, (_, state) in states.items())
    raise errors.PortNotFound(f"{why}: {listed}")


def port_state(path: str) -> tuple[bool, str]:
    """Ping a port once; return whether a module answers, and a few words for people."""
    try:
        _refuse_locked(path)
        transport = SerialTransport(path)
    except errors.PortError as err:
        words = {
            errors.PortBusy: "in use",
            errors.PortDenied: "no permission: see the group 'dialout'",
            errors.PortNotFound: "gone",
        }
        return False, words.get(type(err), "cannot be opened")
    decoder = framing.PacketDecoder()
    with contextlib.closing(transport), contextlib.suppress(errors.TransportClosed):
        transport.write(framing.encode(encode(Ping())))
        until_s = time.monotonic() + _ANSWER_S
        while (left_s := until_s - time.monotonic()) > 0:
            heard = map(_meaning, read_messages(decoder, transport.read(left_s)))
            # Its answer may still stand behind data; but that it is a module is clear.
            if said := max(filter(None, heard), key=lambda said: said != "streams", default=""):
                return True, said
    return False, "silent"


def _meaning(message: Message | None) -> str:
    match message:
        case None | Unknown(name="") | Pong(code=wire_ids.PING_SEED):
            # Damaged, of no module, or from a line that echoes what it gets.
            return ""
        case Pong(code):
            return wire_ids.PONG_NAMES.get(code, "streams").replace("_", " ")
        case _:
            return "streams"


def _refuse_locked(path: str) -> None:
    """Raise PortBusy if a living process says in a lock file that it holds the port."""
    name = Path(path).resolve().name
    for folder in _LOCK_FOLDERS:
        try:
            holder = int((folder / f"LCK..{name}").read_text().split()[0])
            os.kill(holder, 0)
        except PermissionError:
            # There is such a process, of another user.
            pass
        except (OSError, ValueError, IndexError, OverflowError):
            continue
        raise errors.PortBusy(f"{path}: in use by another program")
