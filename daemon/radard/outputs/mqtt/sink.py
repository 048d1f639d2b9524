"""MQTT: the sensor's topics on a broker, its commands, and Home Assistant's discovery.

Events are published one after another, each when the broker has confirmed the one before (QoS 1);
over a lost connection one may come twice, with the same id. Commands: `COMMANDS` (empty payload;
disarm: the code, if one is set), `panel` (what Home Assistant's alarm panel sends), `sensitivity`.
After five wrong codes in a row none is taken for a minute.
"""

import contextlib
import hmac
import json
import logging
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote

from radard.alarm.sensitivity import SENSITIVITIES
from radard.config.credentials import read_secret
from radard.config.directories import saved_file
from radard.config.saved import change
from radard.config.sink_table import MqttSection, SinkOptions
from radard.errors import UsageError
from radard.outputs.base import COMMANDS, Record, SinkContext, SinkState, StateKeeper
from radard.outputs.mqtt.link import Broker, MqttLink, Publication
from radard.outputs.mqtt.topics import MqttTopics
from radard.outputs.thread_sink import Delivery, ThreadSink, picture_path
from radard.outputs.tls import shown_host, split_server
from x2radar.backoff import Backoff

log = logging.getLogger("radard")
_NO_TOPIC = re.compile(r"[+#\x00-\x1f\x7f\ud800-\udfff]")
_PORTS = {"mqtt": 1883, "mqtts": 8883}  # registered with IANA
_PATIENCE_S = 20.0  # so long events that a broker refuses hold up discovery and picture
_CLOSE_S = 1.0  # for the messages that say that the run has ended
_WARN_S = 60.0  # commands that are none are logged once in so long
_MAX_SHOWN = 40  # characters of a stranger's topic: a log line stays one
_MAX_WRONG = 5  # as keypads of panels have it
_LOCKED_S = 60.0  # a code of four digits then takes more than a day to guess
PANEL_COMMANDS = {"ARM_AWAY": "arm", "ARM_HOME": "arm-home", "DISARM": "disarm"}
"""Commands by what Home Assistant's panel sends."""
_MAX_PICTURE = 4_000_000  # bytes; a picture of the longest clip has a tenth of that
_HANGS_S = 10.0  # the sink's thread runs every `tick_s`; after so long without it, it hangs


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> "MqttSink":
    """Return the sink of `mqtt://[user@]host[:port][/prefix]`, or `mqtts://` with TLS."""
    broker, prefix = parse_url(url, options.mqtt, context.marked_sensor)
    if (context.is_one_of_several or context.mark) and options.mqtt.client_id:
        # The broker disconnects an existing client when another connects with the same id.
        broker = replace(broker, client_id=f"{options.mqtt.client_id}-{context.marked_sensor}")
    return MqttSink(broker, prefix, options, context)


def parse_url(url: str, options: MqttSection, sensor: str) -> tuple[Broker, str]:
    """Return where the broker is, and the first part of the topics."""
    scheme = url.partition(":")[0]
    parts = split_server(scheme, url)
    prefix = unquote(parts.path).strip("/") or "radard"
    fault = "nothing may follow the prefix" if "?" in url or "#" in url else ""
    fault = "the prefix holds what no topic may" if _NO_TOPIC.search(prefix) else fault
    fault = fault if parts.hostname else "no host"
    if parts.password is not None:
        fault = "no password in the URL, use mqtt.password_file or _env"
    if fault:
        msg = f"--output {scheme}: {fault}; it is {scheme}://[user@]host[:port][/prefix]"
        raise UsageError(msg)
    broker = Broker(
        host=parts.hostname or "",
        port=parts.port or _PORTS[scheme],
        is_tls=scheme == "mqtts",
        client_id=options.client_id or f"radard-{sensor}",
        username=unquote(parts.username) if parts.username else options.username,
    )
    return broker, prefix


def code_of(options: MqttSection) -> str:
    """Return the code that disarming takes, empty without one; raises ConfigError."""
    return read_secret("mqtt.code", options.code_file, options.code_env) or ""


