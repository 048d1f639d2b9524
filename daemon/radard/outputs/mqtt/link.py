"""MqttLink: one connection to a broker, made again whenever it is lost, with a clean session.

MQTT 5 lets a broker refuse a message, and state its largest packet. One of 3.1.1 drops the line
instead: then the largest message in flight is left out after the second time (`PacketLimits`).
"""

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from radard.config.credentials import read_secret
from radard.config.sink_table import MqttSection
from radard.errors import ConfigError
from radard.outputs.base import DeliveryError
from radard.outputs.tls import client_context, explain
from x2radar.backoff import Backoff

_CONFIRM_S = 10.0  # far above a round trip, below what a person waits for an alarm
_POLL_S = 0.1  # how soon a lost connection is noticed
_SHORT_S = 5.0  # a connection as short as this hints at a second client of this id
_MAX_UNSENT = 50  # messages in flight beyond which decisions go: a minute of them
_NO_ANSWER = "no answer; is it an MQTT broker?"
_HEAD = 12  # bytes of a packet beside topic and payload, at most
_MIN_SUSPECT = 1024  # no broker limits packets to less; events and states are below it
_FORGOTTEN_S = 86_400.0  # a broker may have been set right since


@dataclass(frozen=True, slots=True)
class Publication:
    """A message to publish, with its topic and quality of service."""

    topic: str
    payload: str | bytes
    qos: int = 1
    is_retained: bool = True


class PacketLimits:
    """Learn what a broker takes; any thread may ask. `say` is told what is left out, once."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._flying: list[tuple[str, int, Callable[[], bool]]] = []
        self._broke_s: dict[str, float] = {}  # when it last was the largest as the line broke
        self._too_large: dict[str, int] = {}  # once it did so twice: one may have another cause
        self._said: set[str] = set()
        self.can_retain = True  # whether the broker keeps messages
        self.max_bytes: int | None = None  # the largest packet that the broker states

    def takes(self, message: Publication) -> bool:
        """Return whether to send a message."""
        size = _size_of(message)
        if self.max_bytes is not None and size > self.max_bytes:
            self.leave_out(message.topic, f"{size} bytes, and the broker takes {self.max_bytes}")
            return False
        return size < self._too_large.get(message.topic, size + 1)

    def sent(self, message: Publication, is_done: Callable[[], bool]) -> None:
        """Note a message in flight, until `is_done` says that it is confirmed."""
        self.in_flight().append((message.topic, _size_of(message), is_done))

    def broke(self) -> bool:
        """Note that the line broke; return whether a message is to blame."""
        flying, self._flying = self.in_flight(), []
        topic, size, _ = max(flying, key=lambda each: each[1], default=("", 0, None))
        if size < _MIN_SUSPECT:
            return False
        now_s, before_s = time.monotonic(), self._broke_s.get(topic, float("-inf"))
        self._broke_s[topic] = now_s
        self._too_large.pop(topic, None)
        if now_s - before_s < _FORGOTTEN_S:
            self._too_large[topic] = size
            self.leave_out(topic, f"the line broke 2 times while its {size} bytes were sent")
        return True

    def leave_out(self, topic: str, why: str) -> None:
        """Say, once, why the messages of a topic do not arrive."""
        if topic not in self._said:
            self._said.add(topic)
            self._say(f"{topic} is left out: {why}")

    def in_flight(self) -> list[tuple[str, int, Callable[[], bool]]]:
        """Return topic, size and `is_done` of what is not yet confirmed."""
        self._flying = [each for each in self._flying if not each[2]()]
        return self._flying


def _size_of(message: Publication) -> int:
    texts = (message.topic, message.payload)
    return sum(len(t.encode() if isinstance(t, str) else t) for t in texts) + _HEAD


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """Address of the broker, and the client's names there."""

    host: str
    port: int
    is_tls: bool
    client_id: str
    username: str | None


