"""From configuration to the parts that a run is made of, at start and at a reload."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakSet

from radard.alarm.panel import AlarmPolicy
from radard.alarm.sensitivity import alarm_policy
from radard.alarm.sensor_state import StateStore
from radard.alarm.zones import zone_fault, zone_warnings
from radard.clips.keeper import ClipKeeper
from radard.config import directories
from radard.config.config import Config
from radard.config.quiet_hours import Now, QuietHours, parse_quiet, time_zone
from radard.config.sections import AUTO_MODEL
from radard.detect.calibration import Calibration, load_calibration
from radard.detect.tamper import RoomStore, TamperWatch
from radard.errors import ConfigError, UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.decision import pet_limit_of
from radard.judge.model_choice import hop_warning, model_for
from radard.log import EventLog
from radard.outputs.records import Record, hello_record
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell, DwellShape, Notice
from radard.stream.source import FrameSource, open_source
from x2radar import wall_clock
from x2radar.command import installed_version
from x2radar.frame import StreamInfo

log = logging.getLogger("radard")
_making = threading.Lock()
_classifiers: "WeakSet[Classifier]" = WeakSet()  # those in use
RESTART_SECTIONS = ("sensor", "service")
_PIPELINE_SECTIONS = ("mount", "model", "gate", "decision")


@dataclass(slots=True)
class Parts:
    """Pipeline, alarm policy and stores that a worker uses; a reload replaces some."""

    config: Config  # what the rest was made of
    pipeline: Pipeline  # dwell to decision
    policy: AlarmPolicy  # decisions to alarm
    quiet: QuietHours  # when no alarm is wanted
    room: RoomStore  # where the room's reference is kept
    clips: ClipKeeper | None  # None when nothing is kept
    pet_limit: float  # of the rule; the pipeline's from the exchange on
    zone_fault: str = ""  # why nobody can raise an alarm


def logger_of(config: Config) -> logging.Logger:
    """Return where a sensor's run logs; that of one of several says which one."""
    return log.getChild(config.sensor.name) if config.is_one_of_several else log


def make_classifier(config: Config, stream: StreamInfo | None = None) -> Classifier | None:
    """Return the classifier that is named, shared by all radars; BundleError, ModelMismatch."""
    name = model_for(config.model.name, stream)
    if name == "none":
        return None
    bundle = load_bundle(name)
    with _making:
        made = next((each for each in _classifiers if each.bundle == bundle), None)
        if made is None:
            made = Classifier(bundle)
            _classifiers.add(made)
        return made


def classifier_for(
    stream: StreamInfo, config: Config, known: Classifier | None
) -> Classifier | None:
    """Return the classifier of a stream: the one that is known, unless `auto` means another."""
    name = model_for(config.model.name, stream)
    if known is None or config.model.name != AUTO_MODEL or known.bundle.name == name:
        return known
    return make_classifier(config, stream)


def make_parts(
    config: Config, pipeline: Pipeline, *, now: Now, is_live: bool, old: Parts | None = None
) -> Parts:
    """Make what `config` asks for around a pipeline; keep of `old` what has not changed."""
    range_m = pipeline.stream.axis.range_m
    swath = float(range_m[0]), float(range_m[-1])
    fault = zone_fault(config.zones, *swath)
    if fault and old is None:
        raise ConfigError(fault)
    warnings = [] if fault else list(zone_warnings(config.zones, *swath))
    was = old.config if old else None
    bundle = pipeline.classifier.bundle if pipeline.classifier else None
    if bundle is not None and (was is None or was.model != config.model):
        warnings.append(hop_warning(bundle, config.decision.hop_s, config.model.profile))
    for text in filter(None, warnings):
        logger_of(config).warning("%s", text)
    is_same = old is not None and old.config.gate.calibration == config.gate.calibration
    held = old.pipeline.calibration if old is not None and is_same else None
    use_calibration(config, pipeline, is_live=is_live, held=held)
    periods = [parse_quiet(text) for text in config.alarm.quiet]
    quiet = QuietHours(periods, time_zone(config.alarm.timezone), now)
    clips = old.clips if old else None
    # What made the decisions of a clip, in its root.
    about = {
        "sensor": config.sensor.name,
        "config_hash": config.digest(),
        "model": bundle.name if bundle else "none",
        "model_sha256": bundle.sha256 if bundle else "",
        "version": installed_version(),
    }
    room = _watch_for_tamper(config, pipeline, is_live=is_live, old=old)
    if was is None or was.clips != config.clips:
        clips, n_slow = None, pipeline.shape.n_slow
        if is_live and (folder := directories.clip_dir(config)) is not None:
            clips = ClipKeeper(config.clips, folder, pipeline.stream, n_slow, about)
    elif clips is not None:
        # The frames that it holds, and a clip that is being made, stay.
        clips.attributes = about
    return Parts(
        config=config,
        pipeline=pipeline,
        policy=alarm_policy(config.alarm, pipeline.policy),
        quiet=quiet,
        room=room,
        clips=clips,
        pet_limit=pet_limit_of(config, bundle),
        zone_fault=fault,
    )


