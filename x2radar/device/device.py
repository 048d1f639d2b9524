"""X2Radar: open a module, iterate over its frames, close it.

`bring_up` brings the module from reset to streaming and makes frames of what it sends, `link`
moves the bytes and repeats commands, `reconnect` opens a lost device again.
"""

import contextlib
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Self

from x2radar.device.bring_up import BringUp
from x2radar.device.link import READ_S, RETRIES, Deadlines, Link
from x2radar.device.transport import Transport
from x2radar.errors import DeviceError, ReadTimeout, TransportClosed
from x2radar.frame import Closing, CounterTracker, Frame, StreamInfo
from x2radar.modules.base import ModuleSettings, SettingsChooser
from x2radar.modules.x2 import RadarSettings
from x2radar.wire.messages import GetSystemInfo, Message, Reply, Reset, SetBaudRate, Unknown
from x2radar.wire.wire_ids import InfoItem

_ONCE = (Reset, SetBaudRate, Unknown)
"""Commands that must not be sent twice, or of which nobody knows whether they may."""
_STALL_FRAMES = 3
"""Frames that must be missing before a slow stream counts as lost: two may be late."""

_ASK_S = 0.5
"""For the order code: old firmware that does not know the question may stay silent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarStats:
    """What happened since the radar object was made, over all its openings."""

    frames: int = 0
    """Frames that arrived."""
    lost: int = 0
    """Frames that the module counted but that did not arrive."""
    repeated: int = 0
    """Frames that came twice; the second is dropped."""
    restarts: int = 0
    """Frames with `Frame.restarted`."""
    damaged: int = 0
    """Stretches of bytes that were dropped, and packets that could not be read."""
    retries: int = 0
    """Commands sent again: unanswered, or refused by a busy module."""
    reconnects: int = 0
    """Times that a lost device was opened again."""


class X2Radar(Closing):
    """One module; frames are read and commands sent from one thread, any may `close` it.

    `connect` opens a transport to the module, and is called again after a reset over USB.
    `settings` are what to configure, by default those of RadarSettings; a callable makes them of
    the order code that the module tells when it is first opened. `deadlines` say how long to wait,
    `name` what messages call the module; `run_id` is `StreamInfo.run_id`, by default one that no
    other run has.
    """

    def __init__(
        self,
        connect: Callable[[], Transport],
        settings: ModuleSettings | SettingsChooser | None = None,
        *,
        deadlines: Deadlines | None = None,
        name: str = "X2 module",
        run_id: str = "",
    ) -> None:
        self._choose = settings if callable(settings) else None
        known = settings if isinstance(settings, ModuleSettings) else RadarSettings()
        self.settings: ModuleSettings = known
        self.name = name
        self._run_id = run_id or uuid.uuid4().hex
        self.stream: StreamInfo | None = None
        """What holds for every frame; known with the first one."""
        self._connect = connect
        self._deadlines = deadlines or Deadlines()
        self._module: BringUp | None = None
        self._halt = threading.Event()
        self._halt_is_ours = True
        self._counter = CounterTracker()
        self._counts: Counter[str] = Counter()

    def __enter__(self) -> Self:
        """Open the module; see `open`."""
        self.open()
        return self

    def __iter__(self) -> Iterator[Frame]:
        """Iterate over `frames`."""
        return self.frames()

    @property
    def stats(self) -> RadarStats:
        """Counts up to now: a snapshot."""
        return RadarStats(**self._counts)

    def open(self, *, stream: bool = True, halt: threading.Event | None = None) -> None:
        """Connect, reset, configure and start the stream; frames count from 0.

        With `stream` False it only connects: the module is asked by `command`, and goes on with
        what it does. Once `halt` is set, by any thread, opening and stream end with
        TransportClosed.

        Raises PortError or TransportClosed if the port cannot be opened or goes away meanwhile,
        DeviceError if the module does not answer, refuses a setting, or is in safe mode.
        """
        self._counter = CounterTracker()
        self._open(halt, stream=stream)

    def reopen(self, *, halt: threading.Event | None = None) -> None:
        """Open again after a loss: frame numbers go on, and the first frame is marked.

        `halt` and the errors are those of `open`.
        """
        self._open(halt, stream=True)
        self._counts["reconnects"] += 1

    def frames(self) -> Iterator[Frame]:
        """Yield frames in order as they arrive, for as long as the module sends them.

        Losses are stated in `Frame.lost` and `Frame.restarted`. Raises ReadTimeout if no frame
        came for `Deadlines.stall_s`, TransportClosed if the port went away, DeviceError if the
        module restarted by itself and cannot be configured again.
        """
        rate_hz = float(self.settings.frame_rate_hz)
        stall_s = max(self._deadlines.stall_s, _STALL_FRAMES / rate_hz)
        last_s = time.monotonic()
        while True:
            module = self._opened()
            while module.waiting:
                frame = module.waiting.popleft()
                if self.stream is None:
                    self.stream = StreamInfo(frame.axis, rate_hz, self.name, self._run_id)
                yield frame
                last_s = time.monotonic()
            if module.has_restarted:
                module.start()
                last_s = time.monotonic()
            else:
                module.link.pump(READ_S)
            if not module.waiting and time.monotonic() - last_s > stall_s:
                raise ReadTimeout(f"{self.name}: no frame for {stall_s:g} s")

    def command(self, command: Message, *, wait_s: float | None = None) -> Message:
        """Send one command, any host message, and return its reply.

        It is sent again while the module is busy; and, where that does no harm, up to three times
        when no answer came within `wait_s` seconds (`Deadlines.reply_s` by default). Raises
        DeviceError if the module refuses or does not answer, TransportClosed if the port went
        away.
        """
        resends = 0 if isinstance(command, _ONCE) else RETRIES
        return self._opened().link.command(command, resends=resends, wait_s=wait_s)

    def identify(self) -> None:
        """Settle `settings` where they depend on what the module calls itself.

        Asks once, on a port opened for that, as `open` does otherwise; raises as `open`.
        """
        if self._choose is None:
            return
        self._module = module = self._bring_up()
        order_code = ""
        with contextlib.closing(module.link), contextlib.suppress(DeviceError):
            ask = GetSystemInfo(InfoItem.ORDER_CODE)
            answer = module.link.command(ask, resends=1, wait_s=_ASK_S)
            if isinstance(answer, Reply) and isinstance(answer.value, str):
                order_code = answer.value
        self._module = None
        self.settings, self._choose = self._choose(order_code), None

    def wrap_transport(self, wrap: Callable[[Transport], Transport]) -> None:
        """Put what `wrap` returns in the place of every transport, from the next opening on."""
        connect = self._connect
        self._connect = lambda: wrap(connect())

    def close(self) -> None:
        """Stop the module as far as it still listens, and close the port; from any thread."""
        if self._halt_is_ours:
            self._halt.set()
        module, self._module = self._module, None
        if module is not None:
            module.close()

    def _open(self, halt: threading.Event | None, *, stream: bool) -> None:
        self.close()
        self._halt = threading.Event() if halt is None else halt
        self._halt_is_ours = halt is None
        self.stream = None
        if stream:
            self.identify()
        self._module = module = self._bring_up()
        if not stream:
            return
        try:
            module.start()
        except BaseException:
            self._module = None
            module.link.close()
            raise

    def _bring_up(self) -> BringUp:
        # With the event of this opening, whatever becomes of the radar meanwhile.
        link = partial(
            Link, name=self.name, deadlines=self._deadlines, counts=self._counts, halt=self._halt
        )
        return BringUp(
            lambda listener: link(self._connect(), listener), self.settings, self._counter
        )

    def _opened(self) -> BringUp:
        if self._module is None:
            raise TransportClosed(f"{self.name} is not open")
        return self._module