@dataclass(eq=False)
class CommandReader:
    """Read the messages of one sensor's command topics."""

    options: MqttSection
    now_s: Callable[[], float] = time.monotonic
    _n_wrong: int = 0
    _locked_until_s: float = float("-inf")

    def read(self, topic: str, payload: bytes, *, is_retained: bool) -> tuple[str, str]:
        """Return a command, or 'sensitivity', and its value; or ValueError, ConfigError."""
        name = topic.rpartition("/")[2]
        shown = repr(name[:_MAX_SHOWN])
        if is_retained:
            msg = f"command {shown} ignored: it was retained; remove it from the broker"
            raise ValueError(msg)
        if name == "sensitivity":
            if (text := payload.decode()) not in (names := SENSITIVITIES["fused"]):
                raise ValueError(f"command {shown} ignored: it is one of {', '.join(names)}")
            return name, text
        code = ""
        if name == "panel":
            name, code = panel_command(payload)
        elif name not in COMMANDS:
            msg = f"no command {shown}; known are {', '.join(COMMANDS)}, panel, sensitivity"
            raise ValueError(msg)
        elif name == "disarm":
            code = payload.decode()
        elif payload:
            raise ValueError(f"command {shown} ignored: its payload must be empty")
        if name == "disarm":
            self._check_code(code)
        return name, ""

    def _check_code(self, given: str) -> None:
        wanted = code_of(self.options)
        if not wanted:
            if given:
                msg = "command 'disarm' ignored: its payload must be empty, as no code is set"
                raise ValueError(msg)
            return
        if self.now_s() < self._locked_until_s:
            raise ValueError("command 'disarm' ignored: too many wrong codes, wait a minute")
        if hmac.compare_digest(given.encode(), wanted.encode()):
            self._n_wrong = 0
            return
        self._n_wrong += 1
        if self._n_wrong >= _MAX_WRONG:
            self._n_wrong, self._locked_until_s = 0, self.now_s() + _LOCKED_S
        raise ValueError("command 'disarm' ignored: a wrong code, or none")


def panel_command(payload: bytes) -> tuple[str, str]:
    """Return command and code that Home Assistant's panel sends; ValueError if it is none."""
    text, code = payload.decode(), ""
    if text.startswith("{"):
        try:
            raw = json.loads(text)
        except RecursionError as err:
            raise ValueError("a panel's command is nested too deeply") from err
        text, code = str(raw.get("action")), str(raw.get("code") or "")
    if text not in PANEL_COMMANDS:
        raise ValueError(f"a panel's command is one of {', '.join(PANEL_COMMANDS)}")
    return PANEL_COMMANDS[text], code


