"""The simulated module: the far end of the byte protocol, without I/O.

Feed it the host's bytes with `receive`, tell it the time with `advance`, and send what
`data_to_send` returns. It boots, answers, obeys settings and streams the echoes of a scene
as a real X2 would send them; it owns neither a port nor a clock.

Not simulated: profiles' own detections (respiration, sleep, presence), the UART's rate, the
time that a UART needs for a byte. Settings and output hold from the next start of the
stream; what is changed while it runs does not touch it.
"""

from collections import deque
from typing import Any

import numpy as np

from x2radar import framing
from x2radar.codec import decode_command, encode
from x2radar.errors import MessageError, SettingsError
from x2radar.frame import FastTimeAxis, Kind
from x2radar.framing import Packet, PacketDecoder
from x2radar.messages import (
    Ack,
    BasebandAp,
    BasebandIq,
    Data,
    ErrorReply,
    GetSystemInfo,
    LoadProfile,
    Message,
    Ping,
    Pong,
    Reply,
    Reset,
    SetBaudRate,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SetSysFloat,
    SetSysInt,
    SystemMessage,
    Unknown,
)
from x2radar.settings import RadarSettings
from x2radar.sim.faults import Dice, FaultPlan
from x2radar.sim.line import Line
from x2radar.sim.pulse import LinkBudget, baseband_echo, rf_echo
from x2radar.sim.receiver import MIDDLE, Receiver
from x2radar.sim.scene import Scene, SceneClock, StaticPoint
from x2radar.wire_ids import (
    PING_SEED,
    BasebandOutput,
    ContentId,
    ErrorCode,
    InfoItem,
    Mode,
    OutputRef,
    PongCode,
    Profile,
    SysCfg,
    SystemCode,
)

RESET_DELAY_S = 0.05
BOOT_S = 0.05
LATEST_S = 2.0
SPIKE = 900.0  # far beyond the 0 to 100 of a frame
_BLOCK = 16
_FOREVER_S = float("inf")

_INFO = {
    InfoItem.ITEM_NUMBER: "SIM-X2",
    InfoItem.ORDER_CODE: "X2M-SIM",
    InfoItem.FIRMWARE_ID: "x2radar simulated module",
    InfoItem.VERSION: "1.0.0",
    InfoItem.BUILD: "0",
    InfoItem.SERIAL_NUMBER: "000000000000",
}
_SYS_FIELDS = {
    SysCfg.PULSES_PER_STEP: "pulses_per_step",
    SysCfg.ITERATIONS: "iterations",
    SysCfg.DAC_STEP: "dac_step",
    SysCfg.DAC_MIN: "dac_min",
    SysCfg.DAC_MAX: "dac_max",
    SysCfg.PG_SELECT: "pulse_generator",
    SysCfg.FPS: "frame_rate_hz",
    SysCfg.FRAME_STITCH: "frame_stitch",
    SysCfg.SAMPLE_DELAY: "sample_delay_s",
}
# Amplitude or phase alone make no frame and are refused.
_OUTPUTS: dict[int, str] = {
    BasebandOutput.OFF: "rf",
    BasebandOutput.IQ: "iq",
    BasebandOutput.AMPLITUDE_PHASE: "ap",
}


class EchoStream:
    """Frames of a scene as the receiver sees them, one after another.

    Parameters
    ----------
    scene : Scene
        What is in front of the radar.
    seed : int
        Draws and noise follow from it.
    settings : RadarSettings
        As the host configured them.
    """

    def __init__(self, scene: Scene, seed: int, settings: RadarSettings) -> None:
        kind: Kind = "rf" if settings.output == "rf" else "baseband"
        self.settings = settings
        self.axis = FastTimeAxis(
            kind=kind,
            n_range=settings.n_range,
            bin_length_m=settings.bin_length_m,
            range_offset_m=settings.range_offset_m,
            carrier_hz=settings.carrier_hz,
            bandwidth_hz=settings.bandwidth_hz,
            sample_rate_hz=settings.sample_rate_hz,
        )
        self._budget = LinkBudget()
        rng = np.random.default_rng([seed, 0x4E01])
        self._receiver = Receiver(settings, self.axis, self._budget, rng)
        self._clock = SceneClock(scene, seed, settings.frame_rate_hz)
        self._static = self._static_echo(scene.clutter)
        self._block: deque[np.ndarray] = deque()

    def next(self) -> np.ndarray:
        """Return the next frame: shape (n_range,), float32 RF or complex64 baseband."""
        if not self._block:
            block = self._clock.next_block(_BLOCK)
            amplitude = self._budget.amplitude(block.range_m, block.rcs_m2, self.axis)
            if self.axis.kind == "rf":
                frames = rf_echo(block.range_m, amplitude, self.axis)
                frames += self._static
                self._block.extend(self._receiver.rf(frames))
            else:
                echo = baseband_echo(block.range_m, amplitude, self.axis) + self._static
                self._block.extend(self._receiver.baseband(echo))
        return self._block.popleft()

    def _static_echo(self, points: tuple[StaticPoint, ...]) -> np.ndarray:
        range_m = np.array([[p.range_m for p in points]])
        amplitude = self._budget.amplitude(
            range_m, np.array([p.rcs_m2 for p in points]), self.axis
        )
        echo = rf_echo if self.axis.kind == "rf" else baseband_echo
        return np.asarray(echo(range_m, amplitude, self.axis)[0])


