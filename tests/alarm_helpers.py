"""Decisions, recordings and notification sockets for the tests of alarms and health."""

import socket

import h5py
import numpy as np

from radard.clips.clip_file import ClipFile
from radard.detect.gate import GateReading
from radard.judge.classifier import Probabilities
from radard.judge.decision import Decision, TrackVerdict
from tests.radar_helpers import BASEBAND, frames_of, noise
from x2radar.frame import StreamInfo


def decision(t_s, human=None, *, alarm=None, range_m=1.5, label=None, fault="", **more):
    """A decision with p(human), or with the gate closed, or invalid when it has a fault."""
    p = None if human is None else Probabilities(human, 1 - human, 0.0)
    if alarm is None:
        alarm = human is not None and human >= 0.2
    if label is None:
        label = "none" if human is None else ("human" if alarm else "pet")
    reading = GateReading(human is not None, -10.0, -30.0, -24.0, range_m)
    p = None if fault else p
    seen = {"gate": "closed" if human is None else "open", "label": label, "dropped": 0}
    if fault:
        seen = {"gate": "invalid", "label": "invalid", "dropped": 5}
    seen |= {"reading": None if fault else reading, "window": p, "fused": p, "fault": fault}
    return Decision(seq=1, t_s=t_s, alarm=alarm and not fault, frames=147, **seen, **more)


def track(range_m, p_pet=0.0, p_other=0.0):
    """Return a track's verdict; None for one that was not classified."""
    window = None if p_pet is None else Probabilities(1 - p_pet - p_other, p_pet, p_other)
    return TrackVerdict(id=1, range_m=range_m, radial_velocity_mps=0.0, window=window)


class NotifySocket:
    """The far end of systemd's notification protocol."""

    def __init__(self, path):
        self.name = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(f"\0{self.name[1:]}" if self.name.startswith("@") else self.name)
        self._socket.settimeout(180)

    def next(self):
        """Return the next message as a mapping."""
        return dict(line.split("=", 1) for line in self._socket.recv(4096).decode().splitlines())

    def wait_for(self, key):
        """Return the next message that has a key."""
        while key not in (message := self.next()):
            pass
        return message

    def drain(self):
        """Forget the messages that wait."""
        self._socket.setblocking(False)
        try:
            while True:
                self._socket.recv(4096)
        except BlockingIOError:
            self._socket.settimeout(180)

    def silent_for(self, seconds, *, key="WATCHDOG"):
        """Return whether no message with `key` comes for so long."""
        self._socket.settimeout(seconds)
        try:
            while key not in self.next():
                pass
        except TimeoutError:
            return True
        finally:
            self._socket.settimeout(180)
        return False

    def close(self):
        self._socket.close()


def begun_clip(path, n):
    """A clip of n frames that is being written."""
    stream = StreamInfo(BASEBAND, 60.0, "test")
    about = {"first_index": 0, "started_utc": "2026-01-01T00:00:00Z", "attributes": {}}
    clip = ClipFile(path, stream, **about)
    clip.write(list(frames_of(noise(n))))
    return clip


def write_recording(path, samples, rate_hz=60.0, sets=None, **attributes):
    """Make a foreign recording: only what the contract asks for; None leaves something out."""
    n = len(samples)
    known = {"format": "x2radar-recording", "format_version": 1, "kind": "baseband"}
    known |= {"frame_rate_hz": rate_hz, "carrier_hz": 6.8e9, "sample_rate_hz": 41e9}
    known |= {"bin_length_m": 299_792_458 / 82e9, "range_offset_m": 0.6}
    known |= {"started_utc": "2026-01-01T00:00:00Z", "device": "{}", "settings": "{}"}
    columns = {"samples": samples, "counter": np.arange(n, dtype=np.uint32)}
    columns |= {"t_s": np.arange(n) / rate_hz, **(sets or {})}
    with h5py.File(path, "w") as file:
        for name, value in (known | attributes).items():
            if value is not None:
                file.attrs[name] = value
        for name, value in columns.items():
            if value is not None:
                file[f"frames/{name}"] = value
