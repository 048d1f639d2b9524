"""Process: a list of radars, and what they share; one radar is a list of one.

The main thread supervises and never waits for a disk, a port or a reader of stdout while radars
run, so signals are always heard. Each radar has a `Keeper`, a thread that none other stops.
"""

import contextlib
import json
import logging
import resource
import threading
import time
from dataclasses import asdict
from functools import partial
from queue import Empty

from radard.config.config import Config
from radard.config.directories import own_folder, runtime_dir, state_lock
from radard.errors import OutputError, RadardError, UsageError
from radard.health.heartbeat import Heartbeat, Notifier, Watched, status_path
from radard.outputs.fanout import Outputs
from radard.outputs.records import ended_record
from radard.outputs.registry import SinkWatch
from radard.run.components import RESTART_SECTIONS
from radard.run.control import ControlServer
from radard.run.os_signals import Signals, force_after, stacks
from radard.run.pool import WorkerPool
from radard.run.sensor import RunOptions, Sensor
from x2radar.errors import X2RadarError

log = logging.getLogger("radard")
_ENDS_WITH_IT = "a simulation's clips, labels and settings end with it; --state DIR keeps them"
_BEAT_S = 1.0  # so late outputs in trouble, and silence, are noticed
_DEADLINE_S = 4.5  # from the first signal to a forced end: service managers allow no less than 5 s
_MAX_FILES = 8192  # a hundred radars, their outputs and 256 pages need a tenth of it
_JOIN_S = 4.0  # for all radars together: below the deadline
# A passing fault is soon over, a lasting one must not fill the log.
_FIRST_PAUSE_S = 5.0
_MAX_PAUSE_S = 300.0
MAX_AT_ONCE = 8  # brought up at once: more are answered so late that they are reset again
_MAX_WAIT_S = 60.0  # nobody waits longer for ports that hang
_LOOK_S = 0.2  # so late a radar that waits to be brought up heeds the end


def run(config: Config, options: RunOptions) -> int:
    """Run the daemon; return the exit code, or raise RadardError, X2RadarError with it."""
    # Many radars, pages and outputs are open at once; the usual limit is 1024, or 256.
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, _MAX_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    with state_lock(config):
        return Process(config, options).go()


class Keeper:
    """Keep a sensor of a process at work, in a thread of its own.

    The only radar ends with what ends its work. One of several is started again after a pause; one
    that never came to work stays away until the process is started again.
    """

    def __init__(self, sensor: Sensor, process: "Process") -> None:
        self.sensor = sensor
        self.failure: BaseException | None = None  # what ended its work, but for the stream
        self.stuck: list[str] = []
        self._process = process
        self._turn = contextlib.ExitStack()  # of being brought up; closed, it is another's
        self._begin_again = sensor.config().is_one_of_several
        # Lives while the sensor is at work, or will be again.
        self.thread = threading.Thread(target=self._run, name=f"{sensor.sensor} keeper")
        self.thread.daemon = True

    @property
    def has_lost_output(self) -> bool:
        """Whether its work ended because an output that the run was started for is gone."""
        return isinstance(self.failure, BrokenPipeError | OutputError)

    def _run(self) -> None:
        status = self.sensor.health.on_end(self._keep())
        with contextlib.suppress(BrokenPipeError, OutputError):
            if not isinstance(self.failure, BrokenPipeError):
                self.sensor.tell(status or self.sensor.health.status)
        self._process.signals.wake.put(None)

    def _keep(self) -> str:
        """Keep the sensor at work until the end; return why that came."""
        sensor, pause_s = self.sensor, _FIRST_PAUSE_S
        while True:
            has_worked = self._work()
            if self.failure is None or (self.sensor.halt.is_set() and not self.has_lost_output):
                return "stopped" if self.sensor.halt.is_set() else "end of stream"
            why = " ".join(str(self.failure).split()) or repr(self.failure)
            if self.has_lost_output or not self._begin_again:
                return why
            sensor.log.error("%s", why)
            if not has_worked:
                return why
            sensor.leave()
            sensor.tell(sensor.health.on_failure(why))
            if sensor.halt.wait(pause_s):
                return "stopped"
            pause_s = min(2 * pause_s, _MAX_PAUSE_S)
            sensor.tell(sensor.health.on_start())

    def _work(self) -> bool:
        """Work until the stream ends, something fails or `stop`; return whether work began."""
        sensor, has_worked, opened = self.sensor, False, None
        self.failure = None
        try:
            end_s = time.monotonic() + _MAX_WAIT_S
            while not sensor.halt.is_set() and time.monotonic() <= end_s:
                if self._process.turns.acquire(timeout=_LOOK_S):
                    self._turn.callback(self._process.turns.release)
                    break
            opened = sensor.open(self._on_notice)
            self._turn.close()
            self._process.open_outputs()
            run = sensor.start(opened)
            has_worked = True
            # `stop` may have come before there was a run that it could end.
            if not sensor.halt.is_set():
                run.end.wait()
            run.stop()
            self.stuck = run.finish()
            self.failure = run.failure
        except (RadardError, X2RadarError, BrokenPipeError) as err:
            self.failure = err
        except Exception as err:
            # Whatever it is, the other radars go on.
            if self._begin_again:
                sensor.log.exception("the run of %s broke off", sensor.sensor)
            self.failure = err
        finally:
            self._turn.close()
            if opened is not None and not opened.close():
                self.stuck.append("recording")
        return has_worked

    def _on_notice(self, _kind: str, _reason: str) -> None:
        # It may take for ever until an absent one comes.
        self._turn.close()
        self._process.open_outputs()
        self.sensor.tell(self.sensor.health.status)