class SimulatedModule:
    """An X2 module in software.

    Parameters
    ----------
    scene : Scene
        What it looks at; it starts from the beginning whenever the stream starts.
    seed : int
        Same seed, same bytes.
    faults : FaultPlan, optional
        How it misbehaves.
    """

    def __init__(self, scene: Scene, seed: int = 0, faults: FaultPlan | None = None) -> None:
        self._scene = scene
        self._seed = seed
        self._decoder = PacketDecoder()
        self._plan = faults or FaultPlan()
        self._dice = Dice(self._plan, seed)
        self._line = Line(self._plan, self._dice)
        self._now_s = 0.0
        self._booted_s = 0.0
        self._resume: RadarSettings | None = None
        self._reset_due_s = _FOREVER_S
        self._ready_due_s = _FOREVER_S
        self._frame_due_s = _FOREVER_S
        self.n_skipped = 0
        self._power_up()

    def _power_up(self) -> None:
        self._fields: dict[str, float] = {}
        self._output = _OUTPUTS[BasebandOutput.OFF]
        self._booted = True
        self._stream: EchoStream | None = None
        self._counter = 0
        self._frame_due_s = self._streaming_since_s = _FOREVER_S

    @property
    def next_due_s(self) -> float:
        """Time of what the module does next by itself, in seconds; inf for nothing."""
        own_s = min(self._reset_due_s, self._ready_due_s, self._frame_due_s)
        return min(own_s, self._line.next_due_s)

    @property
    def has_hung_up(self) -> bool:
        """Whether the port must close now."""
        return self._has_streamed_for("hang_up")

    @property
    def is_streaming(self) -> bool:
        """Whether frames are being sent."""
        return self._stream is not None

    def receive(self, data: bytes) -> None:
        """Take bytes from the host and answer every whole packet in them."""
        for item in self._decoder.feed(data):
            if not self._booted:
                continue
            if not isinstance(item, Packet):
                # As the firmware's parser: damaged packets are dropped without an answer.
                continue
            try:
                command = decode_command(item.data)
            except MessageError:
                command = Unknown(item.data)
            reply = self._refusal(command) or self._answer(command)
            self._send(reply, late_s=self._plan.value("slow_ack"))

    def advance(self, now_s: float) -> None:
        """Do what is due until `now_s` (module time, in seconds, never going back).

        A module whose host does not read for more than `LATEST_S` loses frames, as a real
        one does: its counter goes on.
        """
        self._now_s = max(self._now_s, now_s)
        if self._reset_due_s <= self._now_s:
            self._power_up()
            self._booted = False
            self._reset_due_s, self._ready_due_s = _FOREVER_S, self._reset_due_s + BOOT_S
            self._send(SystemMessage(SystemCode.BOOTING))
        if self._ready_due_s <= self._now_s:
            self._booted, self._booted_s = True, self._ready_due_s
            self._ready_due_s = _FOREVER_S
            if not (self._plan.value("not_ready") or self._plan.value("safe_mode")):
                self._send(SystemMessage(SystemCode.READY))
            if self._resume is not None:
                # A module that was running loads what it ran and streams again by itself.
                self._start(self._resume)
        while self._stream is not None and self._frame_due_s <= self._now_s:
            self._next_frame(self._stream)

    def data_to_send(self) -> bytes:
        """Return the bytes that go to the host now, and forget them.

        Call it until it returns nothing: a faulty line gives its output in pieces.
        """
        data = self._line.take(self._now_s)
        if not self._plan.value("split"):
            while piece := self._line.take(self._now_s):
                data += piece
        return data

    def _next_frame(self, stream: EchoStream) -> None:
        frame = stream.next()
        rate_hz = stream.settings.frame_rate_hz
        due_s, self._frame_due_s = self._frame_due_s, self._frame_due_s + 1.0 / rate_hz
        self._counter = (self._counter + 1) & 0xFFFFFFFF
        if self._dice.falls("counter_restart"):
            self._counter = 1
        if self._dice.falls("reboot"):
            self._resume = stream.settings
            self._stream = None
            self._frame_due_s, self._reset_due_s = _FOREVER_S, due_s
            return
        if self._now_s - due_s > LATEST_S:
            self.n_skipped += 1
            return
        if self._dice.falls("drop_frames"):
            return
        message = self._frame_message(stream, self._as_converted(frame))
        late_s = self._line.frame_lateness_s(self._counter, rate_hz)
        for _ in range(1 + self._dice.falls("duplicate")):
            self._send(message, late_s=late_s)

    def _as_converted(self, frame: np.ndarray) -> np.ndarray:
        """Put in what a misbehaving converter does to a frame."""
        if level := self._plan.value("clip"):
            middle = MIDDLE if frame.dtype == np.float32 else 0.0
            reach = np.float32(level * MIDDLE)
            parts = np.clip(frame.view(np.float32) - middle, -reach, reach) + np.float32(middle)
            frame = parts.view(frame.dtype)
        if self._dice.falls("spike"):
            rng = self._dice.generator("spike")
            frame = frame.copy()
            frame[rng.integers(0, frame.size, 3)] += np.float32(SPIKE)
        return frame

    def _has_streamed_for(self, kind: str) -> bool:
        limit_s = self._plan.value(kind)
        return limit_s > 0 and self._now_s - self._streaming_since_s >= limit_s

    def _send(self, message: Message, *, late_s: float = 0.0) -> None:
        if not self._has_streamed_for("silent"):
            self._line.put(framing.encode(encode(message)), self._now_s, late_s=late_s)

    def _refusal(self, command: Message) -> Message | None:
        """Return what a module in trouble answers, or None when it obeys."""
        if self._plan.value("safe_mode"):
            if isinstance(command, Ping):
                return Pong(PongCode.SAFE_MODE)
            return None if isinstance(command, Reset) else ErrorReply(ErrorCode.COMMAND_FAILED)
        if isinstance(command, Ping):
            is_ready = self._now_s - self._booted_s >= self._plan.value("not_ready")
            return None if is_ready else Pong(PongCode.NOT_READY)
        if self._dice.falls("error_reply"):
            return ErrorReply(ErrorCode.COMMAND_FAILED)
        return None

    def _answer(self, command: Message) -> Message:
        match command:
            case Ping(seed) if seed == PING_SEED:
                return Pong(PongCode.READY)
            case Reset():
                # A host that resets configures anew; only a reboot of its own resumes.
                self._resume = None
                self._reset_due_s = self._now_s + RESET_DELAY_S
                return Ack()
            case SetMode(mode):
                return self._set_mode(mode)
            case SetSysInt(ref, value) | SetSysFloat(ref, value):
                return self._set_field(ref, value)
            case SetOutput(OutputRef.BASEBAND, value, 1) if value in _OUTPUTS:
                self._output = _OUTPUTS[value]
                return Ack()
            case GetSystemInfo(item) if item in _INFO:
                return Reply(0x58, item, _INFO[InfoItem(item)])
            case LoadProfile(app_id):
                return Ack() if app_id in set(Profile) else ErrorReply(ErrorCode.APP_INVALID)
            case SetLed() | SetDetectionZone() | SetSensitivity() | SetBaudRate():
                return Ack()
            case _:
                return ErrorReply(ErrorCode.NOT_RECOGNIZED)

    def _set_field(self, ref: int, value: float) -> Message:
        if ref not in set(SysCfg):
            return ErrorReply(ErrorCode.COMMAND_FAILED)
        if not np.isfinite(value):
            return ErrorReply(ErrorCode.COMMAND_FAILED)
        name = _SYS_FIELDS.get(SysCfg(ref))
        if name is not None:
            self._fields[name] = value
        return Ack()

    def _set_mode(self, mode: int) -> Message:
        if mode not in set(Mode):
            return ErrorReply(ErrorCode.COMMAND_FAILED)
        if mode != Mode.MANUAL:
            self._stream = self._resume = None
            self._frame_due_s = _FOREVER_S
            return Ack()
        try:
            self._start(self._settings())
        except SettingsError:
            return ErrorReply(ErrorCode.COMMAND_FAILED)
        return Ack()

    def _start(self, settings: RadarSettings) -> None:
        self._stream = EchoStream(self._scene, self._seed, settings)
        self._counter = 0
        self._frame_due_s = self._streaming_since_s = self._now_s

    def _settings(self) -> RadarSettings:
        known: dict[str, Any] = {
            name: value if name in {"frame_rate_hz", "sample_delay_s"} else int(value)
            for name, value in self._fields.items()
        }
        return RadarSettings(**known, output=self._output)

    def _frame_message(self, stream: EchoStream, frame: np.ndarray) -> Message:
        axis = stream.axis
        if axis.kind == "rf":
            return Data(ContentId.RAW_FRAME, self._counter, frame)
        head = (
            self._counter,
            axis.bin_length_m,
            axis.sample_rate_hz,
            axis.carrier_hz,
            axis.range_offset_m,
        )
        if stream.settings.output == "iq":
            return BasebandIq(*head, frame.real, frame.imag)
        return BasebandAp(*head, np.abs(frame), np.angle(frame))
