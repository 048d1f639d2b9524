"""X2Radar: bring a module from reset to streaming, and hand out its frames.

Start-up follows what real clients do (protocol notes, section 4): reset, wait for READY,
ping until ready when READY was missed, configure while nothing runs, then MANUAL mode.
A port on USB vanishes while the module restarts; it is closed in time and opened again.

The session matches replies, the transport moves bytes; this file owns deadlines and
retries, and the clock that they are measured with.
"""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType

from x2radar.assemble import FrameAssembler
from x2radar.errors import (
    DeviceError,
    PortError,
    ReadTimeout,
    RestartRequired,
    SafeModeError,
    TransportClosed,
)
from x2radar.frame import Frame, StreamInfo
from x2radar.messages import (
    Message,
    Ping,
    Pong,
    Reset,
    SetMode,
    SystemMessage,
)
from x2radar.protocol import Answered, Damaged, Received, Refused, Session
from x2radar.settings import RadarSettings
from x2radar.settings_x4 import ModuleSettings
from x2radar.startup import startup_commands
from x2radar.transport import SerialTransport, Transport
from x2radar.wire_ids import (
    ErrorCode,
    Mode,
    PongCode,
    SystemCode,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Deadlines:
    """How long the driver waits, in seconds.

    Attributes
    ----------
    reply_s : float
        For the reply to one command (ModuleConnector waits 2 s).
    ready_s : float
        From reset to ready; a module on USB re-enumerates in between.
    ping_every_s : float
        Pause after which a module that should be ready is asked again.
    usb_gone_s : float
        After a reset was acknowledged, until a port on USB is opened again: the module
        acknowledges first and restarts half a second later.
    stall_s : float
        Without a frame for so long, a stream counts as lost although the port is open.
    """

    reply_s: float = 2.0
    ready_s: float = 10.0
    ping_every_s: float = 0.25
    usb_gone_s: float = 0.7
    stall_s: float = 1.5


RETRIES = 3
_READ_S = 0.25


class X2Radar:
    """One module: open it, iterate over its frames, close it.

    Parameters
    ----------
    connect : callable
        Opens a new transport to the module; called again after a reset over USB.
    settings : RadarSettings or X4Settings, optional
        What to configure.
    deadlines : Deadlines, optional
        How long to wait.
    name : str
        What to call the module in messages.

    Examples
    --------
    >>> with X2Radar(lambda: SerialTransport("/dev/ttyACM0")) as radar:  # doctest: +SKIP
    ...     for frame in radar:
    ...         print(frame.index, frame.samples.shape)
    """

    def __init__(
        self,
        connect: Callable[[], Transport],
        settings: ModuleSettings | None = None,
        *,
        deadlines: Deadlines | None = None,
        name: str = "X2 module",
    ) -> None:
        self.settings: ModuleSettings = settings or RadarSettings()
        self.name = name
        self._connect = connect
        self._deadlines = deadlines or Deadlines()
        self._session = Session()
        self._transport: Transport | None = None
        self._assembler = FrameAssembler(self.settings)
        self._ready_frames: deque[Frame] = deque()
        self._heard_ready = False
        self.n_damaged = 0
        self.stream: StreamInfo | None = None

    def __enter__(self) -> "X2Radar":
        """Open the module; see `open`."""
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the module."""
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames; see `frames`."""
        return self.frames()

    def open(self) -> None:
        """Connect, reset, configure and start the stream.

        Raises
        ------
        PortError
            If the port cannot be opened.
        DeviceError
            If the module does not answer, refuses a setting, or is in safe mode.
        TransportClosed
            If the port goes away meanwhile.
        """
        self.close()
        self._session.reset()
        self._transport = self._connect()
        try:
            self._reset()
            self._configure()
        except BaseException:
            self._transport.close()
            self._transport = None
            raise

    def frames(self) -> Iterator[Frame]:
        """Yield frames as they arrive, for as long as the module sends them.

        Yields
        ------
        Frame
            In order; losses are stated in `Frame.lost` and `Frame.restarted`.

        Raises
        ------
        ReadTimeout
            If no frame came for `Deadlines.stall_s`.
        TransportClosed
            If the port went away.
        """
        last_s = time.monotonic()
        while True:
            while self._ready_frames:
                frame = self._ready_frames.popleft()
                if self.stream is None:
                    self.stream = StreamInfo(frame.axis, self.settings.frame_rate_hz, self.name)
                yield frame
                last_s = time.monotonic()
            self._pump(_READ_S)
            if not self._ready_frames and time.monotonic() - last_s > self._deadlines.stall_s:
                msg = f"{self.name}: no frame for {self._deadlines.stall_s:g} s"
                raise ReadTimeout(msg)

    def command(self, command: Message) -> Message:
        """Send one command and return its reply.

        Raises
        ------
        DeviceError
            If the module refuses, or does not answer in `Deadlines.reply_s`.
        """
        answer = self._ask(command, self._deadlines.reply_s)
        if answer is None:
            msg = f"{self.name}: no answer to {command}"
            raise DeviceError(msg)
        return answer

    def close(self) -> None:
        """Stop the module as far as it still listens, and close the port."""
        transport, self._transport = self._transport, None
        if transport is None:
            return
        try:
            self._session.give_up()
            self._session.send(SetMode(Mode.IDLE))
            transport.write(self._session.data_to_send())
        except TransportClosed:
            pass
        finally:
            transport.close()

    def _reset(self) -> None:
        self._heard_ready = False
        for _ in range(RETRIES):
            if self._ask(Reset(), self._deadlines.reply_s) is not None:
                break
        else:
            msg = f"{self.name}: no answer to a reset; is it an XeThru X2 module?"
            raise DeviceError(msg)
        if getattr(self._transport, "is_usb", False):
            self._reopen()
        self._wait_ready()

    def _reopen(self) -> None:
        assert self._transport is not None  # noqa: S101 - _reset runs on an open port
        self._transport.close()
        time.sleep(self._deadlines.usb_gone_s)
        give_up_s = time.monotonic() + self._deadlines.ready_s
        while True:
            try:
                self._transport = self._connect()
            except PortError:
                if time.monotonic() > give_up_s:
                    raise
                time.sleep(0.1)
            else:
                self._session.reset()
                return

    def _wait_ready(self) -> None:
        now_s = time.monotonic()
        give_up_s = now_s + self._deadlines.ready_s
        while now_s < give_up_s:
            ping_s = now_s + self._deadlines.ping_every_s
            while not self._heard_ready and (now_s := time.monotonic()) < ping_s:
                self._pump(ping_s - now_s)
            if self._heard_ready:
                return
            pong = self._ask(Ping(), self._deadlines.ping_every_s)
            if isinstance(pong, Pong):
                if pong.code == PongCode.READY:
                    return
                if pong.code == PongCode.SAFE_MODE:
                    msg = f"{self.name} is in fail-safe mode: power it off and on again"
                    raise SafeModeError(msg)
            now_s = time.monotonic()
        msg = f"{self.name}: not ready {self._deadlines.ready_s:g} s after a reset"
        raise DeviceError(msg)

    def _configure(self) -> None:
        *before, start = startup_commands(self.settings)
        for command in before:
            self.command(command)
        self._assembler = FrameAssembler(self.settings)
        self._ready_frames.clear()
        self.stream = None
        self.command(start)

    def _ask(self, command: Message, wait_s: float) -> Message | None:
        """Send `command`; return its reply, or None when none came in time."""
        self._session.give_up()
        self._session.send(command)
        deadline_s = time.monotonic() + wait_s
        while True:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                self._session.give_up()
                return None
            for answer in self._pump(min(left_s, _READ_S)):
                return answer.reply

    def _pump(self, wait_s: float) -> list[Answered]:
        """Move bytes once; keep frames, raise refusals, return the replies."""
        if self._transport is None:
            msg = f"{self.name} is not open"
            raise TransportClosed(msg)
        if out := self._session.data_to_send():
            self._transport.write(out)
        if data := self._transport.read(wait_s):
            self._session.receive(data)
        arrived_s = time.monotonic()
        answers: list[Answered] = []
        while (event := self._session.next_event()) is not None:
            if isinstance(event, Answered):
                if isinstance(event.command, Reset):
                    # A READY from before it says nothing about the restart.
                    self._heard_ready = False
                answers.append(event)
            else:
                self._take(event, arrived_s)
        return answers

    def _take(self, event: Received | Refused | Damaged, arrived_s: float) -> None:
        match event:
            case Refused(command, code):
                _refuse(self.name, command, code)
            case Damaged():
                self.n_damaged += 1
            case Received(SystemMessage(SystemCode.READY)):
                self._heard_ready = True
            case Received(message):
                frame = self._assembler.frame(message, arrived_s)
                if frame is not None:
                    self._ready_frames.append(frame)


def _refuse(name: str, command: Message, code: int) -> None:
    try:
        label = ErrorCode(code).name.lower().replace("_", " ")
    except ValueError:
        label = "unknown"
    msg = f"{name} refused {command}: error {code:#x} ({label})"
    if code == ErrorCode.RESTARTING:
        raise RestartRequired(msg)
    raise DeviceError(msg)


def open_serial(url: str, settings: ModuleSettings | None = None) -> X2Radar:
    """Return an open `X2Radar` on a serial port or pyserial URL."""
    radar = X2Radar(lambda: SerialTransport(url), settings, name=url)
    radar.open()
    return radar
