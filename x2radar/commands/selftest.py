"""`x2radar selftest`: a report on a module, and a short recording to send in.

It is made for users' modules: the only evidence on hardware that we do not own. So it asks before
it resets, reports what it has found when something fails, and judges by the limits at the top.
"""

import argparse
import contextlib
import json
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from x2radar import wall_clock
from x2radar.command import installed_version
from x2radar.commands import Commands, add_command, check_above_zero
from x2radar.commands.info import answers_of
from x2radar.device.device import X2Radar
from x2radar.errors import DeviceError, PortError, ReadTimeout, TransportClosed
from x2radar.frame import Frame, Samples
from x2radar.ports import PORT_FORMS, parse_port
from x2radar.radars import make_radar
from x2radar.recording.faults import refuse_taken
from x2radar.recording.registry import check_name
from x2radar.wire.messages import Pong, Reply
from x2radar.wire.wire_ids import PONG_NAMES

_ASK_S = 0.25  # for an answer: short, because old firmware leaves many questions unanswered
_KEPT_BYTES = 32 << 20  # most samples kept for the recording: what can be sent in by mail

_SLOW_START_S = 8.0
_RATE_ERROR = (0.02, 0.1)
_LOSS = (0.001, 0.02)
_DAMAGED = (0.0, 0.01)
_LATE_PERIODS = 2.5
_WEAK_CLUTTER_DB = 15.0
_PHASE_JITTER_RAD = 0.05
_SPIKE_TIMES = 4.0
_FLAT_RUN = 3  # limits above: pass up to the first (or only) one, warn up to the second
_CHI2_MEDIAN = 0.4549  # median of the square of a standard normal variable


@dataclass(slots=True)
class Report:
    """What a self-test found; a verdict is a level (pass, warn, fail), on what, and why."""

    ping: str = ""
    info: dict[str, str] = field(default_factory=dict)
    figures: dict[str, float] = field(default_factory=dict)
    verdicts: list[dict[str, str]] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    error: Exception | None = None

    def judge(self, about: str, level: str | bool, why: str) -> None:
        """Add one line of judgement; True is a pass, and False a warning."""
        level = level if isinstance(level, str) else "pass" if level else "warn"
        self.verdicts.append({"level": level, "about": about, "why": why})


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "selftest",
        "test a module and make a report to send in",
        "example:\n  x2radar selftest --port /dev/ttyACM0 --out mine.h5 > report.txt\n",
    )
    add, usual = parser.add_argument, "x2radar-selftest-TIME.h5, in this folder"
    add("--port", required=True, help=PORT_FORMS)
    add("--duration", type=float, default=10.0, metavar="S", help="seconds (10)")
    add("--out", type=Path, metavar="FILE", help=f"recording to make ({usual})")
    add("--json", action="store_true", help="the report as one JSON object")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_above_zero("--duration", args.duration, "seconds")
    now = wall_clock.now()
    out = args.out or Path(f"x2radar-selftest-{now:%Y%m%dT%H%M%SZ}.h5")
    check_name(out, "hdf5")
    refuse_taken(out)
    radar = make_radar(parse_port(args.port))
    found = _tested(radar, args.duration)
    report = {
        "software": {
            "x2radar": installed_version(),
            "python": platform.python_version(),
            "system": platform.system(),
            **{name: installed_version(name) for name in ("numpy", "pyserial", "h5py")},
        },
        "port": args.port,
        "started_utc": wall_clock.utc_text(now, "seconds"),
        "ping": found.ping or None,
        "info": found.info,
        "settings": asdict(radar.settings),
        "figures": found.figures,
        "verdicts": found.verdicts,
        "recording": str(out) if found.frames else None,
    }
    if found.frames:
        _record(out, radar, found.frames, report)
    print(json.dumps(report) if args.json else "\n".join(_lines(report)), flush=True)
    if found.error is not None and not found.frames:
        raise found.error
    return 0


def _record(out: Path, radar: X2Radar, frames: list[Frame], report: dict[str, Any]) -> None:
    # Late: h5py takes a while, and the other subcommands do without it.
    from x2radar.recording.hdf5_writer import RecordingWriter  # noqa: PLC0415

    assert radar.stream is not None  # noqa: S101 - known with the first frame
    device = {"name": radar.name, **report["info"], "selftest": report}
    about = {"started_utc": report["started_utc"], "settings": report["settings"]}
    with RecordingWriter(out, radar.stream, device=device, **about) as writer:
        for frame in frames:
            writer.write(frame)


