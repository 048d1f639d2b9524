"""The table of outputs (-o/--output): a row for each, and the sections of their options.

A new sink is a module in `radard.outputs`, a row of `SINKS` here, a section if it has options,
and its row in docs/reference/outputs.md.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from radard.config.sections import Section, path_at_home

EventKind = Literal["alarm", "fault", "tamper"]
Phase = Literal["new", "update", "end"]
Local = Literal["local0", "local1", "local2", "local3", "local4", "local5", "local6", "local7"]
Facility = Literal["user", "daemon", "auth", "authpriv"] | Local
PHASES: tuple[Phase, ...] = ("new", "update", "end")
WEB_URL = r"^https?://\S+$"
KINDS: tuple[EventKind, ...] = ("alarm", "fault", "tamper")


class JsonlSection(Section):
    """JSON Lines files; a run whose stream can wait rotates nothing."""

    rotate_mb: float = Field(50.0, gt=0, description="a file as large as this is put aside")
    keep_files: int = Field(10, ge=0, le=1000, description="so many are kept beside the newest")


class MqttSection(Section):
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
    commands: Literal["auto", "always", "off"] = Field(
        "auto", description="arm, disarm, ack, calibrate; auto: only over TLS and authenticated"
    )
    code_file: Path | None = Field(None, description="file with the code that disarming takes")
    code_env: str | None = Field(None, description="or variable that holds it")
    picture: bool = Field(True, description="publish the picture of the last alarm")
    dashboard_url: str | None = Field(
        None, pattern=WEB_URL, description="Home Assistant's link to the dashboard"
    )
    expire_after_s: float = Field(30.0, ge=6, le=3600, description="a state older than so is void")
    discovery: Literal["device", "components", "off"] = Field(
        "device", description="Home Assistant from 2024.11; components: older ones and openHAB"
    )
    discovery_prefix: str = Field("homeassistant", pattern=r"^[^+#\s]+$", description="its topic")


class LogSection(Section):
    """The event log, and how mqtt, webhook, apprise and exec deliver what is in it."""

    max_events: int = Field(10_000, ge=1, le=100_000, description="then the oldest go")
    first_retry_s: float = Field(1.0, gt=0, le=3600, description="wait after a failure; doubles")
    longest_retry_s: float = Field(60.0, gt=0, le=86_400, description="up to this")
    attempts: int = Field(8, ge=1, le=1000, description="refusals until an event is given up")
    give_up_h: float = Field(
        168.0, gt=0, description="one that waited so long while radard ran goes when it fails"
    )


class StoreSection(Section):
    """The SQLite store."""

    decisions: bool = Field(True, description="keep decisions too, not only events and states")
    keep_days: float = Field(90.0, gt=0, le=36_500, description="then rows go")
    keep_mb: float = Field(200.0, ge=1, description="the oldest rows go beyond that")


class WebhookSection(Section):
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
    follow_redirects: bool = Field(False, description="also to another host, without the token")


class AppriseSection(Section):
    """Messages to people, by Apprise."""

    kinds: tuple[EventKind, ...] = Field(KINDS, description="events to tell")
    phases: tuple[Phase, ...] = Field(("new",), description="and their phases")
    picture: bool = Field(True, description="attach the alarm's picture")


class ExecSection(Section):
    """A program that is run for every event."""

    timeout_s: float = Field(30.0, gt=0, le=3600, description="then it is killed")
    kinds: tuple[EventKind, ...] = Field(KINDS, description="events to run it for")
    phases: tuple[Phase, ...] = Field(PHASES, description="and their phases")


class SyslogSection(Section):
    """syslog and journald."""

    facility: Facility = Field("daemon", description="of the messages")
    ca_file: Path | None = Field(None, description="who signs a tls: server; null: the system's")
    cert_file: Path | None = Field(None, description="certificate of this client")
    key_file: Path | None = Field(None, description="and its key")
    decisions: bool = Field(False, description="log every decision too, as debug")


class WebSection(Section):
    """The dashboard and its HTTP interface (-o http://HOST:PORT)."""

    token_file: Path | None = Field(None, description="file with the token for looking on")
    token_env: str | None = Field(None, description="or variable that holds it")
    operator_token_file: Path | None = Field(None, description="token for arming, too")
    operator_token_env: str | None = Field(None, description="or variable that holds it")
    commands: bool = Field(True, description="false: nobody arms or labels from here")
    max_viewers: int = Field(32, ge=1, le=200, description="open pages at the same time")
    labels_file: Path | None = Field(None, description="null: labels.jsonl, state directory")
    sensors: dict[str, Annotated[str, StringConstraints(pattern=WEB_URL)]] = Field(
        default_factory=dict, description="other dashboards to link to, name: URL"
    )


class SinkOptions(Section):
    """The sections of all sinks; each belongs to a row of `SINKS`."""

    jsonl: JsonlSection = JsonlSection()
    mqtt: MqttSection = MqttSection()
    log: LogSection = LogSection()
    store: StoreSection = StoreSection()
    webhook: WebhookSection = WebhookSection()
    apprise: AppriseSection = AppriseSection()
    exec: ExecSection = ExecSection()
    syslog: SyslogSection = SyslogSection()
    web: WebSection = WebSection()


@dataclass(frozen=True, slots=True)
class SinkRow:
    """What help, configuration, redaction and reload know of one output."""

    form: str  # the value of -o; the scheme is the word before the colon
    module: str  # imported when named; has `open_from_url` (`radard.outputs.registry.Opener`)
    value: Literal["none", "optional", "required"] = "required"  # none: not even a colon
    sections: tuple[str, ...] = ()  # of `SinkOptions`: a reload that changes one reopens it
    is_per_sensor: bool = False  # of several radars in one process each has its own
    # What is printed of its value; passwords in URLs never are (`radard.config.credentials`).
    shows: Literal["all", "host", "program", "service"] = "all"

    @property
    def scheme(self) -> str:
        """The word before the colon."""
        return self.form.partition(":")[0]


SINKS = (
    SinkRow("json", "radard.outputs.stdout", value="none"),
    SinkRow("json:FILE", "radard.outputs.jsonl", sections=("jsonl",)),
    SinkRow("table", "radard.outputs.stdout", value="none"),
    SinkRow("null", "radard.outputs.stdout", value="none"),
    *(
        SinkRow(form, "radard.outputs.mqtt.sink", sections=("mqtt", "log"), is_per_sensor=True)
        for form in ("mqtt://HOST", "mqtts://HOST")
    ),
    SinkRow("webhook:URL", "radard.outputs.webhook", "optional", ("webhook", "log"), shows="host"),
    SinkRow("apprise:URL", "radard.outputs.apprise", sections=("apprise", "log"), shows="service"),
    SinkRow("exec:COMMAND", "radard.outputs.exec", sections=("exec", "log"), shows="program"),
    SinkRow("syslog:", "radard.outputs.syslog", value="optional", sections=("syslog", "log")),
    SinkRow("lsl:", "radard.outputs.lsl", value="optional", is_per_sensor=True),
    SinkRow("store:FILE", "radard.outputs.store", sections=("store",)),
    SinkRow("http://HOST:PORT", "radard.web.sink", sections=("web",)),
)
"""All built-in outputs, in the order in which help and docs/reference/outputs.md list them."""
SCHEMES = frozenset(row.scheme for row in SINKS)
FORMS = ", ".join(row.form for row in SINKS)


def find_row(output: str) -> SinkRow | None:
    """Return the row of a value of -o; None if no built-in sink has this form."""
    scheme, colon, rest = output.partition(":")
    given = {"none": not colon, "optional": bool(colon), "required": bool(rest)}
    return next((row for row in SINKS if row.scheme == scheme and given[row.value]), None)


def named_file(output: str) -> Path:
    """Return the file that a value of -o names behind its colon; `~/` is the home."""
    return path_at_home(output.partition(":")[2])