class MqttSink(ThreadSink):
    """Publishes states, decisions, pictures and discovery to a broker, and takes its commands."""

    tick_s = 0.5

    def __init__(
        self, broker: Broker, prefix: str, options: SinkOptions, context: SinkContext
    ) -> None:
        scheme = "mqtts" if broker.is_tls else "mqtt"
        name = f"{scheme}://{shown_host(broker.host)}:{broker.port}/{prefix}"
        name += f"/{context.sensor}" if context.is_one_of_several else ""
        super().__init__(name)
        self._keeper = StateKeeper(name, "not connected yet")
        assert context.host is not None  # noqa: S101 - several sensors share no client
        self._host = context.host
        # Any client that can publish there can disarm.
        words = (options.mqtt.password_file, options.mqtt.password_env, options.mqtt.cert_file)
        is_safe, commands = broker.is_tls and words != (None, None, None), options.mqtt.commands
        takes_commands = commands == "always" or (commands == "auto" and is_safe)
        if not takes_commands and commands == "auto":
            log.warning(
                "%s: takes no commands: that needs mqtts:// with a password or a client "
                "certificate, or mqtt.commands: always (off: without this line)",
                name,
            )
        code = code_of(options.mqtt)
        self._topics = topics = MqttTopics(
            context.marked_sensor,
            prefix,
            options.mqtt,
            takes_commands=takes_commands,
            code_form="REMOTE_CODE" if code.isdigit() else "REMOTE_CODE_TEXT" if code else "",
        )
        self._warned_s = float("-inf")
        self._must_announce = self._must_describe = False
        self._owed_s = self._ticked_s = time.monotonic()
        self._reader, o = CommandReader(options.mqtt), options.log
        subscriptions = [topics.birth_topic] if options.mqtt.discovery != "off" else []
        subscriptions += [f"{topics.base}/command/+"] if takes_commands else []
        self._has_pictures = options.mqtt.picture
        self._picture: Path | None = None  # of the newest alarm
        self._seen_ns = 0
        self._link = MqttLink(
            broker,
            options.mqtt,
            Backoff(o.first_retry_s, o.longest_retry_s, broker.client_id),
            will=topics.will,
            subscriptions=subscriptions,
            on_up=self._on_up,
            on_down=self._keeper.failed,
            on_message=self._on_message,
            is_alive=lambda: time.monotonic() - self._ticked_s < _HANGS_S,
            say=self._keeper.remark,
        )
        self._delivery = Delivery(
            name,
            f"{broker.host}:{broker.port}/{prefix}",
            o,
            context,
            lambda _record: True,
            lambda entry: self._link.publish_confirmed(topics.event(entry.record)),
            self._keeper,
        )

    @property
    def state(self) -> SinkState:
        """How the delivery of events is doing, and what waits besides."""
        state = self._delivery.state
        return replace(state, n_waiting=state.n_waiting + len(self._queue))

    def _begin(self) -> None:
        self.cursor = self._delivery.start().cursor
        self._ticked_s = time.monotonic()
        self._link.start()

    def _take(self, record: Record) -> None:
        self._must_describe |= record["type"] == "hello"
        path = picture_path(record) if self._has_pictures else None
        if path is not None and path != self._picture:
            self._picture, self._seen_ns = path, 0
        self._publish(self._topics.on_record(record, time.monotonic()))

    def _tick(self) -> None:
        self._ticked_s = now_s = time.monotonic()
        if self._must_announce:
            self._must_announce, self._must_describe = False, True
            self._publish(self._topics.announce(now_s))
            # Who has the picture may have lost it.
            self._seen_ns = 0
        status, panel = self._host.health.status, self._host.panel()
        self._publish(self._topics.refresh(now_s, status, panel))
        if not self.cursor:
            self._owed_s = now_s
        # Not for ever: they may be refused.
        owes_events = 0 < now_s - self._owed_s < _PATIENCE_S
        # Large messages come last, each by itself: a broker may drop the line at them.
        if self._must_announce or not self._link.is_idle or owes_events:
            return
        if self._must_describe:
            self._must_describe = False
            self._publish(self._topics.discovery())
        elif self._picture is not None and (png := self._fresh(self._picture)) is not None:
            self._publish([self._topics.picture(png)])

    def _fresh(self, picture: Path) -> bytes | None:
        """Return a picture if it has changed since the last call."""
        # Perhaps it is not drawn yet, or was taken away to make room.
        with contextlib.suppress(OSError):
            about = picture.stat()
            if about.st_mtime_ns != self._seen_ns and about.st_size <= _MAX_PICTURE:
                data = picture.read_bytes()
                self._seen_ns = about.st_mtime_ns
                return data
        return None

    def _publish(self, messages: list[Publication]) -> None:
        if not self._link.is_up or self._must_announce:
            # `announce` publishes all of it after a connection.
            return
        for message in messages:
            if not self._link.publish(message):
                self._keeper.dropped(1, "the broker does not keep up")
            elif message.qos == 0:
                self._keeper.sent()

    def _on_up(self) -> None:
        self._keeper.sent(0)
        self._announce()
        self._delivery.retry_now()

    def _announce(self) -> None:
        self._must_announce = True
        self._queue.wake()

    def _on_message(self, topic: str, payload: bytes, is_retained: bool) -> None:
        try:
            if topic == self._topics.birth_topic:
                if payload == b"online":
                    self._announce()
                return
            name, value = self._reader.read(topic, payload, is_retained=is_retained)
            log.info("%s: command %s", self.name, f"{name} {value}".rstrip())
            if name != "sensitivity":
                self._host.command(name)
                return
            path = saved_file(self._host.config(), "settings")
            change(path, "settings", {"alarm": {"sensitivity": value}})
            self._host.reload()
        except Exception as err:  # noqa: BLE001 - in the library's thread, which must go on
            if (now_s := time.monotonic()) - self._warned_s >= _WARN_S:
                log.warning("%s: %s", self.name, err)
                self._warned_s = now_s

    def _shut(self) -> None:
        self._delivery.close(self._left_s())
        if self._link.is_up:
            for message in self._topics.at_end():
                self._link.publish(message)
        self._link.close(min(self._left_s(), _CLOSE_S))