def use_calibration(
    config: Config, pipeline: Pipeline, *, is_live: bool, held: Calibration | None = None
) -> None:
    """Give a pipeline the named calibration, or ConfigError; its room's, or what is `held`."""
    asked, is_real = config.gate.calibration, is_live and config.sensor.kind != "sim"
    is_own = asked == "auto"
    path = directories.calibration_file(config) if is_own else Path(asked)
    calibration = held if is_own else None
    try:
        if asked != "none" and (not is_own or (is_real and path.is_file())):
            calibration = _take_calibration(path, pipeline)
    except (ConfigError, OSError) as err:
        if not is_own:
            raise
        how = "keeps its calibration" if held is not None else "goes without calibration"
        log.warning("the gate %s: %s", how, err)
    if pipeline.calibration is not calibration:
        pipeline.use(calibration)


def _take_calibration(path: Path, pipeline: Pipeline) -> Calibration:
    calibration = load_calibration(path)
    was = pipeline.calibration
    if was is not None and was.text() == calibration.text():
        return was
    pipeline.use(calibration)
    made_utc = calibration.provenance.made_utc
    log.info("calibration: %s, %s", path, f"made {made_utc}" if made_utc else "date unknown")
    software, now = installed_version(), wall_clock.now()
    for reason in calibration.stale(device=pipeline.stream.device, software=software, now=now):
        log.warning("%s is stale: %s; make a new one with radard calibrate", path, reason)
    return calibration


def without_restart(config: Config, was: Config) -> Config:
    """Return what holds without a restart of a configuration that was read again; say the rest."""
    for name in RESTART_SECTIONS:
        if getattr(config, name) != getattr(was, name):
            log.warning("reload: changes of '%s' take a restart", name)
    return config.model_copy(update={name: getattr(was, name) for name in RESTART_SECTIONS})


def remake_parts(config: Config, old: Parts, *, is_live: bool) -> Parts:
    """Make the parts of a configuration that was read again, for the stream that goes on."""
    was, pipeline = old.config, old.pipeline
    config = without_restart(config, was)
    if any(getattr(config, name) != getattr(was, name) for name in _PIPELINE_SECTIONS):
        has_new = config.model != was.model
        stream = pipeline.stream
        classifier = make_classifier(config, stream) if has_new else pipeline.classifier
        pipeline = Pipeline(stream, config, classifier)
        if _cut_of(pipeline) != _cut_of(old.pipeline):
            is_hop = config.decision.hop_s != was.decision.hop_s
            what = "decision.hop_s" if is_hop else f"model.name: '{config.model.name}'"
            raise ConfigError(f"{what} takes other dwells; that takes a restart")
    return make_parts(config, pipeline, now=old.quiet.now, is_live=is_live, old=old)


def _cut_of(pipeline: Pipeline) -> tuple[DwellShape, int]:
    """Return what the ring must know of a pipeline: its dwells and the bins that it keeps."""
    classifier = pipeline.classifier
    return pipeline.shape, classifier.bundle.features.range_decimation if classifier else 1


def make_store(config: Config, events: EventLog, *, is_live: bool) -> StateStore:
    """Return where arming is kept: nowhere for a replay or a demo, apart for a simulation."""
    # An alarm that is on is kept only in a folder that was named: a run by hand begins afresh.
    is_named = directories.named_state_dir(config) is not None
    path = _kept_file(config, "panel", is_live=is_live)
    return StateStore(events, path.stem if path else None, keeps_alarms=is_named)


