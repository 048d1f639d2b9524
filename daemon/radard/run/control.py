"""Control: command and watch a running daemon from the command line of the same machine.

A Unix socket beside the status file of every sensor. Only the daemon's own user and root may
connect: the socket is 0600 before anybody can, and the kernel says who did. A request is one
JSON object on a line, the answer is another: ``{"command": "arm"}``.
"""

import contextlib
import json
import logging
import os
import selectors
import socket
import struct
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radard.alarm.panel import ARM_MODES
from radard.alarm.sensor_state import SensorState
from radard.outputs.registry import ANSWERED_S, wait_until
from radard.stream.ring import FrameRing

if TYPE_CHECKING:
    # Not for the other end of the line, which must answer at once.
    from radard.run.sensor import Sensor

log = logging.getLogger("radard")
COMMANDS = ("arm", "arm-home", "disarm", "ack", "test-alarm", "look")
_TOLD = ("armed", "mode", "panel", "delay_left_s")
_MAX_BYTES = 65_536  # of a line; requests have about thirty, and what `top` shows some thousand
_REQUEST_S = 2.0  # the other end is a program on the same machine
_TAKEN_UP_S = 5.0  # a worker is never so long in one dwell
_SLOW = "the disk has not taken it so far"
_LOOK_S = 0.1  # a person waits
_COLUMN_S = 0.25  # a ring holds some seventeen of them
_MAX_ROWS = 16  # of range: a third of a screen
_STEP_DB = 4.0  # from one level to the next; noise alone stays within the first
_MAX_LEVEL = 4


def control_path(folder: Path, sensor: str) -> Path:
    """Return the socket of a sensor."""
    return folder / f"{sensor}.sock"


class ControlServer:
    """Serve the sockets of all radars of a process, in a thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._selector = selectors.DefaultSelector()
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)

    def start(self, radars: "Sequence[Sensor]") -> None:
        """Begin, once, with these."""
        if self._thread.ident is not None or not hasattr(socket, "SO_PEERCRED"):
            return
        self._thread.start()
        for radar in radars:
            self.add(radar)

    def add(self, radar: "Sensor") -> None:
        """Serve another radar, once begun; a socket that cannot be made is logged, and missing."""
        if self._thread.ident is None:
            return
        path = control_path(self._folder, radar.sensor)
        try:
            sock = _listen(path)
        except OSError as err:
            log.warning("%s: no commands from there: %s", path, err.strerror or err)
            return
        if sock is not None:
            self._selector.register(sock, selectors.EVENT_READ, (radar, path))

    def remove(self, name: str) -> None:
        """Serve a radar no more."""
        for key in list(self._selector.get_map().values()):
            radar, path = key.data
            if radar.sensor == name:
                self._selector.unregister(key.fileobj)
                # Its file first: in between nobody else can have made another.
                with contextlib.suppress(OSError):
                    path.unlink()
                key.fileobj.close()  # type: ignore[union-attr]

    def stop(self) -> None:
        """Take the sockets away; no-op if not started."""
        if self._thread.ident is None:
            return
        self._halt.set()
        self._thread.join(1.0)
        for key in list(self._selector.get_map().values()):
            self.remove(key.data[0].sensor)

    def _run(self) -> None:
        while not self._halt.is_set():
            for key, _ in self._selector.select(_LOOK_S):
                try:
                    self._serve(key.fileobj, key.data[0])  # type: ignore[arg-type]
                except OSError as err:
                    log.warning("a command was not answered: %s", err.strerror or err)
                    # One that cannot even be accepted is there again at once.
                    self._halt.wait(_LOOK_S)

    def _serve(self, sock: socket.socket, radar: "Sensor") -> None:
        line, _ = sock.accept()
        with line:
            uid = _user_of(line)
            if uid not in {0, os.geteuid()}:
                log.warning("%s: user %d may give no commands", radar.sensor, uid)
                return
            line.settimeout(_REQUEST_S)
            request = line.makefile("rb").readline(_MAX_BYTES)
            if not request:
                # A second daemon only looks whether this one is there.
                return
            try:
                name = json.loads(request)["command"]
                answer = self._answer(str(name), radar)
            except (ValueError, LookupError, TypeError, RecursionError) as err:
                answer = {"ok": False, "error": str(err)}
            except Exception as err:
                # A plug-in's output may fail at being looked at; others are served still.
                log.exception("%s: a command broke off", radar.sensor)
                answer = {"ok": False, "error": repr(err)}
            line.sendall(json.dumps(answer).encode() + b"\n")

    def _answer(self, name: str, radar: "Sensor") -> dict[str, Any]:
        if name not in COMMANDS:
            raise ValueError(f"no command '{name}'; known are {', '.join(COMMANDS)}")
        if name == "look":
            return {"ok": True, **look(radar)}
        log.warning("%s: asked for on the command line", name)
        if name == "test-alarm":
            return {"ok": True, "outputs": radar.test_alarm(self._halt)}
        before = radar.panel()
        radar.command(name)

        def is_kept() -> bool:
            # It holds after a kill, too, or no disk takes it.
            return _is_so(radar.panel(), name) and radar.why_lost is not None

        wait_until(is_kept, _TAKEN_UP_S, self._halt)
        state, why = radar.panel(), radar.why_lost
        if state is not None and not _is_so(state, name):
            tamper = state.open.get("tamper", "") if name in ARM_MODES else ""
            raise ValueError(tamper or f"{name}: not taken up within {_TAKEN_UP_S:g} s")
        ended = before.open.get("alarm") if before is not None and name == "ack" else None
        told = {key: getattr(state, key, None) for key in _TOLD}
        return {"ok": True, **told, "ended": ended, "lost": _SLOW if why is None else why}


def _is_so(state: SensorState | None, command: str) -> bool:
    """Return whether a command has been taken up; at once where there is no stream."""
    if state is None:
        return True
    if command == "ack":
        return state.alarm_id is None
    mode = ARM_MODES.get(command)
    return state.armed is (mode is not None) and mode in {None, state.mode}


def ask(path: Path, command: str) -> Mapping[str, Any]:
    """Give a daemon a command and return its answer; raises OSError, ValueError or TypeError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line, _short(path) as address:
        line.settimeout(ANSWERED_S + _TAKEN_UP_S)
        line.connect(address)
        line.sendall(json.dumps({"command": command}).encode() + b"\n")
        answer: Mapping[str, Any] = json.loads(line.makefile("rb").readline(_MAX_BYTES))
        if not isinstance(answer, dict):
            raise TypeError("its answer is no JSON object")
        return answer