def _lines(report: dict[str, Any]) -> list[str]:
    lines = [f"self-test of {report['port']}, {report['started_utc']}"]
    for title in ("software", "info", "settings", "figures"):
        lines += [f"{title}:"] if report[title] else []
        for name, value in report[title].items():
            text = f"{value:g}" if isinstance(value, float) else value
            lines.append(f"  {name:<24} {text}")
    lines.append("verdicts:")
    lines += [f"  {v['level'].upper():<4} {v['about']:<10} {v['why']}" for v in report["verdicts"]]
    if report["recording"]:
        lines.append(f"the recording to send in: {report['recording']}")
    return lines


def _tested(radar: X2Radar, duration_s: float) -> Report:
    """Test a module for `duration_s` of stream time; `error` of the report if it fails."""
    report = Report()
    # Whether it streams all the same comes next.
    with contextlib.closing(radar), contextlib.suppress(DeviceError, TransportClosed):
        radar.open(stream=False)
        _ask(radar, report)
    said = report.ping.replace("_", " ") or "nothing"
    report.judge("ping", said == "ready", f"answered: {said}")
    before = radar.stats
    stamps: list[tuple[float, int]] = []
    begun_s, kept = time.monotonic(), 0
    try:
        radar.open()
        report.figures["start_s"] = round(time.monotonic() - begun_s, 3)
        most = max(3, round(duration_s * radar.settings.frame_rate_hz))
        for frame in radar.frames():
            stamps.append((frame.t_mono_s, frame.index))
            if kept + frame.samples.nbytes <= _KEPT_BYTES:
                kept += frame.samples.nbytes
                report.frames.append(frame)
            if frame.index + 1 >= most:
                break
    except (PortError, DeviceError, TransportClosed, ReadTimeout) as err:
        report.error = err
        report.judge("stream", "fail", str(err))
    finally:
        radar.close()
    if (start_s := report.figures.get("start_s")) is not None:
        report.judge("start-up", start_s <= _SLOW_START_S, f"streams after {start_s:.1f} s")
    for name in ("frames", "lost", "repeated", "restarts", "damaged", "retries"):
        report.figures[name] = getattr(radar.stats, name) - getattr(before, name)
    if len(stamps) >= 3:
        _judge_pace(report, stamps, radar.settings.frame_rate_hz)
        judge_signal(report)
    return report


def _ask(radar: X2Radar, report: Report) -> None:
    for name, reply in answers_of(radar, _ASK_S):
        if name != "ping":
            report.info[name] = str(reply.value if isinstance(reply, Reply) else reply)
        elif isinstance(reply, Pong):
            report.ping = PONG_NAMES.get(reply.code, f"{reply.code:#x}")
        elif reply == "no answer":
            return


def _level(value: float, limits: tuple[float, float]) -> str:
    """Return pass up to the first limit, warn up to the second, else fail."""
    return "pass" if value <= limits[0] else "warn" if value <= limits[1] else "fail"


def _judge_pace(report: Report, stamps: Sequence[tuple[float, int]], asked_hz: float) -> None:
    """Judge rate, jitter and losses; `stamps` are arrival times and frame numbers."""
    arrived_s, index = np.array(stamps).T
    span_s = arrived_s[-1] - arrived_s[0]
    reached_hz = float((index[-1] - index[0]) / span_s) if span_s > 0 else float("nan")
    late_ms = np.diff(arrived_s) * 1e3
    count = report.figures
    count |= {"frame_rate_asked_hz": asked_hz, "frame_rate_reached_hz": round(reached_hz, 3)}
    for name, share in (("p05", 0.05), ("p50", 0.5), ("p95", 0.95), ("p99", 0.99), ("max", 1)):
        count[f"interval_{name}_ms"] = round(float(np.quantile(late_ms, share)), 2)
    why = f"{reached_hz:.2f} of {asked_hz:g} frames a second"
    report.judge("rate", _level(abs(reached_hz / asked_hz - 1), _RATE_ERROR), why)
    p99_ms = count["interval_p99_ms"]
    why = f"99 % of the frames within {p99_ms:.1f} ms of the one before"
    report.judge("jitter", p99_ms <= 1e3 * _LATE_PERIODS / asked_hz, why)
    share = count["lost"] / max(1, count["frames"] + count["lost"])
    why = f"{count['lost']:.0f} frames lost ({share:.2%})"
    report.judge("losses", _level(share, _LOSS), why)
    level = _level(count["damaged"] / max(1, count["frames"]), _DAMAGED)
    report.judge("line", level, f"{count['damaged']:.0f} damaged stretches")
    if count["restarts"]:
        why = f"the counter or the module restarted {count['restarts']:.0f} times"
        report.judge("restarts", "fail", why)


