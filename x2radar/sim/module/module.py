"""The simulated module: the far end of the byte protocol, without I/O.

Feed it the host's bytes with `receive`, tell it the time with `advance`, and send what
`data_to_send` returns. It boots, answers, obeys settings and streams the echoes of a scene as a
real X2 would send them; it owns neither a port nor a clock.

Not simulated: profiles' own detections (respiration, sleep, presence), the UART's rate, the time
that it needs for a byte. Settings hold from the next start of the stream.
"""

from collections import deque

import numpy as np

from x2radar.errors import MessageError
from x2radar.modules.base import ModuleSettings
from x2radar.sim.module.faults import FaultPlan, Faults
from x2radar.sim.module.firmware import Firmware, X2Firmware
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import Scene
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.codec import decode_command, encode
from x2radar.wire.framing import Packet, PacketDecoder
from x2radar.wire.wire_ids import PING_SEED, ErrorCode, PongCode, SystemCode

RESET_DELAY_S = BOOT_S = 0.05  # a tenth of real modules': tests and demos start soon
MAX_LATE_S = 2.0  # a host that does not read for so long loses frames: a full buffer
_FOREVER_S = float("inf")
_NO_FRAME = np.zeros(1, np.float32)


class SimulatedModule:
    """A module in software, an X2 by default; same seed, same bytes."""

    def __init__(
        self,
        scene: Scene,
        seed: int = 0,
        faults: FaultPlan | None = None,
        *,
        firmware: Firmware | None = None,
    ) -> None:
        self._scene = scene
        self._seed = seed
        self._firmware: Firmware = firmware or X2Firmware()
        self._decoder = PacketDecoder()
        self._faults = Faults(faults or {}, seed)
        self._now_s = 0.0
        self._commands: deque[tuple[float, msg.Message]] = deque()
        self._resume: ModuleSettings | None = None
        self._reset_due_s = self._awake_due_s = _FOREVER_S
        self._ready_due_s = self._faults.not_ready_s or _FOREVER_S
        self._stop()

    @property
    def next_due_s(self) -> float:
        """Time of what the module does next by itself, in seconds; inf for nothing."""
        return min(self._own_due_s, self._faults.next_due_s)

    @property
    def _own_due_s(self) -> float:
        command_s = self._commands[0][0] if self._commands else _FOREVER_S
        return min(
            self._frame_due_s, self._reset_due_s, self._awake_due_s, self._ready_due_s, command_s
        )

    @property
    def has_hung_up(self) -> bool:
        """Whether the port must close now."""
        return self._now_s >= self._faults.hang_up_s

    @property
    def splits_output(self) -> bool:
        """Whether `data_to_send` gives pieces that the host is to read one by one."""
        return self._faults.max_piece > 0

    def receive(self, data: bytes) -> None:
        """Take bytes from the host and answer every whole packet in them."""
        for item in self._decoder.feed(data):
            # While it boots nobody listens; as the firmware's parser, it drops damaged packets.
            if self._awake_due_s < _FOREVER_S or not isinstance(item, Packet):
                continue
            try:
                command = decode_command(item.data)
            except MessageError:
                command = msg.Unknown(bytes(item.data))
            self._commands.append((self._now_s + self._faults.reply_delay_s, command))
            while self._commands and self._commands[0][0] <= self._now_s:
                self._obey()

    def advance(self, now_s: float) -> None:
        """Do what is due until `now_s` (module time, in seconds, never going back)."""
        until_s = max(self._now_s, now_s)
        while (at_s := self._own_due_s) <= until_s and at_s < _FOREVER_S:
            self._now_s = max(at_s, self._now_s)
            if at_s == self._reset_due_s:
                self._restart()
            elif at_s == self._awake_due_s:
                self._awake_due_s = _FOREVER_S
                self._ready_due_s = at_s + max(self._faults.not_ready_s - BOOT_S, 0.0)
            elif at_s == self._ready_due_s:
                self._be_ready()
            elif self._stream is not None and at_s == self._frame_due_s:
                self._next_frame(self._stream, until_s)
            else:
                self._obey()
        self._now_s = until_s

    def data_to_send(self) -> bytes:
        """Return bytes for the host, and forget them; call it until there are none."""
        return self._faults.due_bytes(self._now_s)

    def _restart(self) -> None:
        self._reset_due_s = self._ready_due_s = _FOREVER_S
        self._awake_due_s = self._now_s + BOOT_S
        self._decoder = PacketDecoder()
        self._commands.clear()
        self._stop()
        if self._resume is None:
            self._firmware.forget()
        self._send(msg.SystemMessage(SystemCode.BOOTING))

    def _be_ready(self) -> None:
        self._ready_due_s = _FOREVER_S
        if self._faults.announces_ready:
            self._send(msg.SystemMessage(SystemCode.READY))
        if self._resume is not None:
            # A module that was running loads what it ran and streams again by itself.
            self._start(self._resume)

    def _stop(self) -> None:
        self._stream: EchoStream | None = None
        self._counter = 0
        self._frame_due_s = _FOREVER_S

    def _start(self, settings: ModuleSettings) -> None:
        self._stream = EchoStream(self._scene, self._seed, settings)
        self._resume = None
        self._counter = 0
        self._frame_due_s = self._now_s

    def _next_frame(self, stream: EchoStream, until_s: float) -> None:
        samples = stream.next()
        given = _NO_FRAME if samples is None else samples
        frame, n_copies, restarts_counter, reboots = self._faults.frame(given)
        rate_hz = stream.settings.frame_rate_hz
        self._counter = 1 if restarts_counter else (self._counter + 1) & 0xFFFFFFFF
        due_s, self._frame_due_s = self._frame_due_s, self._frame_due_s + 1.0 / rate_hz
        if reboots:
            if self._reset_due_s == _FOREVER_S:
                self._resume = stream.settings
            self._stop()
            self._reset_due_s = self._now_s
        elif n_copies and samples is not None and until_s - due_s <= MAX_LATE_S:
            message = self._firmware.frame_message(stream.axis, self._counter, frame)
            self._send(message, n_copies, self._faults.frame_lateness_s(self._counter, rate_hz))

    def _send(self, message: msg.Message, n_copies: int = 1, late_s: float = 0.0) -> None:
        packet = framing.encode(encode(message))
        for _ in range(n_copies):
            self._faults.put(packet, self._now_s, late_s=late_s)

    def _obey(self) -> None:
        _, command = self._commands.popleft()
        is_ready = self._ready_due_s == _FOREVER_S
        refusal = self._faults.refusal(command, is_ready=is_ready)
        self._send(refusal or self._answer(command))

    def _answer(self, command: msg.Message) -> msg.Message:
        match command:
            case msg.Ping(seed) if seed == PING_SEED:
                return msg.Pong(PongCode.READY)
            case msg.Reset():
                # A host that resets configures again; only a reboot of its own resumes.
                self._resume = None
                self._reset_due_s = self._now_s + RESET_DELAY_S
                return msg.Ack()
            case _:
                done = self._firmware.obey(command)
        if done is None:
            return msg.ErrorReply(ErrorCode.NOT_RECOGNIZED)
        if done.stops:
            self._stop()
            self._resume = None
        if done.starts is not None:
            self._start(done.starts)
        return done.reply
