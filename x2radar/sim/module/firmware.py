"""What a simulated module's firmware makes of commands: that of an X2, and that of an X4.

`SimulatedModule` owns time, boot, line and faults; a firmware owns what was configured. It
answers one command at a time, and says what becomes of the stream. `FIRMWARES` has the one of
every row of `x2radar.modules.modules`.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SettingsError
from x2radar.frame import FastTimeAxis
from x2radar.modules.base import ModuleSettings
from x2radar.modules.profile import PROFILES, ProfileSettings
from x2radar.modules.x2 import OUTPUTS, SYS_FIELDS, RadarSettings
from x2radar.modules.x4 import X4_FIELDS, X4Settings
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids

_FAILED = msg.ErrorReply(ids.ErrorCode.COMMAND_FAILED)
_OUTPUTS: dict[int, str] = {code: name for name, code in OUTPUTS.items()}
_INFO = {
    ids.InfoItem.ITEM_NUMBER: "SIM",
    ids.InfoItem.FIRMWARE_ID: "x2radar simulated module",
    ids.InfoItem.VERSION: "1.0.0",
    ids.InfoItem.BUILD: "0",
    ids.InfoItem.SERIAL_NUMBER: "000000000000",
    ids.InfoItem.ORDER_CODE: "",
}
_RUNS = {app_id: name for name, (app_id, _) in PROFILES.items()}


@dataclass(frozen=True, slots=True)
class Obeyed:
    """Reply to a command, and what happens to the stream."""

    reply: msg.Message
    stops: bool = False
    starts: ModuleSettings | None = None


class Firmware(ABC):
    """What was configured, and what commands do to it."""

    order_code: str

    def __init__(self) -> None:
        self.forget()

    @abstractmethod
    def forget(self) -> None:
        """Go back to the state after power-on."""

    def obey(self, command: msg.Message) -> Obeyed | None:
        """Carry a command out; None for one that this firmware does not know."""
        match command:
            case msg.GetSystemInfo(item) if item in _INFO:
                told = _INFO[ids.InfoItem(item)] or self.order_code
                return Obeyed(msg.Reply(0x58, item, told))
            case msg.SetLed() | msg.SetBaudRate():
                return Obeyed(msg.Ack())
            case _:
                return None

    @abstractmethod
    def frame_message(self, axis: FastTimeAxis, counter: int, frame: NDArray[Any]) -> msg.Message:
        """Return the message in which the stream that was started last sends a frame."""


class X2Firmware(Firmware):
    """An X2 module: profiles in RUN mode, the chip's own frames in MANUAL mode."""

    order_code = "X2M-SIM"

    def forget(self) -> None:
        self._fields: dict[str, float] = {}
        self._output = self._streamed = _OUTPUTS[ids.BasebandOutput.OFF]
        self._profile: str | None = None
        self._zone_m: tuple[float, float] | None = None

    def obey(self, command: msg.Message) -> Obeyed | None:
        match command:
            case msg.SetMode(mode):
                return self._set_mode(mode)
            case msg.SetSysInt(ref, value) | msg.SetSysFloat(ref, value):
                if ref not in set(ids.SysCfg) or not np.isfinite(value):
                    return Obeyed(_FAILED)
                if (name := SYS_FIELDS.get(ids.SysCfg(ref))) is not None:
                    self._fields[name] = value
                return Obeyed(msg.Ack())
            case msg.SetOutput(ids.OutputRef.BASEBAND, value) if value in _OUTPUTS:
                self._output = _OUTPUTS[value]
                return Obeyed(msg.Ack())
            case msg.LoadProfile(app_id):
                if app_id not in set(ids.Profile):
                    return Obeyed(msg.ErrorReply(ids.ErrorCode.APP_INVALID))
                self._profile, self._zone_m = _RUNS.get(ids.Profile(app_id)), None
                return Obeyed(msg.Ack(), stops=True)
            case msg.SetDetectionZone(start_m, end_m):
                self._zone_m = start_m, end_m
                return Obeyed(msg.Ack())
            case msg.SetSensitivity():
                return Obeyed(msg.Ack())
            case _:
                return super().obey(command)

    def frame_message(self, axis: FastTimeAxis, counter: int, frame: NDArray[Any]) -> msg.Message:
        if axis.kind == "rf":
            return msg.Data(ids.ContentId.RAW_FRAME, counter, frame)
        about = axis.bin_length_m, axis.sample_rate_hz, axis.carrier_hz, axis.range_offset_m
        if self._streamed == "iq":
            return msg.BasebandIq(counter, *about, frame.real, frame.imag)
        return msg.BasebandAp(counter, *about, np.abs(frame), np.angle(frame))

    def _set_mode(self, mode: int) -> Obeyed:
        if mode not in set(ids.Mode):
            return Obeyed(_FAILED)
        try:
            settings = self._settings(mode)
        except SettingsError:
            return Obeyed(_FAILED)
        self._streamed = self._output
        return Obeyed(msg.Ack(), stops=True, starts=settings)

    def _settings(self, mode: int) -> ModuleSettings | None:
        """Return what a mode streams by, or None; SettingsError if it is impossible."""
        if mode == ids.Mode.MANUAL:
            # The rate and the delay are told as they are, whatever else as whole numbers.
            known: dict[str, Any] = self._fields.copy()
            for name in known.keys() - {"frame_rate_hz", "sample_delay_s"}:
                known[name] = int(known[name])
            return RadarSettings(**known, output=self._output)
        if mode != ids.Mode.RUN or self._profile is None or self._output == "rf":
            return None
        start_m, end_m = self._zone_m or PROFILES[self._profile][1]
        return ProfileSettings(
            profile=self._profile, zone_start_m=start_m, zone_end_m=end_m, output=self._output
        )


