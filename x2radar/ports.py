"""A port string, taken apart: what it names, where, and with which keys.

``/dev/ttyACM0``, ``socket://host:port`` or another URL of pyserial's, ``auto`` (the only port that
answers), ``sim:SCENE?key=value&key=value`` or ``replay:FILE``; values are percent-encoded. `KEYS`
lists the keys: a rate in frames per second, a kind (rf or baseband), a fault (kind:value,
`x2radar.sim.module.faults`), run (the run's id, instead of one that no other run has), a device (a
row of `x2radar.modules.modules.MODULES`, or auto: what the module calls itself decides), of
replays start (seconds), loop and from (a format of recordings).
"""

import math
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from urllib.parse import parse_qsl, quote, unquote, urlsplit

from x2radar.errors import PortUrlError, SettingsError

Kind = Literal["live", "auto", "sim", "replay"]
_NAMED: tuple[Kind, ...] = ("sim", "replay")
KEYS: Mapping[Kind, frozenset[str]] = {
    "live": frozenset({"rate", "kind", "device"}),
    "auto": frozenset({"rate", "kind", "device"}),
    "sim": frozenset({"seed", "rate", "kind", "fault", "device", "run"}),
    "replay": frozenset({"start", "loop", "from"}),
}
"""Which keys a port of each kind takes behind the question mark."""
PORT_FORMS = (
    "auto (the only port that answers), /dev/ttyACM0 or any pyserial URL "
    f"[?{'=, '.join(sorted(KEYS['live']))}=], sim:SCENE [?{'=, '.join(sorted(KEYS['sim']))}=]"
)
"""What a port that is a radar may be and which keys it takes, for help; keys are joined by &."""

_SERVERS = ("socket", "rfc2217")
_URLS = (*_SERVERS, "loop", "spy", "alt", "hwgrep", "cp2110")
"""The URLs that pyserial 3.5 opens; those of servers need host and port."""
_HOST = re.compile(r"[\w.-]+|[\da-f:.]+(%[\w.-]+)?", re.IGNORECASE)
_PORT = re.compile(r"auto|sim:.*|[a-z0-9]+://.*|/dev/.*|COM\d+.*", re.IGNORECASE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Port:
    """A port string, taken apart."""

    kind: Kind  # 'live' is a serial port or a URL; the daemon's plug-ins have such ports, too
    target: str  # scene, file, device path or URL
    options: Mapping[str, str] = field(default_factory=dict)  # the keys behind the question mark

    def check_keys(self) -> None:
        """Raise SettingsError if there is a key that a port of this kind does not take."""
        for key in self.options:
            if key not in KEYS[self.kind]:
                known = ", ".join(sorted(KEYS[self.kind]))
                raise SettingsError(f"port key '{key}': unknown; known are {known}")

    def number(self, key: str, default: float) -> float:
        """Return a numeric option; raise SettingsError if it is no number."""
        text = self.options.get(key)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise SettingsError(f"port key '{key}': '{text}' is not a number")
        return value


def parse_port(text: str) -> Port:
    """Take a port string apart; SettingsError or PortUrlError if it makes no sense."""
    target, _, query = text.partition("?")
    if not target:
        msg = f"port '{text}': no port in front of '?'" if text else "port '': no port given"
        raise SettingsError(msg)
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
    except ValueError as err:
        msg = f"port '{text}': behind '?' come key=value pairs joined by '&'"
        raise SettingsError(msg) from err
    options = dict(pairs)
    if len(options) != len(pairs):
        raise SettingsError(f"port '{text}': a key is given twice")
    for kind in _NAMED:
        if target.startswith(f"{kind}:"):
            rest = unquote(target[len(kind) + 1 :], errors="surrogateescape")
            if not rest:
                raise SettingsError(f"port '{text}': nothing behind '{kind}:'")
            return Port(kind, rest, options)
    if "://" in target:
        _check_url(target)
    return Port("auto" if target == "auto" else "live", target, options)


def _check_url(url: str) -> None:
    """Raise PortUrlError for a URL that pyserial cannot open, whatever is there."""
    scheme, _, rest = url.partition("://")
    if scheme.lower() not in _URLS:
        msg = f"port '{url}': no kind of URL that is known; known are {', '.join(_URLS)}"
        raise PortUrlError(msg)
    if scheme.lower() not in _SERVERS:
        if not rest and scheme.lower() != "loop":
            raise PortUrlError(f"port '{url}': nothing behind '{scheme}://'")
        return
    try:
        parts = urlsplit(url)
        is_good = parts.port and is_host(parts.hostname or "") and not parts.path.strip("/")
    except ValueError:
        is_good = False
    if not is_good:
        form = f"{scheme}://HOST:PORT"
        raise PortUrlError(f"port '{url}': must be {form}, with a host and a port from 1 to 65535")


def named_port(kind: Kind, what: Path | str) -> str:
    """Return the port string of a scene, file or folder, whatever bytes its name has."""
    return f"{kind}:{quote(os.fsencode(what))}"


def is_host(name: str) -> bool:
    """Return whether this can be a host: a name, no label empty or above 63, or an address."""
    try:
        # As the socket does it.
        return bool(_HOST.fullmatch(name)) and bool(name.encode("idna"))
    except UnicodeError:
        return False


def is_port(what: str) -> bool:
    """Return whether a word names a radar's port, rather than a file."""
    # Not that of Path, which raises for a name that is too long.
    return bool(_PORT.fullmatch(what)) or (
        os.path.exists(what) and stat.S_ISCHR(os.stat(what).st_mode)  # noqa: PTH110, PTH116
    )


def parse_speed(text: str) -> float | None:
    """Return stream seconds per real second, None for all speed; or SettingsError."""
    if text in {"realtime", "max"}:
        return 1.0 if text == "realtime" else None
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 0 < factor < 1e6:
        raise SettingsError(f"--speed '{text}': use realtime, max or a factor above 0")
    return factor
