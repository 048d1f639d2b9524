"""X2Radar against simulated modules, over memory and over a pseudo-terminal."""

import numpy as np
import pytest

from tests.device_helpers import SETTINGS, SHORT, OnUsb, in_thread, module, plugged, take
from x2radar.device.device import X2Radar
from x2radar.device.link import Deadlines
from x2radar.device.transport import SerialTransport, Transport, memory_pair
from x2radar.errors import DeviceError, PortNotFound, TransportClosed
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.host import connect, serve
from x2radar.wire.codec import decode_command
from x2radar.wire.messages import GetSystemInfo, Reply

pytestmark = pytest.mark.integration


def in_memory() -> Transport:
    return connect(module, None)


@pytest.mark.parametrize("kind", ["memory", "pty"])
@pytest.mark.parametrize(("output", "dtype"), [("rf", "f4"), ("iq", "c8"), ("ap", "c8")])
def test_first_frames(kind: str, output: str, dtype: str) -> None:
    settings = RadarSettings(frame_stitch=1, output=output, pulse_generator=6)
    port = lambda: SerialTransport(far.path) if kind == "pty" else in_memory()  # noqa: E731
    with plugged(module()) as far, X2Radar(port, settings, name="sim") as radar:
        assert radar.stream is None
        frames = take(radar, 20)
        assert radar.stats.damaged == 0
        assert radar.stream is not None
    assert [f.index for f in frames] == list(range(20))
    assert [f.counter for f in frames] == list(range(1, 21))
    assert all(f.lost == 0 and not f.restarted for f in frames)
    assert {(f.samples.shape, f.samples.dtype) for f in frames} == {((256,), np.dtype(dtype))}
    axis = frames[0].axis
    assert axis.kind == ("rf" if output == "rf" else "baseband")
    assert axis.carrier_hz == pytest.approx(7.3e9)
    assert axis.bin_length_m == pytest.approx(settings.axis.bin_length_m)
    assert radar.stream.axis == axis
    assert (radar.stream.frame_rate_hz, radar.stream.device) == (60.0, "sim")


def test_the_module_answers_further_commands_while_it_streams() -> None:
    with X2Radar(in_memory, SETTINGS) as radar:
        reply = radar.command(GetSystemInfo(2))
        assert isinstance(reply, Reply)
        assert reply.value == "x2radar simulated module"
        with pytest.raises(DeviceError, match=r"LoadProfile.*0x20 \(app invalid\)"):
            radar.command(decode_command(b"\x21\x01\x02\x03\x04"))
        assert len(take(radar, 3)) == 3


class UsbPort:
    """A port that vanishes when its module restarts, and fails some times before it is back."""

    def __init__(self, n_failures: int) -> None:
        self.n_connects = 0
        self._n_failures = n_failures
        self._far: list[Transport] = []

    def connect(self) -> Transport:
        self.n_connects += 1
        if 1 < self.n_connects <= 1 + self._n_failures:
            raise PortNotFound("gone for a moment")
        near, far = memory_pair()
        self._far.append(far)
        in_thread(serve, module(), far, speed=None)
        return OnUsb(near)

    def close(self) -> None:
        for far in self._far:
            far.close()


def test_port_on_usb_is_opened_again_after_the_reset() -> None:
    port = UsbPort(n_failures=2)
    with X2Radar(port.connect, SETTINGS, deadlines=SHORT) as radar:
        assert port.n_connects == 4
        assert [f.index for f in take(radar, 3)] == [0, 1, 2]
    port.close()


def test_port_on_usb_that_does_not_come_back() -> None:
    port = UsbPort(n_failures=1000)
    radar = X2Radar(port.connect, SETTINGS, deadlines=Deadlines(ready_s=0.6, usb_gone_s=0.01))
    with pytest.raises(PortNotFound):
        radar.open()
    assert port.n_connects > 2
    port.close()


def test_port_on_usb_that_vanishes_early_and_late() -> None:
    """Before the reset's answer is through, and once more, late."""
    port = UsbPort(n_failures=0)

    def gone(_timeout_s: float) -> bytes:
        raise TransportClosed("gone")

    def connect() -> Transport:
        near = port.connect()
        near.read = gone if port.n_connects < 3 else near.read
        return near

    with X2Radar(connect, SETTINGS, deadlines=SHORT) as radar:
        assert port.n_connects == 3
        assert [f.index for f in take(radar, 3)] == [0, 1, 2]
    port.close()
