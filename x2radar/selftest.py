"""Self-test of a module: what it answers, how it streams, how clean its frames are.

It is made for strangers' modules: the only road to evidence on hardware that we do not own.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.device import X2Radar
from x2radar.errors import DeviceError
from x2radar.frame import Frame
from x2radar.messages import GetSystemInfo, Reply
from x2radar.wire_ids import InfoItem

LATE_FRAMES = 1.5
CLEAN_LOSS = 0.001
TOLERATED_LOSS = 0.02
RATE_ERROR = 0.02


@dataclass(slots=True)
class Report:
    """What a self-test found.

    Attributes
    ----------
    info : dict of str to str
        What the module says of itself, by item.
    figures : dict of str to float
        Measured; units stand in the names. Levels are in the module's own unit.
    verdicts : list of (str, str)
        'pass', 'warn' or 'fail', and why.
    """

    info: dict[str, str] = field(default_factory=dict)
    figures: dict[str, float] = field(default_factory=dict)
    verdicts: list[tuple[str, str]] = field(default_factory=list)

    @property
    def has_failed(self) -> bool:
        """Whether any verdict is 'fail'."""
        return any(verdict == "fail" for verdict, _ in self.verdicts)


def ask_info(radar: X2Radar) -> dict[str, str]:
    """Return every system info item that the module answers, by name.

    Parameters
    ----------
    radar : X2Radar
        Open; a module that streams answers in between.

    Returns
    -------
    dict of str to str
        Items that it refuses are left out.
    """
    info = {}
    for item in InfoItem:
        try:
            reply = radar.command(GetSystemInfo(item))
        except DeviceError:
            continue
        if isinstance(reply, Reply):
            info[item.name.lower()] = str(reply.value)
    return info


def collect(
    radar: X2Radar, duration_s: float, keep: Callable[[Frame], None] = lambda _frame: None
) -> list[Frame]:
    """Return the frames of so many stream seconds, each handed to `keep` as well."""
    most = max(3, round(duration_s * radar.settings.frame_rate_hz))
    frames = []
    for frame in radar.frames():
        frames.append(frame)
        keep(frame)
        if frame.index + 1 >= most:
            break
    return frames


def judge(radar: X2Radar, frames: list[Frame]) -> Report:
    """Measure what the frames show.

    Parameters
    ----------
    radar : X2Radar
        Where they came from.
    frames : list of Frame
        At least three, of one length.

    Returns
    -------
    Report
        Figures and verdicts; `info` is left empty.
    """
    report = Report()
    asked_hz = radar.settings.frame_rate_hz
    arrived_s = np.array([frame.t_mono_s for frame in frames])
    index = np.array([frame.index for frame in frames])
    span_s = arrived_s[-1] - arrived_s[0]
    lost = sum(frame.lost for frame in frames)
    late_s = np.diff(arrived_s)
    reached_hz = (index[-1] - index[0]) / span_s if span_s > 0 else float("nan")
    share = lost / (index[-1] + 1)
    report.figures |= {
        "frames": len(frames),
        "n_range": frames[0].axis.n_range,
        "frame_rate_asked_hz": asked_hz,
        "frame_rate_reached_hz": round(float(reached_hz), 3),
        "interval_median_ms": round(float(np.median(late_s)) * 1e3, 2),
        "interval_p99_ms": round(float(np.quantile(late_s, 0.99)) * 1e3, 2),
        "lost_frames": lost,
        "restarts": sum(frame.restarted for frame in frames),
        "damaged_stretches": radar.n_damaged,
    }
    _rate_verdict(report, reached_hz, asked_hz)
    if share <= CLEAN_LOSS:
        report.verdicts.append(("pass", f"{lost} frames lost"))
    else:
        verdict = "warn" if share <= TOLERATED_LOSS else "fail"
        report.verdicts.append((verdict, f"{lost} frames lost ({share:.1%})"))
    if radar.n_damaged:
        report.verdicts.append(("warn", f"{radar.n_damaged} damaged stretches on the line"))
    same = [f.samples for f in frames if f.samples.shape == frames[0].samples.shape]
    _signal(report, np.stack(same))
    return report


def _rate_verdict(report: Report, reached_hz: float, asked_hz: float) -> None:
    error = abs(reached_hz / asked_hz - 1)
    text = f"{reached_hz:.2f} of {asked_hz:g} frames a second"
    report.verdicts.append(("pass" if error <= RATE_ERROR else "warn", text))


def _signal(report: Report, samples: NDArray[np.inexact[Any]]) -> None:
    """Noise from second differences, clutter from the mean: an empty room is best."""
    second = np.diff(samples.astype(np.complex128), 2, axis=0)
    # Median over mean of a squared normal (real) and of an exponential variable (complex).
    ratio = 0.4549 if np.isrealobj(samples) else np.log(2)
    noise = np.sqrt(np.median(np.abs(second) ** 2, axis=0) / ratio / 6)
    mean = samples.mean(axis=0)
    clutter = np.abs(mean - (mean.mean() if np.isrealobj(samples) else 0))
    strongest = int(clutter.argmax())
    noise_level = float(np.median(noise))
    spikes = int((np.abs(samples) > 100).any(axis=1).sum())
    report.figures |= {
        "noise_sigma": float(f"{noise_level:.4g}"),
        "clutter_over_noise_db": round(
            20 * float(np.log10(clutter.max() / max(noise_level, 1e-30))), 1
        ),
        "strongest_bin": strongest,
        "spike_frames": spikes,
        "frames_all_equal": int((np.diff(samples, axis=0) == 0).all(axis=1).sum()),
    }
    if noise_level == 0:
        report.verdicts.append(
            ("fail", "no noise at all: the receiver is dead or the data made up")
        )
    else:
        report.verdicts.append(("pass", f"noise {noise_level:.3g} per sample"))
    if spikes:
        report.verdicts.append(("warn", f"{spikes} frames with samples beyond full scale"))
