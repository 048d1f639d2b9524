"""Webhook: every event as an HTTP POST, repeated until a server takes it.

On `http.client`: a redirect would carry an alarm to a host that nobody named, and the time limit
is one for the whole attempt. Signatures and headers are those of Standard Webhooks 1.0 (recalled).
"""

import base64
import hashlib
import hmac
import http.client
import os
import socket
import threading
import time
from pathlib import Path
from urllib.parse import quote, urljoin, urlsplit

from radard.config.credentials import read_secret
from radard.config.sink_table import SinkOptions, WebhookSection
from radard.errors import ConfigError, UsageError
from radard.log import Entry
from radard.outputs.base import DeliveryError, SinkContext
from radard.outputs.stdout import json_line
from radard.outputs.thread_sink import Delivery, wants_events
from radard.outputs.tls import LATE, client_context, explain, shown_host, split_server
from x2radar import wall_clock
from x2radar.command import installed_version

_REFUSALS = frozenset({400, 405, 406, 409, 410, 411, 413, 414, 415, 422})
"""Status codes about this very body (RFC 9110); others count as an outage of the server."""
_REDIRECTS = frozenset({301, 302, 307, 308})  # a POST may be repeated elsewhere (RFC 9110)
_MAX_HOPS = 3  # from a name to its https and its new place
_MAX_ANSWER = 65_536  # bytes that are read of an answer: a page that explains a fault


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> Delivery:
    """Return the sink of `webhook:URL`, or of `webhook:@FILE` whose first line is the URL."""
    target = url.partition(":")[2]
    if target.startswith("@"):
        # URLs of chat services are secrets; a file keeps them off the command line.
        target = read_secret("webhook.url", Path(target[1:]), None) or ""
    parts = split_server("webhook", target)
    if parts.scheme not in {"http", "https"} or not parts.hostname or parts.username is not None:
        raise UsageError(
            "--output webhook: give webhook:http://HOST/PATH, https://, or @FILE with such a "
            "URL in it; user and password do not belong there, see webhook.token_file"
        )
    # What a URL may not hold goes quoted, as in a browser: blanks, letters beyond ASCII. Not those
    # of the host, which the socket knows to write.
    begin = target.index("://") + 3 + len(parts.netloc)
    quoted = target[:begin] + quote(os.fsencode(target[begin:]), safe="%/:=&?~#+!$,;'@()*[]")
    o, host = options.webhook, shown_host(parts.hostname)
    others = ["status"] * o.statuses + ["decision"] * o.decisions
    return Delivery(
        f"webhook:{parts.scheme}://{host}{f':{parts.port}' if parts.port else ''}",
        quoted,
        options.log,
        context,
        wants_events(o.kinds, o.phases, others),
        _Poster(quoted, o, context.sensor).send,
    )


class _Poster:
    """Posts every event to a URL, signed where there is a secret."""

    def __init__(self, url: str, section: WebhookSection, sensor: str) -> None:
        self._url, self._section, self._sensor = url, section, sensor
        self._tls = client_context("webhook", section.ca_file)
        self._headers(b"", "check")

    def send(self, entry: Entry) -> None:
        """Post an entry; raises DeliveryError unless a server takes it."""
        body = json_line({"sensor": self._sensor, **entry.record}).rstrip().encode()
        began_s = time.monotonic()
        try:
            code = self._post_to_the_end(body, self._headers(body, entry.key))
        except ConfigError as err:
            raise DeliveryError(str(err)) from err
        except (OSError, ValueError, http.client.HTTPException) as err:
            # What `_hang_up` has closed may be any of them, of TLS a ValueError.
            if time.monotonic() - began_s >= self._section.timeout_s:
                msg = LATE
            elif isinstance(err, ConnectionResetError | BrokenPipeError):
                msg = "the server closes the connection without an answer"
            elif isinstance(err, http.client.HTTPException):
                msg = f"not an HTTP answer: {type(err).__name__}"
            else:
                msg = f"cannot connect: {explain(err)}"
            raise DeliveryError(msg) from err
        if not 200 <= code < 300:
            msg = f"the server answers {code} {http.client.responses.get(code, '')}"
            if code in _REDIRECTS and not self._section.follow_redirects:
                msg += ", a redirect, which webhook.follow_redirects may follow"
            raise DeliveryError(msg, is_refusal=code in _REFUSALS)

    def _post_to_the_end(self, body: bytes, headers: dict[str, str]) -> int:
        """Return the code of the last answer, after redirects if they are followed."""
        url, end_s = self._url, time.monotonic() + self._section.timeout_s
        n_hops = _MAX_HOPS if self._section.follow_redirects else 0
        while True:
            code, location = self._post(url, body, headers, max(0.001, end_s - time.monotonic()))
            if not n_hops or not location or code not in _REDIRECTS:
                return code
            n_hops -= 1
            before, url = url, urljoin(url, location)
            if urlsplit(url).scheme not in {"https", urlsplit(before).scheme}:
                raise DeliveryError("the server redirects to what is no https")
            if urlsplit(url)[:2] != urlsplit(before)[:2]:
                # The token is for the host that was named.
                headers.pop("Authorization", None)

    def _post(
        self, url: str, body: bytes, headers: dict[str, str], timeout_s: float
    ) -> tuple[int, str]:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
        link = http.client.HTTPConnection(host, port, timeout=timeout_s)
        if parts.scheme == "https":
            link = http.client.HTTPSConnection(host, port, timeout=timeout_s, context=self._tls)
        # The library's limit is for every read; a server that drips bytes would outlive it.
        watch = threading.Timer(timeout_s, _hang_up, (link,))
        watch.daemon = True
        watch.start()
        try:
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            link.request("POST", path, body, headers)
            answer = link.getresponse()
            answer.read(_MAX_ANSWER)
            return answer.status, answer.getheader("Location", "")
        finally:
            watch.cancel()
            link.close()

    def _headers(self, body: bytes, key: str) -> dict[str, str]:
        o = self._section
        now = str(int(wall_clock.now_s()))
        headers = {
            "Content-Type": "application/json",
            "User-Agent": f"radard/{installed_version()}",
            "webhook-id": key,
            "webhook-timestamp": now,
        }
        if token := read_secret("webhook.token", o.token_file, o.token_env):
            headers["Authorization"] = f"Bearer {token}"
        if secret := read_secret("webhook.secret", o.secret_file, o.secret_env):
            headers["webhook-signature"] = sign(secret, key, now, body)
        return headers


def sign(secret: str, key: str, timestamp: str, body: bytes) -> str:
    """Return the header webhook-signature of a body; ConfigError if `whsec_` is no base64."""
    raw = secret.encode()
    if secret.startswith("whsec_"):
        try:
            raw = base64.b64decode(secret.removeprefix("whsec_"), validate=True)
        except ValueError as err:
            raise ConfigError("webhook.secret: what follows whsec_ is not base64") from err
    content = f"{key}.{timestamp}.".encode() + body
    digest = hmac.new(raw, content, hashlib.sha256).digest()
    return f"v1,{base64.b64encode(digest).decode()}"


def _hang_up(link: http.client.HTTPConnection) -> None:
    sock: socket.socket | None = link.sock
    if sock is not None:
        try:
            sock.shutdown(socket.SHUT_RDWR)
        except OSError:
            sock.close()
