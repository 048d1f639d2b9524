"""What the settings of every module tell the driver."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from x2radar.frame import FastTimeAxis, Kind
from x2radar.keys import Checked
from x2radar.wire.messages import Message


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleSettings(Checked, ABC):
    """Settings of one kind of module; SettingsError at construction names all faults."""

    @property
    @abstractmethod
    def frame_rate_hz(self) -> float:
        """Frames that the module sends in a second."""

    @property
    @abstractmethod
    def axis(self) -> FastTimeAxis:
        """Axis of the frames that a module with these settings sends."""

    @property
    def raw_kind(self) -> Kind:
        """What raw frames hold, which carry no axis: RF, or half of them I and half Q."""
        return "rf"

    @abstractmethod
    def startup_commands(self) -> tuple[Message, ...]:
        """Return what a freshly reset module is told, in order; each is answered by ACK."""

    @classmethod
    @abstractmethod
    def for_port(cls, rate_hz: float | None, kind: str | None) -> Self:
        """Return settings for a port's `rate` and `kind`, or None; SettingsError if impossible."""


SettingsChooser = Callable[[str], ModuleSettings]  # by a module's order code, '' if it tells none
