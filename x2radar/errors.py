"""Every error the driver raises on purpose; any other that leaves this package is a bug."""

_MAX_CHARACTERS = 2000
"""Of a message. What a damaged file says of itself may be longer than a log can take."""


class BriefError(Exception):
    """An error whose message stays short, whatever it quotes; its middle is left out."""

    def __init__(self, message: str = "") -> None:
        if len(message) > _MAX_CHARACTERS:
            message = f"{message[: _MAX_CHARACTERS - 505]} ... {message[-500:]}"
        super().__init__(message)


class X2RadarError(BriefError):
    """Base of all errors raised on purpose; `exit_code` is what a command ends with."""

    exit_code = 1


class SettingsError(X2RadarError, ValueError):
    """A setting that the module cannot take; the message names every faulty field."""

    exit_code = 2


class PortUrlError(SettingsError):
    """A port's URL that nothing can be behind; the message says what it must be."""

    exit_code = 78


class PortError(X2RadarError):
    """A port cannot be opened."""

    exit_code = 66


class PortNotFound(PortError):
    """There is no port of that name."""


class PortDenied(PortError):
    """The port exists, but this user may not open it."""

    exit_code = 77


class PortBusy(PortError):
    """The port is locked by another program."""


class NoPort(PortError):
    """What is there is no serial port, and will not become one: nobody waits for it."""


class TransportClosed(X2RadarError):
    """The far end or the port itself went away while it was open."""

    exit_code = 3


class ReadTimeout(X2RadarError, TimeoutError):
    """Nothing arrived within the deadline."""

    exit_code = 3


class ProtocolError(X2RadarError):
    """Bytes that break the wire format."""


class MessageError(ProtocolError):
    """A packet with a good checksum whose content cannot be read."""


class DeviceError(X2RadarError):
    """The module refused a command, or did not answer it."""


class SafeModeError(DeviceError):
    """The module is in fail-safe mode (protocol: 10 crashes in 5 minutes)."""


class RestartRequired(DeviceError):
    """The module wants a reset before it takes the command (error 0x22)."""


class RecordingError(X2RadarError):
    """A recording is missing, unreadable or not a recording."""

    exit_code = 66


class WriteError(RecordingError):
    """The disk does not take a file."""

    exit_code = 1
    why = ""

    @classmethod
    def of(cls, path: object, why: object) -> "WriteError":
        """Return what to say of a file that could not be written; `why` is an error or a text."""
        text = (why.strerror if isinstance(why, OSError) else None) or str(why)
        error = cls(f"{path}: cannot write: {' '.join(text.split())}")
        error.why = text
        return error


class SceneError(X2RadarError):
    """A scene does not exist, or its file names something impossible."""

    exit_code = 66


class PluginError(X2RadarError):
    """A plug-in that cannot be loaded or does not keep its contract; the message names it."""

    exit_code = 78


class MissingExtra(X2RadarError):
    """A package that only one purpose needs is not installed; the message names its extra."""
