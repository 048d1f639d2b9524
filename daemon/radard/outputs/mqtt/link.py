"""MqttLink: one connection to a broker, made again whenever it is lost.

Every connection is a new client of the library with a clean session: what must survive is in
the log, and nothing else may be sent a second time.

A broker that takes no packet of some size drops the line, and says nothing: then the largest
message in flight is to blame, and after the second time no large one of its topic is sent.
"""

import contextlib
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
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
_MAX_UNSENT = 50  # messages of QoS 0: a minute of decisions
_STANDS_STILL = "the output's own thread stands still"
_NO_ANSWER = "no answer; is it an MQTT broker?"
_MIN_LARGE = 1024  # no broker limits packets to less; events and states are below it
_BREAKS = 2  # one may have had another cause


@dataclass(frozen=True, slots=True)
class Publication:
    """A message to publish, with its topic and quality of service."""

    topic: str
    payload: str | bytes
    qos: int = 1
    is_retained: bool = True

    @property
    def size(self) -> int:
        """Bytes of topic and payload."""
        payload = self.payload
        n = len(payload.encode() if isinstance(payload, str) else payload)
        return len(self.topic.encode()) + n


@dataclass(frozen=True, slots=True, kw_only=True)
class Broker:
    """Address of the broker, and the client's names there."""

    host: str
    port: int
    is_tls: bool
    client_id: str
    username: str | None


