"""syslog and journald: events and states as messages that an administrator reads.

This machine's log gets journald's own protocol where it runs, else RFC 3164 without time and host.
Servers get RFC 5424: one a datagram (RFC 5426), one a line (RFC 6587, 3.4.2), or with their octets
counted (RFC 5425).
"""

import errno
import os
import select
import socket
import ssl
from collections.abc import Callable
from logging.handlers import SysLogHandler
from pathlib import Path

from radard.config.credentials import redact
from radard.config.sink_table import SinkOptions
from radard.errors import UsageError
from radard.log_file import marks_of
from radard.outputs.base import DeliveryError, Record, SinkContext
from radard.outputs.thread_sink import DirectSink
from radard.outputs.tls import client_context, explain, shown_host, split_server
from x2radar.backoff import Backoff
from x2radar.wall_clock import utc_text

JOURNAL = Path("/run/systemd/journal/socket")
DEV_LOG = Path("/dev/log")
_SEND_S = 5.0  # a log that takes nothing for so long is tried again later
# Severities of RFC 5424, table 2.
_ALERT, _CRITICAL, _ERROR, _WARNING, _NOTICE, _INFO, _DEBUG = range(1, 8)
_NEW = {"alarm": _ALERT, "tamper": _CRITICAL, "fault": _ERROR}
_STATE = {"online": _INFO, "starting": _INFO, "degraded": _WARNING, "offline": _WARNING}

# Registered with IANA; 514 for UDP, and servers take it for TCP, too.
_PORTS = {"udp": 514, "tcp": 514, "tls": 6514}


def _parse_server(rest: str) -> tuple[str, str, int]:
    """Return the protocol that a log server speaks, its host and port."""
    if not set("@?#") & set(rest):
        parts = split_server("syslog", rest)
        if parts.scheme in _PORTS and parts.hostname and not parts.path.strip("/"):
            return parts.scheme, parts.hostname, parts.port or _PORTS[parts.scheme]
    forms = "syslog:, syslog:/socket, syslog:udp://host[:port], tcp: or tls:"
    raise UsageError(f"--output {redact(f'syslog:{rest}')!r}: use {forms}")


