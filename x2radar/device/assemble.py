"""Messages to frames: the one place that knows which messages carry an echo.

Raw RF frames, baseband I/Q and baseband amplitude/phase all become a `Frame` with its axis;
every other message is none.
"""

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import CounterTracker, FastTimeAxis, Frame, Samples, Step
from x2radar.modules.base import ModuleSettings
from x2radar.wire.messages import BasebandAp, BasebandIq, Data, Message
from x2radar.wire.wire_ids import ContentId


class FrameAssembler:
    """Build frames from messages, with unwrapped counters; `settings` give raw ones an axis.

    Frames that came twice are added to `counts`, as "repeated"; `counter` may go on from before.
    """

    def __init__(
        self,
        settings: ModuleSettings,
        counts: Counter[str] | None = None,
        counter: CounterTracker | None = None,
    ) -> None:
        self._settings = settings
        self._counter = counter or CounterTracker()
        self._said: dict[str, Any] = {}
        self._axis = settings.axis
        self._last: Samples | None = None
        self._counts = Counter[str]() if counts is None else counts

    def frame(self, message: Message, t_mono_s: float) -> Frame | None:
        """Return the frame in `message`, or None when it holds none or repeats the last."""
        samples: Samples
        match message:
            case BasebandIq() | BasebandAp():
                if isinstance(message, BasebandIq):
                    samples = _complex(message.i, message.q)
                else:
                    amplitude, phase = message.amplitude, message.phase
                    samples = _complex(amplitude * np.cos(phase), amplitude * np.sin(phase))
                counter = message.counter
                axis = self._shared_axis(
                    kind="baseband",
                    n_range=samples.size,
                    bin_length_m=message.bin_length_m,
                    range_offset_m=message.range_offset_m,
                    carrier_hz=message.carrier_hz,
                    sample_rate_hz=message.sample_rate_hz,
                )
            case Data(ContentId.RAW_FRAME, counter, values) if values.dtype == np.float32:
                if self._settings.raw_kind == "rf":
                    # Behind its header the packet's memory is not aligned; users' libraries mind.
                    samples = np.require(values, np.float32, "A")
                else:
                    # Half I and half Q (X4), if even.
                    half = 0 if values.size % 2 else values.size // 2
                    samples = _complex(values[:half], values[half : 2 * half])
                axis = self._shared_axis(kind=self._settings.raw_kind, n_range=samples.size)
            case _:
                return None
        if samples.size == 0:
            return None
        step, lost = self._counter.update(counter)
        if step is Step.REPEAT:
            if self._last is not None and np.array_equal(samples, self._last):
                self._counts["repeated"] += 1
                return None
            step = Step.RESTART
            self._counter.index += 1
        self._last = samples
        samples.flags.writeable = False
        restarted = step is Step.RESTART
        return Frame(samples, counter, self._counter.index, lost, restarted, axis, t_mono_s)

    def _shared_axis(self, **said: Any) -> FastTimeAxis:
        """Return the settings' axis with what a frame says; one while nothing changes."""
        if said != self._said:
            self._said = said
            self._axis = replace(self._settings.axis, **said)
        return self._axis


def _complex(real: NDArray[Any], imag: NDArray[Any]) -> Samples:
    samples = np.empty(real.size, np.complex64)
    samples.real, samples.imag = real, imag
    return samples