def _listen(path: Path) -> socket.socket | None:
    """Return a socket that listens; None while another daemon has it."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.exists():
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line, _short(path) as address:
            line.settimeout(_REQUEST_S)
            with contextlib.suppress(ConnectionRefusedError):
                line.connect(address)
                return None
        if path.is_socket():
            path.unlink()
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with _short(path) as address:
            sock.bind(address)
        # Nobody can connect before `listen`.
        path.chmod(0o600)
        sock.listen(4)
    except OSError:
        sock.close()
        raise
    return sock


@contextlib.contextmanager
def _short(path: Path) -> Iterator[str]:
    """Yield an address of a socket that the kernel takes: 107 bytes, however long its folder's."""
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def _user_of(line: socket.socket) -> int:
    credentials = line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    return int(struct.unpack("3i", credentials)[1])


def look(sensor: "Sensor") -> dict[str, Any]:
    """Return what holds at this moment, as JSON has it; for any thread."""
    state, ring = sensor.panel(), sensor.ring()
    return {
        "status": asdict(sensor.health.status),
        "panel": None if state is None else state.as_record(sensor.mark()),
        "records": sensor.recent,
        "outputs": [{"name": sink.name, **asdict(sink.state)} for sink in sensor.sinks()],
        "picture": None if ring is None else range_time(ring),
    }


def range_time(ring: FrameRing) -> dict[str, Any]:
    """Return where something moved: columns of digits 0 to 4, near to far, in steps of 4 dB."""
    recent, range_m = ring.recent(), ring.axis.range_m
    begin = recent.end_frame - len(recent.frames)
    stride = max(1, round(_COLUMN_S * ring.frame_rate_hz))
    first = -(-begin // stride)
    n = max(0, recent.end_frame // stride - first)
    span_m, column_s = [float(range_m[0]), float(range_m[-1])], stride / ring.frame_rate_hz
    told: dict[str, Any] = {"first": first, "column_s": column_s, "range_m": span_m}
    if not n:
        return {**told, "columns": []}
    moving = recent.frames - recent.frames.mean(axis=0)
    at = first * stride - begin
    power = (np.abs(moving[at : at + n * stride]) ** 2).reshape(n, stride, -1).mean(axis=1)
    n_rows = min(_MAX_ROWS, power.shape[1])
    rows = np.maximum.reduceat(power, np.arange(n_rows) * power.shape[1] // n_rows, axis=1)
    over_db = 10 * np.log10(np.maximum(rows, 1e-300) / max(float(np.median(power)), 1e-300))
    levels = np.clip(over_db // _STEP_DB, 0, _MAX_LEVEL).astype(int)
    return {**told, "columns": ["".join(map(str, column)) for column in levels.tolist()]}
