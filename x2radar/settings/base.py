"""What the settings of any module tell the driver."""

from collections.abc import Callable
from typing import Any, ClassVar, Protocol, Self

from x2radar.frame import Kind
from x2radar.wire.messages import Message


class ModuleSettings(Protocol):
    """Settings of one kind of module: a frozen dataclass, checked at construction.

    The numbers describe the frames that a module with these settings sends: its fast-time axis
    as in `x2radar.frame.FastTimeAxis`, lengths in metres, frequencies and rates in hertz.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""
        ...

    @property
    def kind(self) -> Kind:
        """What the stream's frames hold."""
        ...

    @property
    def raw_kind(self) -> Kind:
        """What raw frames hold, which carry no axis: RF, or half of them I and half Q."""
        ...

    @property
    def n_range(self) -> int:
        """Bins in one frame."""
        ...

    @property
    def bin_length_m(self) -> float:
        """Range of one bin."""
        ...

    @property
    def range_offset_m(self) -> float:
        """Range of bin 0."""
        ...

    @property
    def carrier_hz(self) -> float:
        """Centre frequency of the pulse."""
        ...

    @property
    def bandwidth_hz(self) -> float:
        """Bandwidth of the pulse at -10 dB."""
        ...

    @property
    def sample_rate_hz(self) -> float:
        """Rate of the RF sampler."""
        ...

    def startup_commands(self) -> tuple[Message, ...]:
        """Return what a freshly reset module is told, in order.

        Each is answered by ACK. The first stops what runs, the last starts the stream.
        """
        ...

    @classmethod
    def for_port(cls, rate_hz: float | None, kind: str | None) -> Self:
        """Return settings for the keys `rate` and `kind` ('rf', 'baseband') of a port string.

        Raises SettingsError if this module cannot do that; None is its default.
        """
        ...


SettingsChooser = Callable[[str], ModuleSettings]
"""Gives the settings for a module by its order code, which is empty when it tells none."""
