"""Access control: who may see and who may arm, and which sites requests may come from.

On a loopback address without tokens everybody on this machine is an operator, but only
through a host name of loopback: a site whose name was pointed at 127.0.0.1 (DNS rebinding) is
refused. With tokens, or on any other address, a token is required; a page exchanges it for a
session in a cookie that scripts cannot read and other sites cannot send.
"""

import hmac
import ipaddress
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

from radard.config.credentials import read_secret
from radard.config.sink_table import WebSection
from radard.errors import ConfigError

Role = Literal["nobody", "viewer", "operator"]
SESSION_S = 12 * 3600.0  # chosen: a day's work
_MOST_SESSIONS = 64  # chosen: the oldest ends
_MOST_FAILURES, _FAILURES_S = 10, 60.0  # chosen: 5 million guesses a year, of 12 characters
_LEAST_LENGTH = 12  # characters of a token, chosen
_LOOPBACK = {"localhost", "127.0.0.1", "::1"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tokens:
    """Tokens of a dashboard; None where there is none."""

    viewer: str | None = None
    operator: str | None = None

    def __repr__(self) -> str:
        return f"Tokens(viewer={self.viewer is not None}, operator={self.operator is not None})"


def is_loopback(host: str) -> bool:
    """Return whether an address to listen on is reachable only from this machine."""
    if host.lower() in _LOOPBACK:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def read_tokens(section: WebSection, host: str) -> Tokens:
    """Return the tokens that the configuration names.

    Raises ConfigError if one cannot be read or is short, or if there is none and `host` is not
    loopback.
    """
    tokens = Tokens(
        viewer=read_secret("web.token", section.token_file, section.token_env),
        operator=read_secret(
            "web.operator_token", section.operator_token_file, section.operator_token_env
        ),
    )
    for name, token in (("token", tokens.viewer), ("operator_token", tokens.operator)):
        if token is not None and len(token) < _LEAST_LENGTH:
            msg = f"web.{name}: a token needs {_LEAST_LENGTH} characters or more"
            raise ConfigError(msg)
    if tokens.viewer is None and tokens.operator is None and not is_loopback(host):
        msg = (
            f"--output http://{host}: others can reach this address; name a token with "
            "web.token_file or web.token_env (and web.operator_token_file for arming)"
        )
        raise ConfigError(msg)
    return tokens


class RateLimit:
    """A token bucket: `most` acts at once, and `per_s` a second after that."""

    def __init__(self, most: float, per_s: float) -> None:
        self._most, self._per_s = most, per_s
        self._left, self._at_s = most, time.monotonic()

    def take(self) -> bool:
        """Count an act; return whether it may be done."""
        now_s = time.monotonic()
        self._left = min(self._most, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1:
            return False
        self._left -= 1
        return True


class AccessControl:
    """Says what a request may do; used by the web's own thread alone.

    Without `may_command` nobody is an operator. `cookie` is the name of the session's cookie:
    browsers share cookies between ports. `clock` is monotonic, in seconds.
    """

    def __init__(
        self,
        tokens: Tokens,
        *,
        may_command: bool = True,
        cookie: str = "radard",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._tokens = tokens
        self.cookie = cookie
        self._may_command = may_command
        self._clock = clock
        self._sessions: dict[str, tuple[Role, float]] = {}
        self._failures: deque[float] = deque(maxlen=_MOST_FAILURES)

    @property
    def wants_token(self) -> bool:
        """Whether a request must have a token at all."""
        return self._tokens.viewer is not None or self._tokens.operator is not None

    @property
    def is_locked(self) -> bool:
        """Whether too many wrong tokens came in the last minute."""
        failures = self._failures
        is_full = len(failures) == _MOST_FAILURES
        return is_full and self._clock() - failures[0] < _FAILURES_S

    def role(self, headers: Mapping[str, str], cookies: Mapping[str, str]) -> Role:
        """Return the role of a request."""
        if not self.wants_token:
            return self._granted("operator")
        session = self._sessions.get(cookies.get(self.cookie, ""))
        if session is not None and session[1] > self._clock():
            return session[0]
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and token.strip():
            return self._role_of(token.strip())
        return "nobody"

    def log_in(self, token: str) -> tuple[Role, str]:
        """Return role and session for a token; ('nobody', '') for a wrong one."""
        role = self._role_of(token)
        if role == "nobody":
            return role, ""
        now_s = self._clock()
        alive = [(key, item) for key, item in self._sessions.items() if item[1] > now_s]
        self._sessions = dict(alive[-_MOST_SESSIONS + 1 :])
        session = secrets.token_urlsafe(32)
        self._sessions[session] = (role, now_s + SESSION_S)
        return role, session

    def log_out(self, cookies: Mapping[str, str]) -> None:
        """End a session."""
        self._sessions.pop(cookies.get(self.cookie, ""), None)

    def is_right_host(self, headers: Mapping[str, str]) -> bool:
        """Return whether the host of a request is allowed: without tokens, only loopback."""
        if self.wants_token:
            return True
        return _host_of(f"//{headers.get('host', '')}") in _LOOPBACK

    def is_same_origin(self, headers: Mapping[str, str]) -> bool:
        """Return whether a request comes from our own page, or from no page at all."""
        site = headers.get("sec-fetch-site")
        if site is not None and site not in {"same-origin", "none"}:
            return False
        origin = headers.get("origin")
        if origin is None:
            return True
        return urlsplit(origin).netloc == headers.get("host", "") != ""

    def _role_of(self, token: str) -> Role:
        if self.is_locked:
            return "nobody"
        given = token.encode()
        is_operator = _equal(given, self._tokens.operator)
        is_viewer = _equal(given, self._tokens.viewer)
        if is_operator:
            return self._granted("operator")
        if is_viewer:
            return "viewer"
        self._failures.append(self._clock())
        return "nobody"

    def _granted(self, role: Role) -> Role:
        return role if self._may_command else "viewer"


def _equal(given: bytes, wanted: str | None) -> bool:
    return wanted is not None and hmac.compare_digest(given, wanted.encode())


def _host_of(netloc: str) -> str:
    try:
        return (urlsplit(netloc).hostname or "").lower()
    except ValueError:
        return ""
