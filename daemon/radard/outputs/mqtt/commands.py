"""Commands that come over MQTT: what each topic takes, and the code that disarming may ask for.

::

    command/arm, arm-home, disarm, ack, calibrate    empty payload; disarm: the code, if one is set
    command/panel                                    what Home Assistant's alarm panel sends
    command/sensitivity                              low, normal or high

Who can publish here can disarm: a code is a second lock, for those who share a Home Assistant.
After five wrong ones in a row none is taken for a minute.
"""

import hmac
import time
from collections.abc import Callable
from dataclasses import dataclass

from radard.alarm.sensitivity import SENSITIVITIES
from radard.config.credentials import read_secret
from radard.config.sink_table import MqttSection
from radard.outputs.base import COMMANDS
from radard.outputs.mqtt.homeassistant import panel_command

_MAX_SHOWN = 40  # characters of a stranger's topic: a log line stays one
_MAX_WRONG = 5  # as keypads of panels have it
_LOCKED_S = 60.0  # a code of four digits then takes more than a day to guess


@dataclass(frozen=True, slots=True)
class MqttCommand:
    """A command, or with `sensitivity` that name alone."""

    name: str = ""
    sensitivity: str = ""


def code_of(options: MqttSection) -> str:
    """Return the code that disarming takes, empty without one; raises ConfigError."""
    return read_secret("mqtt.code", options.code_file, options.code_env) or ""


class CommandReader:
    """Read the messages of one sensor's command topics, below `base`."""

    def __init__(
        self, base: str, options: MqttSection, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._head = f"{base}/command"
        self._options = options
        self._now_s = now_s
        self._n_wrong = 0
        self._locked_until_s = float("-inf")

    @property
    def topics(self) -> str:
        """Topic filter of all commands."""
        return f"{self._head}/+"

    def read(self, topic: str, payload: bytes, *, is_retained: bool) -> MqttCommand | None:
        """Return what a message asks for; None on other topics.

        Raises ValueError if it is unknown, has a wrong payload or code, or was retained: a
        retained `disarm` would disarm at every reconnection. ConfigError if the code cannot be
        read.
        """
        head, _, name = topic.rpartition("/")
        if head != self._head:
            return None
        shown = repr(name[:_MAX_SHOWN])
        if is_retained:
            msg = f"command {shown} ignored: it was retained; remove it from the broker"
            raise ValueError(msg)
        if name == "sensitivity":
            return self._sensitivity(payload)
        code = ""
        if name == "panel":
            name, code = panel_command(payload)
        elif name not in COMMANDS:
            msg = f"no command {shown}; known are {', '.join(COMMANDS)}, panel, sensitivity"
            raise ValueError(msg)
        elif name == "disarm":
            code = payload.decode()
        elif payload:
            msg = f"command {shown} ignored: its payload must be empty"
            raise ValueError(msg)
        if name == "disarm":
            self._check_code(code)
        return MqttCommand(name=name)

    def _sensitivity(self, payload: bytes) -> MqttCommand:
        names = tuple(SENSITIVITIES["fused"])
        text = payload.decode()
        if text not in names:
            msg = f"command 'sensitivity' ignored: it is one of {', '.join(names)}"
            raise ValueError(msg)
        return MqttCommand(sensitivity=text)

    def _check_code(self, given: str) -> None:
        wanted = code_of(self._options)
        if not wanted:
            if given:
                msg = "command 'disarm' ignored: its payload must be empty, as no code is set"
                raise ValueError(msg)
            return
        if self._now_s() < self._locked_until_s:
            msg = "command 'disarm' ignored: too many wrong codes, wait a minute"
            raise ValueError(msg)
        if hmac.compare_digest(given.encode(), wanted.encode()):
            self._n_wrong = 0
            return
        self._n_wrong += 1
        if self._n_wrong >= _MAX_WRONG:
            self._n_wrong, self._locked_until_s = 0, self._now_s() + _LOCKED_S
        msg = "command 'disarm' ignored: a wrong code, or none"
        raise ValueError(msg)
