"""What the system's files hold: udev rules, units, user and the first configuration."""

import json
import re
from importlib import resources
from pathlib import Path

from radard.errors import UsageError

UDEV_FILE = Path("etc/udev/rules.d/60-x2radar.rules")
UNIT_FILE = Path("etc/systemd/system/radard.service")
INSTANCE_FILE = Path("etc/systemd/system/radard@.service")
FAILED_FILE = Path("etc/systemd/system/radard-failed@.service")
USER_FILE = Path("etc/sysusers.d/radard.conf")
CONFIG_FOLDER = Path("etc/radard")
STATE_FOLDER = Path("var/lib/radard")
PORT = "/dev/x2radar"  # the name that the udev rules give a module
_USB_ID = re.compile(r"[0-9a-f]{4}:[0-9a-f]{4}")
_SERIAL = re.compile(r"[A-Za-z0-9._-]{1,64}")
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")


def udev_rules(usb_id: str | None = None, serial: str | None = None) -> str:
    """Return the udev rules; with an adapter's USB id and serial number, for it as well."""
    text = shipped("60-x2radar.rules")
    if usb_id is None and serial is None:
        return text
    if usb_id is None or serial is None:
        raise UsageError("--usb and --serial belong together: an adapter may carry another thing")
    if not _USB_ID.fullmatch(usb_id.lower()):
        raise UsageError(f"--usb '{usb_id}': must be two hexadecimal numbers, as in 0403:6001")
    if not _SERIAL.fullmatch(serial):
        raise UsageError(f"--serial '{serial}': must be letters, digits and . _ - only")
    vendor, product = usb_id.lower().split(":")
    rule = (
        f'ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
        f'ATTRS{{serial}}=="{serial}", ENV{{X2RADAR}}="1"\n'
    )
    mark = "# Common adapters"
    return text.replace(mark, f"# The adapter that was named.\n{rule}\n{mark}", 1)


def systemd_unit(program: Path, port: str = PORT) -> str:
    """Return the systemd unit for a program and a port."""
    return _with_start(program, "--port", port, "--wait", "--config", "/etc/radard/config.yaml")


def systemd_instance_unit(program: Path) -> str:
    """Return the unit radard@.service: one process for each /etc/radard/NAME.yaml."""
    text = _with_start(program, "--wait", "--config", "/etc/radard/%i.yaml")
    text = text.replace("Description=radard radar alarm", "Description=radard radar alarm: %i", 1)
    return re.sub(r"(?m)^(State|Runtime)Directory=radard$", r"\1Directory=radard-%i", text)


def first_config(name: str | None = None, port: str = PORT) -> str:
    """Return a configuration to begin with; for `name`, that of radard@name.service."""
    unit, keys, out = "the service radard.service", "", "http://127.0.0.1:8434"
    if name is not None:
        if not _NAME.fullmatch(name):
            raise UsageError(f"--name '{name}': must be letters, digits, - and _ only")
        unit, out = f"radard@{name}.service", f"store:/var/lib/radard-{name}/radard.db"
        keys = f'sensor: {{name: "{name}", port: {json.dumps(port, ensure_ascii=False)}}}\n'
        folders = f'state_dir: "/var/lib/radard-{name}", runtime_dir: "/run/radard-{name}"'
        keys += f"service: {{{folders}}}\n"
    built_in = re.sub(r"(?m)^(?=[^#\n])", "#", shipped("config.yaml"))
    head = _HEAD.format(what=unit, keys=keys)
    return f'{head}output: ["{out}"]\n\n# What can be set, as it is built in:\n\n{built_in}'


_HEAD = """\
# Configuration of {what}. After a change:
#   radard config check --config FILE
# `systemctl reload` takes up all but ports and the number of sensors.
{keys}"""


def shipped(name: str) -> str:
    """Return a file of the system as it comes with the package."""
    return (resources.files("radard.units") / name).read_text(encoding="utf-8")


def _with_start(program: Path, *words: str) -> str:
    """Return the shipped unit with another command to start; %i stands for itself."""
    if not program.is_absolute():
        raise UsageError(f"--exec '{program}': must be a whole path, as systemd wants it")
    line = "ExecStart=" + " ".join(map(_unit_word, (str(program), *words)))
    line = line.replace("%%i.yaml", "%i.yaml")
    return re.sub(r"(?m)^ExecStart=.*$", lambda _: line, shipped("radard.service"), count=1)


def _unit_word(word: str) -> str:
    """Return a word as it must stand in ExecStart=."""
    if not word.isprintable():
        raise UsageError(f"{word!r}: cannot stand in a unit file")
    word = word.replace("%", "%%").replace("$", "$$")
    if re.search(r"[\s\"'\\;]", word):
        return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return word
