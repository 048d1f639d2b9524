"""Sections of the configuration that sinks read, and where they find their credentials.

A credential is never a value here: the configuration names a file or an environment
variable, and `read_secret` opens it when it is needed. So no printed configuration, and no
`repr`, can hold one, and a renewed file counts from the next connection on.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from radard.config.web_sections import WebSection
from radard.errors import ConfigError

EventKind = Literal["alarm", "fault", "tamper"]
Phase = Literal["new", "update", "end"]
Local = Literal["local0", "local1", "local2", "local3", "local4", "local5", "local6", "local7"]
Facility = Literal["user", "daemon", "auth", "authpriv"] | Local
PHASES: tuple[Phase, ...] = ("new", "update", "end")
KINDS: tuple[EventKind, ...] = ("alarm", "fault", "tamper")


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class JsonlSection(_Section):
    """JSON Lines files; a run whose stream can wait rotates nothing."""

    rotate_mb: float = Field(50.0, gt=0, description="a file as large as this is put aside")
    keep_files: int = Field(10, ge=0, le=1000, description="so many are kept beside the newest")


class MqttSection(_Section):
    """MQTT and Home Assistant."""

    username: str | None = Field(None, description="unless the URL names one")
    password_file: Path | None = Field(None, description="file whose first line is the password")
    password_env: str | None = Field(None, description="or variable that holds it")
    client_id: str | None = Field(None, description="null: radard-SENSOR")
    keepalive_s: int = Field(10, ge=1, le=3600, description="a dead line is noticed in 1.5 times")
    ca_file: Path | None = Field(None, description="who signs the broker; null: the system's")
    cert_file: Path | None = Field(None, description="certificate of this client")
    key_file: Path | None = Field(None, description="and its key")
    check_hostname: bool = Field(True, description="the certificate must name the host")
    decisions: bool = Field(True, description="publish every decision")
    commands: bool = Field(True, description="heed arm, disarm, ack and calibrate")
    expire_after_s: float = Field(30.0, ge=6, le=3600, description="a state older than so is void")
    discovery: Literal["device", "components", "off"] = Field(
        "device", description="Home Assistant from 2024.11; components: older ones and openHAB"
    )
    discovery_prefix: str = Field("homeassistant", pattern=r"^[^+#\s]+$", description="its topic")


class OutboxSection(_Section):
    """Events that wait for their delivery: mqtt, webhook and exec."""

    max_events: int = Field(10_000, ge=1, le=1_000_000, description="then the oldest go")
    first_retry_s: float = Field(1.0, gt=0, le=3600, description="wait after a failure; doubles")
    longest_retry_s: float = Field(60.0, gt=0, le=86_400, description="up to this")
    attempts: int = Field(8, ge=1, le=1000, description="refusals until an event is given up")
    give_up_h: float = Field(168.0, gt=0, description="an older one is given up when it fails")


class StoreSection(_Section):
    """The SQLite store."""

    decisions: bool = Field(True, description="keep decisions too, not only events and states")
    keep_days: float = Field(90.0, gt=0, le=36_500, description="then rows go")
    keep_mb: float = Field(200.0, ge=1, description="the oldest rows go beyond that")


class WebhookSection(_Section):
    """HTTP POST of every event."""

    timeout_s: float = Field(10.0, gt=0, le=300, description="for one attempt, all in all")
    kinds: tuple[EventKind, ...] = Field(KINDS, description="events to send")
    phases: tuple[Phase, ...] = Field(PHASES, description="and their phases")
    statuses: bool = Field(False, description="send changes of the daemon's state too")
    decisions: bool = Field(False, description="and every decision")
    token_file: Path | None = Field(None, description="file with a bearer token")
    token_env: str | None = Field(None, description="or variable that holds it")
    secret_file: Path | None = Field(None, description="file with the key that signs (HMAC)")
    secret_env: str | None = Field(None, description="or variable that holds it")
    ca_file: Path | None = Field(None, description="who signs the server; null: the system's")


class ExecSection(_Section):
    """A program that is run for every event."""

    timeout_s: float = Field(30.0, gt=0, le=3600, description="then it is killed")
    kinds: tuple[EventKind, ...] = Field(KINDS, description="events to run it for")
    phases: tuple[Phase, ...] = Field(PHASES, description="and their phases")


class SyslogSection(_Section):
    """syslog and journald."""

    facility: Facility = Field("daemon", description="of the messages")
    decisions: bool = Field(False, description="log every decision too, as debug")


class SinkOptions(_Section):
    """All of them. A configuration class may inherit these sections."""

    jsonl: JsonlSection = JsonlSection()
    mqtt: MqttSection = MqttSection()
    outbox: OutboxSection = OutboxSection()
    store: StoreSection = StoreSection()
    webhook: WebhookSection = WebhookSection()
    exec: ExecSection = ExecSection()
    syslog: SyslogSection = SyslogSection()
    web: WebSection = WebSection()


def read_secret(
    what: str,
    file: Path | None,
    variable: str | None,
    environ: Mapping[str, str] | None = None,
) -> str | None:
    """Return a credential, or None when neither place is named.

    Parameters
    ----------
    what : str
        Key of the configuration without `_file` and `_env`, for messages.
    file : Path or None
        Its first line is the credential.
    variable : str or None
        Name of the environment variable.
    environ : mapping, optional
        Instead of the process environment.

    Raises
    ------
    ConfigError
        If both are named, or there is nothing in the one that is. The message names the
        place, never the content.
    """
    if file is not None and variable is not None:
        msg = f"{what}_file and {what}_env are both given; one is enough"
        raise ConfigError(msg)
    if variable is not None:
        secret = (os.environ if environ is None else environ).get(variable, "")
        if not secret:
            msg = f"{what}_env: the variable {variable} is empty or not set"
            raise ConfigError(msg)
        return secret
    if file is None:
        return None
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as err:
        why = err.strerror if isinstance(err, OSError) else "not text"
        msg = f"{what}_file: {file}: {why}"
        raise ConfigError(msg) from err
    if not lines or not lines[0].strip():
        msg = f"{what}_file: {file}: the first line is empty"
        raise ConfigError(msg)
    return lines[0].strip()