class SyslogSink(DirectSink):
    """Send messages to the log of `syslog:URL`, `syslog:/socket`, or this machine's: `syslog:`."""

    def __init__(self, url: str, options: SinkOptions, context: SinkContext) -> None:
        name, rest, o, s = url, url.partition(":")[2], options.log, options.syslog
        self._socket_path, self._server = rest, None
        self._tls: ssl.SSLContext | None = None
        if rest and not rest.startswith("/"):
            self._server = scheme, host, port = _parse_server(rest)
            name = f"syslog:{scheme}://{shown_host(host)}:{port}"
        backoff = Backoff(o.first_retry_s, o.longest_retry_s, name)
        kinds = {"event", "status"} | ({"decision"} if s.decisions else set())
        super().__init__(name, backoff, context, name, kinds=kinds)
        self._facility = SysLogHandler.facility_names[s.facility]
        if self._server and self._server[0] == "tls":
            self._tls = client_context("syslog", s.ca_file, s.cert_file, s.key_file)
        self._sensor = context.sensor
        self._socket: socket.socket | None = None
        self._form: Callable[[int, str, Record], bytes] = self._plain

    def _deliver(self, record: Record) -> None:
        try:
            sock = self._socket
            if sock is None or _is_closed(sock):
                self._shut()
                self._socket = sock = self._connect()
            severity, text = _message_of(record)
            text = f"{record.get('sensor', self._sensor)}: {text}"
            sock.sendall(self._form(severity, text, record))
        except OSError as err:
            self._shut()
            raise DeliveryError(f"cannot log: {explain(err)}") from err

    def _shut(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _connect(self) -> socket.socket:
        if self._server is not None:
            self._form, (scheme, host, port) = self._dated, self._server
            if scheme != "udp":
                sock, tls = socket.create_connection((host, port), _SEND_S), self._tls
                return tls.wrap_socket(sock, server_hostname=host) if tls else sock
            where = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            return _connected(where[0], where[1], where[4])
        address, self._form = self._socket_path or str(DEV_LOG), self._plain
        if not self._socket_path and JOURNAL.is_socket():
            address, self._form = str(JOURNAL), self._journal
        try:
            return _connected(socket.AF_UNIX, socket.SOCK_DGRAM, address)
        except OSError as err:
            if err.errno != errno.EPROTOTYPE:
                raise
            return _connected(socket.AF_UNIX, socket.SOCK_STREAM, address)

    def _plain(self, severity: int, text: str, _record: Record) -> bytes:
        priority = self._facility << 3 | severity
        return f"<{priority}>radard[{os.getpid()}]: {text}\0".encode(errors="replace")

    def _dated(self, severity: int, text: str, record: Record) -> bytes:
        """Return a message of RFC 5424, 6: a datagram, a line, or with its octets counted."""
        priority = self._facility << 3 | severity
        head = f"<{priority}>1 {record.get('time') or utc_text()} {socket.gethostname() or '-'}"
        text = f"{head} radard {os.getpid()} {record['type']} - {text}"
        message = text.encode(errors="replace")
        if self._server and self._server[0] == "tcp":
            return message.replace(b"\n", b" ") + b"\n"
        return b"%d %s" % (len(message), message) if self._tls else message

    def _journal(self, severity: int, text: str, record: Record) -> bytes:
        """Return a message of journald's native protocol (systemd, "Native Journal Protocol")."""
        fields = {
            "MESSAGE": text,
            "PRIORITY": severity,
            "SYSLOG_FACILITY": self._facility,
            "SYSLOG_IDENTIFIER": "radard",
            "RADARD_SENSOR": self._sensor,
            **{f"RADARD_{key.upper()}": value for key, value in record.items()},
        }
        told = b""
        for key, value in fields.items():
            if value is not None:
                data = str(value).encode(errors="replace")
                length = len(data).to_bytes(8, "little")
                between = b"\n" + length if b"\n" in data else b"="
                told += key.encode() + between + data + b"\n"
        return told


open_from_url = SyslogSink


def _message_of(record: Record) -> tuple[int, str]:
    kind = record["type"]
    if kind == "event":
        is_news = record["phase"] == "new" and not record.get("test")
        severity = _NEW.get(record["kind"], _WARNING) if is_news else _NOTICE
        where = f" clip={record['clip']}" if record["clip"] else ""
        head = f"{record['kind']} {record['phase']}{marks_of(record)}"
        return severity, f"{head}: {record['reason']} id={record['id']}{where}"
    if kind == "status":
        reason = f": {record['reason']}" if record["reason"] else ""
        return _STATE.get(record["state"], _WARNING), f"{record['state']}{reason}"
    return _DEBUG, f"decision {record['seq']}: gate {record['gate']}, label {record['label']}"


def _is_closed(sock: socket.socket) -> bool:
    """Return whether the far end has closed a stream; what is sent then would be lost."""
    poll = select.poll()
    poll.register(sock, select.POLLIN)
    if sock.type != socket.SOCK_STREAM or not poll.poll(0):
        return False
    if not isinstance(sock, ssl.SSLSocket):
        return sock.recv(1, socket.MSG_PEEK) == b""
    sock.settimeout(0)
    try:
        return sock.recv(1) == b""
    except ssl.SSLWantReadError:
        # TLS's own, such as the tickets of a session; log servers say nothing.
        return False
    finally:
        sock.settimeout(_SEND_S)


def _connected(family: int, kind: int, target: str | tuple[object, ...]) -> socket.socket:
    sock = socket.socket(family, kind)
    try:
        sock.settimeout(_SEND_S)
        sock.connect(target)
    except OSError:
        sock.close()
        raise
    return sock