def hello_of(parts: Parts, source: FrameSource, *, is_armed: bool, has_state: bool) -> Record:
    """Return the first line of a run; `has_state`: how it is armed was kept."""
    config, pipeline = parts.config, parts.pipeline
    files = [_kept_file(config, "room.npz", is_live=source.is_live)]
    if has_state:
        files.append(directories.log_path(config))
    if config.gate.calibration == "auto" and pipeline.calibration is not None:
        files.append(directories.calibration_file(config))
    found = [str(path) for path in files if path is not None and path.is_file()]
    hello = hello_record(pipeline, config, is_armed=is_armed, taken=(*config.taken, *found))
    return hello | {name: getattr(source, name, None) for name in ("module", "started_utc")}


def _kept_file(config: Config, ending: str, *, is_live: bool) -> Path | None:
    is_sim = config.sensor.kind == "sim"
    if not is_live or (is_sim and directories.named_state_dir(config) is None):
        return None
    name = f"{config.sensor.name}{'.sim' if is_sim else ''}.{ending}"
    return directories.state_dir(config) / name


def _watch_for_tamper(
    config: Config, pipeline: Pipeline, *, is_live: bool, old: Parts | None
) -> RoomStore:
    """Let a pipeline look for tamper, if that is wanted; return where the reference is kept."""
    stream = room_of(config, pipeline)
    same = old if old is not None and old.room.stream == stream else None
    if same is not None and same.config.tamper == config.tamper:
        pipeline.tamper = same.pipeline.tamper
        return same.room
    store = RoomStore(_kept_file(config, "room.npz", is_live=is_live), stream)
    # Other settings are no reason to take what is there now for the room.
    watch = same.pipeline.tamper if same is not None else None
    known = watch.known if watch is not None else None
    if config.tamper.enabled:
        hop_s = pipeline.shape.hop_s
        pipeline.tamper = TamperWatch(config.tamper, hop_s, known or store.load())
    else:
        pipeline.tamper = None
    return store


def room_of(config: Config, pipeline: Pipeline) -> str:
    """Return whose reference this is: with another module, swath or calibration it is another."""
    axis, is_sim = pipeline.stream.axis, config.sensor.kind == "sim"
    n_bins = axis.n_range // _cut_of(pipeline)[1]
    made_utc = pipeline.calibration.provenance.made_utc if pipeline.calibration else ""
    return ", ".join(
        (
            str(config.sensor.port) if is_sim else pipeline.stream.device,
            f"{axis.kind}, {n_bins} bins from {axis.range_offset_m:.3f} m",
            f"{axis.bin_length_m:.4g} m",
            f"{axis.carrier_hz:.4g} Hz, {pipeline.stream.frame_rate_hz:.3g} frames a second",
            f"calibrated {made_utc or ('then' if pipeline.calibration else 'never')}",
        )
    )


@dataclass(frozen=True, slots=True)
class Listening:
    """An open port, and the pipeline for its stream with the configured model."""

    source: FrameSource
    pipeline: Pipeline

    def dwells(self, duration_s: float, *, skip_s: float = 0.0) -> Iterator[Dwell | Notice]:
        """Yield dwells and notices of `duration_s`, behind `skip_s`, in this thread."""
        ring = self.pipeline.make_ring()
        rate_hz = self.pipeline.stream.frame_rate_hz
        first: int | None = None
        for frame in self.source.frames():
            first = frame.index if first is None else first
            at_s = (frame.index - first) / rate_hz
            if at_s >= skip_s + duration_s:
                return
            if at_s >= skip_s:
                yield from ring.items(frame)


@contextmanager
def listen(config: Config) -> Iterator[Listening]:
    """Open the port of a configuration and make its pipeline; close it in the end."""
    sensor = config.sensor
    if sensor.port is None:
        raise UsageError("no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE")
    classifier = make_classifier(config)
    # A device that is lost ends the work: half of it is worth nothing.
    source = open_source(sensor.port, speed=sensor.speed, wait=sensor.wait, quit_on_loss=True)
    try:
        fitting = classifier_for(source.stream, config, classifier)
        yield Listening(source, Pipeline(source.stream, config, fitting))
    finally:
        source.close()