class X4Firmware(Firmware):
    """An X4 module with XEP firmware: frames follow from the X4 driver's settings."""

    order_code = "X4M03-SIM"

    def forget(self) -> None:
        self._mode = int(ids.Mode.STOP)
        self._is_initialised = False
        self._fields: dict[str, Any] = {"is_baseband": False}

    def obey(self, command: msg.Message) -> Obeyed | None:
        match command:
            case msg.SetMode(mode):
                if mode not in set(ids.Mode):
                    return Obeyed(_FAILED)
                self._mode = mode
                return Obeyed(msg.Ack(), stops=True)
            case msg.X4Init():
                self._is_initialised = True
                return Obeyed(msg.Ack())
            case msg.X4Set(ids.X4Setting.FPS, (rate_hz,)):
                return self._set_rate(rate_hz)
            case msg.X4Set(ids.X4Setting.TX_POWER | ids.X4Setting.ENABLE):
                return Obeyed(msg.Ack())
            case msg.X4Set(setting, values) if setting in X4_FIELDS:
                self._fields |= dict(zip(X4_FIELDS[setting], values, strict=True))
                return Obeyed(msg.Ack())
            case _:
                return super().obey(command)

    def frame_message(self, axis: FastTimeAxis, counter: int, frame: NDArray[Any]) -> msg.Message:
        # Baseband is half I and half Q.
        values = frame if axis.kind == "rf" else np.concatenate([frame.real, frame.imag])
        return msg.Data(ids.ContentId.RAW_FRAME, counter, values)

    def _set_rate(self, rate_hz: float) -> Obeyed:
        if rate_hz == 0:
            return Obeyed(msg.Ack(), stops=True)
        if not self._is_initialised or self._mode != ids.Mode.MANUAL:
            return Obeyed(_FAILED)
        try:
            is_baseband = bool(self._fields["is_baseband"])
            known = self._fields | {"is_baseband": is_baseband, "frame_rate_hz": rate_hz}
            return Obeyed(msg.Ack(), stops=True, starts=X4Settings(**known))
        except SettingsError:
            return Obeyed(_FAILED)


FIRMWARES: Mapping[str, type[Firmware]] = {
    "x2raw": X2Firmware,
    "x2m200": X2Firmware,
    "x4m03": X4Firmware,
}
"""The firmware that simulates the module of each row, by its `device`."""
