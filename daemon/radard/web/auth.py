"""Access control: who may see and who may arm, and which sites requests may come from.

On loopback without tokens everybody is an operator, but only through a host name of loopback (DNS
rebinding). Else a token is required; a page exchanges it for a session in a cookie.
"""

import hmac
import ipaddress
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection

from radard.config.credentials import read_secret
from radard.config.sink_table import WebSection
from radard.errors import ConfigError

Role = Literal["nobody", "viewer", "operator"]
SESSION_S = 12 * 3600.0  # a day's work
_MAX_SESSIONS = 64  # a household's browsers; beyond that the oldest ends
# Wrong tokens of one address: five million guesses a year, of tokens of 12 characters.
_MAX_GUESSES, _GUESSES_PER_S = 50, 10 / 60
_MAX_ADDRESSES = 1024  # a hundred kB; the one that guessed longest ago is forgotten
_MIN_LENGTH = 12  # characters of a token: those guesses then find none


def is_loopback(host: str) -> bool:
    """Return whether an address is of this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return (getattr(address, "ipv4_mapped", None) or address).is_loopback


def read_tokens(web: WebSection, host: str) -> tuple[str | None, str | None]:
    """Return those of viewers and operators; ConfigError if one is bad, short, or missing."""
    viewer = read_secret("web.token", web.token_file, web.token_env)
    operator = read_secret("web.operator_token", web.operator_token_file, web.operator_token_env)
    for name, token in (("token", viewer), ("operator_token", operator)):
        if token is not None and len(token) < _MIN_LENGTH:
            raise ConfigError(f"web.{name}: a token needs {_MIN_LENGTH} characters or more")
    if viewer is not None and viewer == operator:
        raise ConfigError("web.token and web.operator_token are the same: who looks on could arm")
    if viewer is None and operator is None and not is_loopback(host):
        cure = "name a token with web.token_file or web.token_env"
        told = f"others can reach this address; {cure} (and web.operator_token_file for arming)"
        raise ConfigError(f"--output http://{host}: {told}")
    return viewer, operator


class RateLimit:
    """A token bucket: `most` acts at once, and `per_s` a second after that."""

    def __init__(self, most: float, per_s: float) -> None:
        self._most, self._per_s = most, per_s
        self._left, self._at_s = most, time.monotonic()

    @property
    def is_spent(self) -> bool:
        """Whether an act may not be done now."""
        now_s = time.monotonic()
        self._left = min(self._most, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        return self._left < 1

    def take(self) -> bool:
        """Count an act; return whether it may be done."""
        is_free = not self.is_spent
        self._left -= is_free
        return is_free


@dataclass(eq=False)
class AccessControl:
    """Says what a request may do, without `may_command` no commands; for the web's thread."""

    viewer: str | None = field(default=None, repr=False)  # the token for looking on
    operator: str | None = field(default=None, repr=False)  # and for arming
    may_command: bool = True
    cookie: str = "radard"

    def __post_init__(self) -> None:
        self._wants_token = bool(self.viewer or self.operator)
        self._highest: Role = "operator" if self.may_command else "viewer"
        self._sessions: dict[str, tuple[Role, float]] = {}
        self._guesses: dict[str, RateLimit] = {}

    def is_locked(self, address: str) -> bool:
        """Return whether too many wrong tokens came from an address lately."""
        return address in self._guesses and self._guesses[address].is_spent

    def role(self, connection: HTTPConnection) -> Role:
        """Return the role of a request."""
        if not self._wants_token:
            return self._highest
        session = self._sessions.get(connection.cookies.get(self.cookie, ""))
        if session is not None and session[1] > time.monotonic():
            return session[0]
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer" or not token.strip():
            return "nobody"
        # Headers are read as Latin-1, and a token's file as UTF-8.
        text = token.strip().encode("latin-1").decode(errors="replace")
        return self._role_of(text, address_of(connection))

    def log_in(self, token: str, address: str) -> tuple[Role, str]:
        """Return role and session for a token of an address; ('nobody', '') for a wrong one."""
        if (role := self._role_of(token, address)) == "nobody":
            return role, ""
        session = secrets.token_urlsafe(32)
        self._sessions[session] = (role, time.monotonic() + SESSION_S)
        if len(self._sessions) > _MAX_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        return role, session

    def log_out(self, cookies: Mapping[str, str]) -> None:
        """End the session of these cookies, if there is one."""
        self._sessions.pop(cookies.get(self.cookie, ""), None)

    def is_right_host(self, headers: Mapping[str, str]) -> bool:
        """Return whether the host of a request is allowed: without tokens, only loopback.

        Health checks of HTTP/1.0 name none; browsers always do.
        """
        host = headers.get("host")
        if self._wants_token or host is None:
            return True
        try:
            return is_loopback(urlsplit(f"//{host}").hostname or "")
        except ValueError:
            return False

    def is_same_origin(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request comes from our own page, or from no page at all."""
        if headers.get("sec-fetch-site", "none") not in {"same-origin", "none"}:
            return False
        origin = headers.get("origin")
        if origin is None:
            return True
        scheme, _, name = origin.partition("://")
        # A browser leaves the usual port out, and a proxy may name it.
        usual = {"http": ":80", "https": ":443"}.get(scheme, "")
        return name == headers.get("host", "").removesuffix(usual) != ""

    def _role_of(self, token: str, address: str) -> Role:
        if self.is_locked(address):
            return "nobody"
        # JSON can hold half of a surrogate pair, which is no UTF-8.
        given = token.encode(errors="surrogatepass")
        # Both are compared, whichever it is.
        is_operator, is_viewer = (
            wanted is not None and hmac.compare_digest(given, wanted.encode())
            for wanted in (self.operator, self.viewer)
        )
        if is_operator:
            return self._highest
        if is_viewer:
            return "viewer"
        # Each address has its own count, so no stranger spends another's.
        fresh = RateLimit(_MAX_GUESSES, _GUESSES_PER_S)
        self._guesses[address] = self._guesses.pop(address, fresh)
        self._guesses[address].take()
        if len(self._guesses) > _MAX_ADDRESSES:
            del self._guesses[next(iter(self._guesses))]
        return "nobody"


def address_of(connection: HTTPConnection) -> str:
    """Return the address that a request came from."""
    return connection.client.host if connection.client is not None else ""