@dataclass(eq=False)
class MqttLink:
    """Keep a connection; raises ConfigError if the password or a certificate cannot be read.

    No callable may wait. While `is_alive` says that the publishing thread does not run, the
    connection is closed without DISCONNECT, so that the broker publishes the last will: the state
    would be stale.
    """

    broker: Broker
    options: MqttSection
    backoff: Backoff
    will: Publication | None  # what the broker publishes when the connection is lost
    subscriptions: list[str]  # topic filters, with QoS 1
    on_up: Callable[[], None]  # it is connected and subscribed
    on_down: Callable[[str], None]  # it is not, for a reason
    on_message: Callable[[str, bytes, bool], None]  # topic, payload, whether it was retained
    is_alive: Callable[[], bool]
    say: Callable[[str], None] = lambda _text: None  # which messages the broker does not take

    def __post_init__(self) -> None:
        self._limits = PacketLimits(self.say)
        self._is_5 = True
        self._is_unanswered = False
        self._client: paho.Client | None = None
        self._refused: dict[int, str] = {}
        self._halt = threading.Event()
        self._lost = threading.Event()
        self._reason = self._last_reason = ""
        self._new_client()
        self._thread = threading.Thread(target=self._run, name="mqtt link", daemon=True)

    def start(self) -> None:
        """Start the thread, which connects."""
        self._thread.start()

    @property
    def is_up(self) -> bool:
        """Whether there is a connection."""
        return self._client is not None

    @property
    def is_idle(self) -> bool:
        """Whether there is a connection, and everything that was sent is confirmed."""
        return self.is_up and not self._limits.in_flight()

    def publish(self, message: Publication) -> bool:
        """Publish without waiting, from one thread; return False if that cannot be done now."""
        client = self._client
        if client is None:
            return False
        if not self._limits.takes(message):
            return True
        if message.qos == 0 and len(self._limits.in_flight()) >= _MAX_UNSENT:
            return False
        info = self._publish(client, message)
        self._limits.sent(message, partial(self._is_settled, message.topic, info))
        return info.rc == MQTTErrorCode.MQTT_ERR_SUCCESS

    def publish_confirmed(self, message: Publication) -> None:
        """Publish and wait for the broker's confirmation; raises DeliveryError without it."""
        client = self._client
        if client is None:
            raise DeliveryError(self._last_reason or "not connected yet")
        if not self._limits.takes(message):
            msg = f"larger than the {self._limits.max_bytes} bytes that the broker takes"
            raise DeliveryError(msg, is_refusal=True)
        end_s = time.monotonic() + _CONFIRM_S
        try:
            info = self._publish(client, message)
            self._limits.sent(message, partial(_is_over, info))
            while not info.is_published():
                if client is not self._client:
                    raise DeliveryError(self._reason or "connection lost")
                if time.monotonic() > end_s:
                    # A new connection shows whether the broker still answers.
                    self._lose(client, f"no confirmation within {_CONFIRM_S:g} s")
                    raise DeliveryError(self._reason)
                info.wait_for_publish(_POLL_S)
            if why := self._refused.pop(info.mid, ""):
                raise DeliveryError(f"the broker refuses it: {why}", is_refusal=True)
        except (RuntimeError, ValueError) as err:
            raise DeliveryError(f"not published: {err}") from err

    def close(self, timeout_s: float) -> None:
        """Disconnect; if there is time for it, without the last will."""
        self._halt.set()
        client = self._client
        if client is not None:
            client.disconnect()
            self._lost.wait(timeout_s)
        self._lost.set()
        if self._thread.ident is not None:
            self._thread.join(min(timeout_s, _SHORT_S))

    def _run(self) -> None:
        while not self._halt.is_set():
            if not self.is_alive():
                self._halt.wait(_POLL_S)
                continue
            began_s = time.monotonic()
            was_up = self._connect_once()
            is_to_blame = self._limits.broke()
            if self._halt.is_set():
                return
            if self._is_unanswered:
                # A broker that knows MQTT 3.1.1 alone does not answer to 5.
                self._is_5 = not self._is_5
                if not self._is_5:
                    continue
            is_short = time.monotonic() - began_s < _SHORT_S and self.is_alive()
            # A rival that waits for long would else be met ever more often.
            if was_up and not is_to_blame and (is_short or "Session taken over" in self._reason):
                self._reason += f"; is another client called '{self.broker.client_id}'?"
            elif was_up:
                self.backoff.reset()
            self._last_reason = self._reason
            self.on_down(self._reason)
            self._halt.wait(self.backoff.next_s())

    def _connect_once(self) -> bool:
        """Connect, and wait until the connection is lost; return whether there was one."""
        self._lost.clear()
        self._reason, self._is_unanswered = "", False
        client: paho.Client | None = None
        try:
            client = self._new_client()
            client.connect(self.broker.host, self.broker.port, self.options.keepalive_s)
            self._is_unanswered = True
            client.loop_start()
            end_s = time.monotonic() + self.options.keepalive_s  # an answer must come within it
            while not self._lost.wait(_POLL_S):
                if self._client is None and time.monotonic() > end_s:
                    self._lose(client, _NO_ANSWER)
                if not self.is_alive():
                    self._lose(client, "the output's own thread stands still")
        except (OSError, ValueError, ConfigError) as err:
            self._reason = f"cannot connect: {explain(err)}"
        was_up, self._client = self._client is not None, None
        if client is not None:
            if self.is_alive():
                # Without it the broker publishes the last will.
                client.disconnect()
            if isinstance(sock := client.socket(), socket.socket):
                with contextlib.suppress(OSError):
                    sock.shutdown(socket.SHUT_RDWR)
            client.loop_stop()
        return was_up

    def _lose(self, client: paho.Client, reason: str) -> None:
        if client is self._client or self._client is None:
            self._reason = self._reason or reason
            self._lost.set()

    def _new_client(self) -> paho.Client:
        o, broker = self.options, self.broker
        client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=broker.client_id,
            clean_session=None if self._is_5 else True,
            protocol=paho.MQTTv5 if self._is_5 else paho.MQTTv311,
            reconnect_on_failure=False,
        )
        password = read_secret("mqtt.password", o.password_file, o.password_env)
        if broker.username is not None:
            client.username_pw_set(broker.username, password)
        elif password is not None:
            raise ConfigError("mqtt.username: a password needs one; give it here or in the URL")
        if broker.is_tls:
            context = client_context("mqtt", o.ca_file, o.cert_file, o.key_file)
            context.check_hostname = o.check_hostname
            client.tls_set_context(context)
        if (will := self.will) is not None:
            client.will_set(will.topic, will.payload, will.qos, self._limits.can_retain)
        client.on_connect = self._connected
        client.on_publish = self._answered
        client.on_subscribe = self._subscribed
        client.on_disconnect = self._disconnected
        client.on_message = lambda _client, _data, message: self.on_message(
            message.topic, bytes(message.payload), message.retain
        )
        return client

    def _connected(self, client: paho.Client, _d: Any, _f: Any, code: ReasonCode, p: Any) -> None:
        if str(code) == "Unsupported protocol version" and self._is_5:
            self._lose(client, _NO_ANSWER)
            return
        self._is_unanswered = False
        self._limits.max_bytes = getattr(p, "MaximumPacketSize", None)
        if code.is_failure:
            # It says so of the last will: the next connection's is one that it takes.
            self._limits.can_retain &= str(code) != "Retain not supported"
            self._lose(client, f"the broker refuses: {code}")
            return
        self._limits.can_retain = bool(getattr(p, "RetainAvailable", 1))
        self._refused.clear()
        if self.subscriptions:
            client.subscribe([(topic, 1) for topic in self.subscriptions])
        self._client = client
        self.on_up()

    def _disconnected(
        self, client: paho.Client, _d: Any, _f: Any, code: ReasonCode, _p: Any
    ) -> None:
        lost = "connection lost" if str(code) == "Unspecified error" else f"lost: {code}"
        self._lose(client, lost if client is self._client else _NO_ANSWER)

    def _answered(self, _client: Any, _d: Any, mid: int, code: ReasonCode, _p: Any) -> None:
        if code.is_failure:
            self._refused[mid] = str(code)

    def _subscribed(self, _c: Any, _d: Any, _mid: int, codes: list[ReasonCode], _p: Any) -> None:
        for topic, code in zip(self.subscriptions, codes, strict=False):
            if code.is_failure:
                self._limits.leave_out(topic, f"the broker lets nobody listen there: {code}")

    def _is_settled(self, topic: str, info: paho.MQTTMessageInfo) -> bool:
        """Return whether a message is in flight no more; say so if it was refused."""
        is_over = _is_over(info)
        if is_over and (why := self._refused.pop(info.mid, "")):
            self._limits.leave_out(topic, f"the broker refuses it: {why}")
        return is_over

    def _publish(self, client: paho.Client, message: Publication) -> paho.MQTTMessageInfo:
        is_kept = message.is_retained and self._limits.can_retain
        return client.publish(message.topic, message.payload, message.qos, is_kept)


def _is_over(info: paho.MQTTMessageInfo) -> bool:
    """Return whether a message is in flight no more: confirmed, or never sent."""
    try:
        return bool(info.is_published())
    except (RuntimeError, ValueError):
        # So it says of one for which there was no connection, or no room.
        return True