class Process:
    """Run the radars of a configuration until their streams, or a signal, end them."""

    def __init__(self, config: Config, options: RunOptions) -> None:
        if options.record is not None and config.is_one_of_several:
            raise UsageError("--record: takes the frames of one radar; name it with --port")
        self.signals = Signals()
        self._config = config
        self._options = options
        self._force: threading.Timer | None = None
        self.turns = threading.Semaphore(MAX_AT_ONCE)  # of radars to be brought up
        self._pool = WorkerPool()
        self._outputs = Outputs(stdout_is_terminal=options.stdout_is_terminal)
        self._opening = threading.Lock()
        self._keepers: list[Keeper] = []
        self._left: list[Keeper] = []
        self._notifier = Notifier()
        self._folder = runtime_dir(config)
        self._heart = Heartbeat(self._notifier)
        self._control = ControlServer(self._folder)
        self._watch = SinkWatch()
        self._troubled: dict[str, set[str]] = {}
        self._add([self._make_keeper(each) for each in config.each()])

    @property
    def sensors(self) -> list[Sensor]:
        """Sensors that the process runs."""
        return [keeper.sensor for keeper in self._keepers]

    def go(self) -> int:
        """Run until all have ended or a signal asks for it; return the exit code."""
        is_stopped = is_stuck = False
        with self.signals:
            try:
                if self._config.is_one_of_several:
                    self.open_outputs()
                for keeper in self._keepers:
                    keeper.thread.start()
                is_stopped = self._supervise()
            finally:
                self._stop(self._keepers)
                is_stuck = any(k.thread.is_alive() for k in self._left)
                is_stuck |= any(k.stuck for k in self._keepers)
                self._control.stop()
                self._heart.stop()
                self._outputs.close()
                self._pool.close()
                if is_stuck:
                    # The interpreter's own end would wait for ever for what a stuck thread holds:
                    # stdout, or HDF5's lock.
                    (self._force or force_after(_DEADLINE_S)).join()
                elif self._force is not None:
                    self._force.cancel()
        lost = [keeper.failure for keeper in self._keepers if keeper.has_lost_output]
        failures = lost or [keeper.failure for keeper in self._keepers]
        failure = next((each for each in failures if each is not None), None)
        if failure is not None and (lost or is_stuck or not is_stopped):
            raise failure
        return 0

    def _make_keeper(self, config: Config) -> Keeper:
        reload = partial(self.signals.ask, "reload")
        return Keeper(Sensor(config, self._options, self._outputs, self._pool, reload), self)

    def open_outputs(self) -> None:
        """Open the outputs, once, an only radar's when its port is; now it is seen to live."""
        with self._opening:
            can_wait = all(sensor.can_wait for sensor in self.sensors)
            if not self._outputs.is_open:
                self._outputs.open(self._config, can_wait=can_wait)
                for record in self._outputs.log.open_events():
                    if not any(sensor.owns(record) for sensor in self.sensors):
                        self._outputs.put(ended_record(record))
                if self._config.service.state_dir == own_folder():
                    logging.getLogger("radard.dashboard").info(_ENDS_WITH_IT)
                self._heart.main_is_alive()
                self._heart.start()
                if not can_wait:
                    self._control.start(self.sensors)

    def _supervise(self) -> bool:
        """Heed signals while radars are kept; return whether one asked for the end."""
        while any(k.thread.is_alive() for k in self._keepers):
            if any(k.has_lost_output for k in self._keepers):
                return False
            self._heart.main_is_alive()
            self._outputs.retry()
            self._look_at_outputs()
            for sensor in self.sensors:
                sensor.look_up()
            with contextlib.suppress(Empty):
                self.signals.wake.get(timeout=_BEAT_S)
            # Before the end that may have been asked for since.
            if self.signals.take("dump"):
                log.warning("state %s", json.dumps({**self._states(), "threads": stacks()}))
            if self.signals.take("stop"):
                self._force = force_after(_DEADLINE_S)
                return True
            if self.signals.take("reload"):
                self._reload()
        return False

    def _look_at_outputs(self) -> None:
        """Let every radar's health know which of its outputs are in trouble, and which no more."""
        if self._outputs.can_wait or not self._outputs.is_open:
            # Nobody is guarded by it, and a replay says the same every time.
            return
        found = self._watch.look(self._outputs.sinks) | self._outputs.faults
        for sensor in self.sensors:
            own = {name: why for (of, name), why in found.items() if of in {None, sensor.sensor}}
            for name in self._troubled.get(sensor.sensor, set()) | set(own):
                sensor.complain(f"output {name}", own.get(name, ""))
            self._troubled[sensor.sensor] = set(own)

    def _states(self) -> dict[str, object]:
        states = {s.sensor: {**asdict(s.health.status), **_told(s)} for s in self.sensors}
        return dict(states if self._config.is_one_of_several else states[self.sensors[0].sensor])

    def _stop(self, keepers: list[Keeper]) -> None:
        going = [keeper for keeper in keepers if keeper.thread.is_alive()]
        for keeper in going:
            keeper.sensor.stop()
        end_s = time.monotonic() + _JOIN_S
        for keeper in going:
            keeper.thread.join(max(0.1, end_s - time.monotonic()))
            if keeper.thread.is_alive():
                keeper.stuck.append(keeper.thread.name)

    def _reload(self) -> None:
        """Read the configuration again and hand it to the radars; their streams go on."""
        if self._options.reload is None:
            return
        self._notifier.reloading()
        try:
            config = self._options.reload()
            if bool(config.sensors) != bool(self._config.sensors):
                log.warning("reload: from one radar to several, or back, takes a restart")
                config = config.model_copy(update={"sensors": self._config.sensors})
            gone, new = self._compare(config)
            remade = []
            for sensor in (keeper.sensor for keeper in self._keepers if keeper not in gone):
                own = config.of_sensor(sensor.sensor) if config.is_one_of_several else config
                remade.append(sensor.remake(own))
        except (RadardError, X2RadarError) as err:
            why = f"the old configuration stays: {err}"
            log.warning("reload: %s", why)
        else:
            hellos = [hello for hold in remade if (hello := hold()) is not None]
            kept = {name: getattr(self._config, name) for name in RESTART_SECTIONS}
            self._config = config.model_copy(update=kept)
            self._take_away(gone, again={keeper.sensor.sensor for keeper in new})
            self._add(new)
            if self._outputs.is_open:
                self._outputs.reload(self._config, hellos)
            for keeper in new:
                log.warning("%s: added by a reload", keeper.sensor.sensor)
                keeper.thread.start()
            log.info("reload: done")
            why = ""
        for sensor in self.sensors:
            sensor.complain("reload", why)
        self._notifier.ready(self._heart.status.state)

    def _compare(self, config: Config) -> tuple[list[Keeper], list[Keeper]]:
        """Return which radars go and come; both on another port, or if a fault ended the work."""
        if not config.is_one_of_several:
            return [], []
        at_work = [k.sensor for k in self._keepers if k.thread.is_alive() or k.failure is None]
        before = {each.sensor: _source_of(each.config()) for each in at_work}
        after = {each.sensor.name: each for each in config.each()}
        stay = {name for name, each in after.items() if before.get(name) == _source_of(each)}
        gone = [keeper for keeper in self._keepers if keeper.sensor.sensor not in stay]
        return gone, [self._make_keeper(e) for name, e in after.items() if name not in stay]

    def _take_away(self, gone: list[Keeper], again: set[str]) -> None:
        for keeper in gone:
            log.warning("%s: taken away by a reload", keeper.sensor.sensor)
        self._stop(gone)
        self._keepers = [keeper for keeper in self._keepers if keeper not in gone]
        for keeper in gone:
            name = keeper.sensor.sensor
            if keeper.stuck:
                log.warning("stuck and left behind: %s", ", ".join(keeper.stuck))
            elif name not in again:
                keeper.sensor.end_events("taken away by a reload")
            self._heart.remove(name)
            self._control.remove(name)
            self._outputs.remove(name)
            self._troubled.pop(name, None)
        self._left += [keeper for keeper in gone if keeper.thread.is_alive()]

    def _add(self, new: list[Keeper]) -> None:
        """Let new radars be seen and heard; they begin once they have their outputs."""
        self._keepers += new
        self._pool.fit(len(self._keepers))
        for sensor in (keeper.sensor for keeper in new):
            name = sensor.sensor
            path, panel = status_path(self._folder, name), partial(_told, sensor)
            self._heart.add(Watched(name, sensor.health, path, panel))
            self._control.add(sensor)
            self._outputs.add(sensor)


def _told(sensor: Sensor) -> dict[str, object]:
    """Return what a status file says of a sensor besides its health."""
    state = sensor.panel()
    told = state.as_record(sensor.mark()) if state is not None else {}
    return {**told, "decision_age_s": round(sensor.health.age_s, 1)}


def _source_of(config: Config) -> tuple[str | None, str]:
    """Return what a radar must begin again for: its port and speed."""
    return config.sensor.port, config.sensor.speed