def judge_signal(report: Report) -> None:
    """Measure the samples of `report.frames`, at least three; an empty room shows most."""
    judge = report.judge
    shape = report.frames[0].samples.shape
    rows: Any = np.stack([f.samples for f in report.frames if f.samples.shape == shape])
    if len(rows) < 3:
        return
    if not np.isfinite(rows).all():
        judge("samples", "fail", "some are not finite")
        rows = np.nan_to_num(rows, posinf=0.0, neginf=0.0)
    sigma = noise_sigma(rows)
    wide = np.complex128 if np.iscomplexobj(rows) else np.float64
    still = rows.mean(axis=0, dtype=wide)
    idle = 0.0 if np.iscomplexobj(rows) else float(np.median(still))
    clutter = np.abs(still - idle)
    strongest = int(clutter.argmax())
    peak = float(clutter[strongest])
    over_db = 20 * float(np.log10(max(peak, 1e-30) / max(sigma, 1e-30)))
    jitter_rad = phase_jitter_rad(rows - np.float32(idle), strongest)
    middle = np.median(rows.real, axis=0) + 1j * np.median(rows.imag, axis=0)
    far = np.abs(rows - middle) > _SPIKE_TIMES * max(peak, 10 * sigma)
    equal = int((np.diff(rows, axis=0) == 0).all(axis=1).sum())
    spikes, clipped = int(far.sum()), clipped_samples(rows)
    report.figures |= {
        "n_range": shape[0],
        "noise_sigma": float(f"{sigma:.4g}"),
        "clutter_over_noise_db": round(over_db, 1),
        "strongest_bin": strongest,
        "strongest_range_m": round(float(report.frames[0].axis.range_m[strongest]), 3),
        "phase_jitter_rad": float(f"{jitter_rad:.3g}"),
        "spike_samples": spikes,
        "clipped_samples": clipped,
        "equal_frames": equal,
    }
    dead = f"{equal} frames equal the one before: a dead receiver, or no receiver"
    is_dead = sigma == 0 or equal
    judge("noise", "fail" if is_dead else "pass", dead if is_dead else f"{sigma:.3g} per sample")
    is_strong = over_db >= _WEAK_CLUTTER_DB
    judge("clutter", is_strong, f"strongest still echo {over_db:.1f} dB over the noise")
    if is_strong:
        is_calm = jitter_rad <= _PHASE_JITTER_RAD
        judge("phase", is_calm, f"jitter {jitter_rad:.3g} rad in the strongest bin")
    judge("spikes", not spikes, f"{spikes} samples")
    judge("clipping", not clipped, f"{clipped} samples at an end stop")


def noise_sigma(rows: Samples) -> float:
    """Return the temporal noise, median over bins: rms, of the modulus if complex."""
    second = np.diff(rows, 2, axis=0)
    ratio = np.log(2) if np.iscomplexobj(rows) else _CHI2_MEDIAN
    per_bin = np.sqrt(np.median(np.abs(second) ** 2, axis=0) / ratio / 6)
    return float(np.median(per_bin))


def phase_jitter_rad(rows: Samples, at: int) -> float:
    """Return the rms phase noise from frame to frame in bin `at`, in radians."""
    if np.iscomplexobj(rows):
        signal = rows[:, at].astype(np.complex128)
    else:
        n = rows.shape[1]
        weight = np.zeros(n)
        weight[1 : (n + 1) // 2] = 2.0
        kernel = np.fft.ifft(weight)
        signal = rows.astype(np.float64) @ kernel[(at - np.arange(n)) % n]
    step_rad = np.angle(signal[1:] * np.conj(signal[:-1]))
    return float(np.sqrt(np.median(step_rad**2) / _CHI2_MEDIAN / 2))


def clipped_samples(rows: Samples) -> int:
    """Return how many samples lie at the highest or lowest value, `_FLAT_RUN` in a row."""
    n = 0
    for part in (rows.real, rows.imag) if np.iscomplexobj(rows) else (rows,):
        for end in (part.max(), part.min()):
            runs = np.lib.stride_tricks.sliding_window_view(part == end, _FLAT_RUN, axis=1)
            starts = np.flatnonzero(runs.all(axis=2).ravel())
            n += int(starts.size and starts.size + _FLAT_RUN - 1)
    return n