class MqttLink:
    """Keep a connection; raises ConfigError if the password or a certificate cannot be read.

    `will` is what the broker publishes when the connection is lost, `subscriptions` are topic
    filters, with QoS 1. Callables, none of which may wait: `on_up` when connected and subscribed,
    `on_down` with a reason when not, `on_message` with topic, payload and whether it was retained,
    `say` with which messages the broker does not take. `is_alive` says whether the publishing
    thread still runs; if not, the connection is closed without DISCONNECT, so that the broker
    publishes the last will: the state would be stale.
    """

    def __init__(
        self,
        broker: Broker,
        options: MqttSection,
        backoff: Backoff,
        *,
        will: Publication | None,
        subscriptions: list[str],
        on_up: Callable[[], None],
        on_down: Callable[[str], None],
        on_message: Callable[[str, bytes, bool], None],
        is_alive: Callable[[], bool],
        say: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._broker = broker
        self._options = options
        self._backoff = backoff
        self._will = will
        self._subscriptions = subscriptions
        self._on_up = on_up
        self._on_down = on_down
        self._on_message = on_message
        self._is_alive = is_alive
        self._say = say
        self._client: paho.Client | None = None
        self._flying: list[tuple[Publication, paho.MQTTMessageInfo]] = []
        self._breaks: Counter[str] = Counter()
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
        return self.is_up and not self._in_flight()

    def publish(self, message: Publication) -> bool:
        """Publish without waiting, from one thread; return False if that cannot be done now."""
        client = self._client
        if client is None:
            return False
        if self._is_left_out(message):
            return True
        n_unsent = sum(each.qos == 0 for each, _ in self._in_flight())
        if message.qos == 0 and n_unsent >= _MAX_UNSENT:
            return False
        return self._send(client, message).rc == MQTTErrorCode.MQTT_ERR_SUCCESS

    def publish_confirmed(self, message: Publication) -> None:
        """Publish and wait for the broker's confirmation; raises DeliveryError without it."""
        client = self._client
        if client is None:
            raise DeliveryError(self._last_reason or "not connected yet")
        if self._is_left_out(message):
            msg = f"larger than the broker takes: {message.size} bytes"
            raise DeliveryError(msg, is_refusal=True)
        end_s = time.monotonic() + _CONFIRM_S
        try:
            info = self._send(client, message)
            while not info.is_published():
                if client is not self._client:
                    raise DeliveryError(self._reason or "connection lost")
                if time.monotonic() > end_s:
                    # A new connection shows whether the broker still answers.
                    self._lose(client, f"no confirmation within {_CONFIRM_S:g} s")
                    raise DeliveryError(self._reason)
                info.wait_for_publish(_POLL_S)
        except (RuntimeError, ValueError) as err:
            msg = f"not published: {err}"
            raise DeliveryError(msg) from err

    def close(self, timeout_s: float) -> None:
        """Disconnect; if there is time for it, without the last will."""
        self._halt.set()
        client = self._client
        if client is not None:
            client.disconnect()
        self._lost.wait(timeout_s if client is not None else 0.0)
        self._lost.set()
        if self._thread.ident is not None:
            self._thread.join(min(timeout_s, _SHORT_S))

    def _run(self) -> None:
        while not self._halt.is_set():
            if not self._is_alive():
                self._halt.wait(_POLL_S)
                continue
            began_s = time.monotonic()
            was_up = self._connect_once()
            is_to_blame = self._blame()
            if self._halt.is_set():
                return
            is_short = time.monotonic() - began_s < _SHORT_S and self._is_alive()
            if was_up and not is_to_blame and is_short:
                self._reason += f"; is another client called '{self._broker.client_id}'?"
            elif was_up:
                self._backoff.reset()
            self._last_reason = self._reason
            self._on_down(self._reason)
            self._halt.wait(self._backoff.next_s())

    def _connect_once(self) -> bool:
        """Connect, and wait until the connection is lost; return whether there was one."""
        self._lost.clear()
        self._reason = ""
        client: paho.Client | None = None
        try:
            client = self._new_client()
            client.connect(self._broker.host, self._broker.port, self._options.keepalive_s)
            client.loop_start()
            self._wait(client)
        except (OSError, ValueError, ConfigError) as err:
            self._reason = f"cannot connect: {explain(err)}"
        was_up, self._client = self._client is not None, None
        if client is not None:
            _end(client, is_clean=self._is_alive())
        return was_up

    def _send(self, client: paho.Client, message: Publication) -> paho.MQTTMessageInfo:
        payload = message.payload
        payload = payload.encode() if isinstance(payload, str) else payload
        info = client.publish(message.topic, payload, message.qos, message.is_retained)
        self._flying.append((message, info))
        return info

    def _in_flight(self) -> list[tuple[Publication, paho.MQTTMessageInfo]]:
        self._flying = flying = [each for each in self._flying if not _is_over(each[1])]
        return flying

    def _is_left_out(self, message: Publication) -> bool:
        return self._breaks[message.topic] >= _BREAKS and message.size >= _MIN_LARGE

    def _blame(self) -> bool:
        """Note that the line broke; return whether a message is to blame."""
        flying, self._flying = [each for each, _ in self._in_flight()], []
        largest = max(flying, key=lambda each: each.size, default=None)
        if largest is None or largest.size < _MIN_LARGE:
            return False
        self._breaks[largest.topic] += 1
        if (n := self._breaks[largest.topic]) == _BREAKS:
            why = f"the line broke {n} times while its {largest.size} bytes were sent"
            self._say(f"{largest.topic} is left out: {why}")
        return True

    def _wait(self, client: paho.Client) -> None:
        """Wait until the connection is lost; an answer must come within the keep-alive."""
        end_s = time.monotonic() + self._options.keepalive_s
        while not self._lost.wait(_POLL_S):
            if self._client is None and time.monotonic() > end_s:
                self._lose(client, _NO_ANSWER)
            if not self._is_alive():
                self._lose(client, _STANDS_STILL)

    def _lose(self, client: paho.Client, reason: str) -> None:
        if client is self._client or self._client is None:
            self._reason = self._reason or reason
            self._lost.set()

    def _new_client(self) -> paho.Client:
        o, broker = self._options, self._broker
        client = paho.Client(
            CallbackAPIVersion.VERSION2,
            client_id=broker.client_id,
            clean_session=True,
            reconnect_on_failure=False,
        )
        password = read_secret("mqtt.password", o.password_file, o.password_env)
        if broker.username is not None:
            client.username_pw_set(broker.username, password)
        elif password is not None:
            msg = "mqtt.username: a password needs one; give it here or in the URL"
            raise ConfigError(msg)
        if broker.is_tls:
            context = client_context("mqtt", o.ca_file, o.cert_file, o.key_file)
            context.check_hostname = o.check_hostname
            client.tls_set_context(context)
        if (will := self._will) is not None:
            client.will_set(will.topic, will.payload, will.qos, retain=True)
        client.on_connect = self._connected
        client.on_disconnect = self._disconnected
        client.on_message = self._received
        return client

    def _connected(self, client: paho.Client, _d: Any, _f: Any, code: ReasonCode, _p: Any) -> None:
        if code.is_failure:
            self._lose(client, f"the broker refuses: {code}")
            return
        if self._subscriptions:
            client.subscribe([(topic, 1) for topic in self._subscriptions])
        self._client = client
        self._on_up()

    def _disconnected(
        self, client: paho.Client, _d: Any, _f: Any, code: ReasonCode, _p: Any
    ) -> None:
        lost = "connection lost" if str(code) == "Unspecified error" else f"lost: {code}"
        self._lose(client, lost if client is self._client else _NO_ANSWER)

    def _received(self, _client: paho.Client, _data: Any, message: paho.MQTTMessage) -> None:
        self._on_message(message.topic, bytes(message.payload), message.retain)


def _is_over(info: paho.MQTTMessageInfo) -> bool:
    """Return whether a message is in flight no more: confirmed, or never sent."""
    try:
        return bool(info.is_published())
    except (RuntimeError, ValueError):
        # So it says of one for which there was no connection, or no room.
        return True


def _end(client: paho.Client, *, is_clean: bool) -> None:
    """End a client's thread; without `is_clean` the broker publishes the last will."""
    if is_clean:
        client.disconnect()
    sock = client.socket()
    if isinstance(sock, socket.socket):
        with contextlib.suppress(OSError):
            sock.shutdown(socket.SHUT_RDWR)
    client.loop_stop()
