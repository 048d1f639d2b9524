"""Several radars in one process: each kept by a thread of its own, none stopped by another.

A device that is absent is waited for. Work that breaks off, unless a lost device explains it,
is started again after a pause; a radar that never came to work, because its model does not fit
or its recording is missing, stays away until the configuration is put right and the process
is started again. A reload adds radars and takes others away. Health says which one is in
trouble; the process ends when all have ended.
"""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

from radard.config.config import Config
from radard.errors import OutputError, RadardError, UsageError
from radard.run.os_signals import Signals
from radard.run.radar_run import RadarRun, RunOptions
from radard.run.supervision import RadarChange, Supervisor
from x2radar.errors import X2RadarError

log = logging.getLogger("radard")
# Chosen: a passing fault is soon over, a lasting one must not fill the log.
_FIRST_PAUSE_S = 5.0
_LONGEST_PAUSE_S = 300.0
_AT_ONCE = 8
"""Radars that are brought up at the same time: chosen. A module that is answered late, because a
hundred others are asked for their names, is reset and asked again, which makes it later still."""
_TURN_S = 60.0  # chosen: nobody waits longer for ports that hang
_LOOK_S = 0.2  # chosen: so late a radar that waits for its turn heeds the end
_JOIN_S = 4.0  # chosen: below the 4.5 s of a forced end


class Turns:
    """Turns of radars to be brought up, so many at the same time."""

    def __init__(self, n: int | None = None) -> None:
        self._turns = threading.Semaphore(n or _AT_ONCE)
        self._held: set[object] = set()
        self._lock = threading.Lock()

    def take(self, who: object, halt: threading.Event) -> None:
        """Wait for a turn, a minute at most, or for the end."""
        end_s = time.monotonic() + _TURN_S
        while not self._turns.acquire(timeout=_LOOK_S):
            if halt.is_set() or time.monotonic() > end_s:
                return
        with self._lock:
            self._held.add(who)

    def give(self, who: object) -> None:
        """Give a turn back; a second time, or without one, does nothing."""
        with self._lock:
            if who not in self._held:
                return
            self._held.remove(who)
        self._turns.release()


class Keeper:
    """Keep one radar at work; its device is brought up when it has its turn."""

    def __init__(self, radar: RadarRun, wake: Callable[[], None], turns: Turns) -> None:
        self.radar = radar
        self.stuck: list[str] = []
        self.has_lost_output = False
        """Whether it ended because an output that the run was started for is gone."""
        self._wake = wake
        self._turns = turns
        self._halt = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"{radar.name} keeper", daemon=True)

    @property
    def is_alive(self) -> bool:
        """Whether it is at work, or will be again."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Ask for the end; returns at once."""
        self._halt.set()
        self.radar.stop()
        self._over.set()

    def join(self, timeout_s: float) -> None:
        """Wait for the end."""
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self.stuck.append(self._thread.name)

    def over(self) -> None:
        """Note that the radar's work is over."""
        self._over.set()

    def _run(self) -> None:
        try:
            self._keep()
        except (BrokenPipeError, OutputError) as err:
            self.radar.failure, self.has_lost_output = err, True
            self.radar.health.on_end(str(err))
        self._wake()

    def _keep(self) -> None:
        radar, pause_s = self.radar, _FIRST_PAUSE_S
        why = "stopped"
        while not self._halt.is_set():
            has_worked = self._work()
            failure = radar.failure
            if isinstance(failure, BrokenPipeError | OutputError):
                raise failure
            if self._halt.is_set():
                break
            if failure is None:
                why = "end of stream"
                break
            why = " ".join(str(failure).split()) or repr(failure)
            radar.log.error("%s", why)
            if not has_worked:
                break
            radar.tell(radar.health.on_failure(why))
            if self._halt.wait(pause_s):
                break
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            radar.tell(radar.health.on_start())
        radar.tell(radar.health.on_end("stopped" if self._halt.is_set() else why))

    def _work(self) -> bool:
        """Work until the stream ends, something fails or `stop`; return whether work began."""
        radar, has_worked = self.radar, False
        radar.failure = None
        try:
            self._turns.take(self, self._halt)
            radar.open(self._on_notice, is_wanted=lambda: not self._halt.is_set())
            self._turns.give(self)
            with radar.prepare() as tap:
                radar.start(tap)
                has_worked = True
                # `stop` sets the one and then the other.
                if not self._halt.is_set():
                    self._over.wait()
                radar.stop()
                self.stuck = radar.finish()
                self._over.clear()
        except (RadardError, X2RadarError) as err:
            radar.failure = err
        except Exception as err:
            # Whatever it is, the other radars go on.
            radar.log.exception("the run of %s broke off", radar.name)
            radar.failure = err
        finally:
            self._turns.give(self)
            radar.close()
        return has_worked

    def _on_notice(self, _kind: str, _reason: str) -> None:
        # It may take for ever until an absent one comes.
        self._turns.give(self)
        self.radar.tell(self.radar.health.status)


class SeveralRadars(Supervisor):
    """Run all radars of `sensors`.

    Raises UsageError if it asks for what only one radar can have, BundleError or ModelMismatch if
    a model cannot be had.
    """

    def __init__(self, config: Config, options: RunOptions) -> None:
        if options.record is not None:
            msg = "--record: takes the frames of one radar; name it with --port"
            raise UsageError(msg)
        signals = Signals()
        self._turns = Turns()
        self._keepers: list[Keeper] = []
        self._left: list[Keeper] = []
        self._ask = signals.ask
        radars = [self._made(each, options) for each in config.each()]
        super().__init__(config, options, signals, radars)
        self._keepers = [self._keeper(radar) for radar in radars]

    def go(self) -> int:
        """Run until all have ended or a signal asks for it; return the exit code."""
        is_stopped = False
        with self.signals:
            self.signals.opened()
            try:
                can_wait = all(radar.can_wait for radar in self._radars)
                self._outputs.open(self._config, can_wait=can_wait)
                self._heart.main_is_alive()
                self._show_life()
                for keeper in self._keepers:
                    keeper.start()
                is_stopped = self._supervise(self._goes_on)
            finally:
                self._end()
                self._shut()
        lost = [keeper.radar.failure for keeper in self._keepers if keeper.has_lost_output]
        failures = lost or [radar.failure for radar in self._radars]
        failure = next((each for each in failures if each is not None), None)
        if failure is not None and (lost or self._is_stuck or not is_stopped):
            raise failure
        return 0

    def _made(self, config: Config, options: RunOptions) -> RadarRun:
        over = partial(self._is_over, config.sensor.name)
        return RadarRun(config, options, over, lambda: self._ask("reload"))

    def _keeper(self, radar: RadarRun) -> Keeper:
        return Keeper(radar, self.signals.wake.set, self._turns)

    def _change_of_radars(self, config: Config) -> RadarChange:
        """As `Supervisor`; a radar on another port goes, and comes again."""
        before = {radar.name: _source_of(radar.config) for radar in self._radars}
        after = {each.sensor.name: each for each in config.each()}
        stay = {name for name, each in after.items() if before.get(name) == _source_of(each)}
        new = [self._made(each, self._options) for name, each in after.items() if name not in stay]
        return RadarChange([name for name in before if name not in stay], new)

    def _change_radars(self, change: RadarChange) -> None:
        going = [keeper for keeper in self._keepers if keeper.radar.name in change.gone]
        for keeper in going:
            log.warning("%s: taken away by a reload", keeper.radar.name)
            keeper.stop()
        end_s = time.monotonic() + _JOIN_S
        for keeper in going:
            keeper.join(max(0.1, end_s - time.monotonic()))
            if keeper.stuck:
                log.warning("stuck and left behind: %s", ", ".join(keeper.stuck))
        super()._change_radars(change)
        self._left += [keeper for keeper in going if keeper.is_alive]
        self._keepers = [keeper for keeper in self._keepers if keeper not in going]

    def _begin(self, radars: Sequence[RadarRun]) -> None:
        """As `Supervisor`."""
        for radar in radars:
            log.warning("%s: added by a reload", radar.name)
            keeper = self._keeper(radar)
            self._keepers.append(keeper)
            keeper.start()

    def _goes_on(self) -> bool:
        is_read = not any(keeper.has_lost_output for keeper in self._keepers)
        return is_read and any(keeper.is_alive for keeper in self._keepers)

    def _is_over(self, name: str) -> None:
        for keeper in self._keepers:
            if keeper.radar.name == name:
                keeper.over()

    def _end(self) -> None:
        going = [keeper for keeper in self._keepers if keeper.is_alive]
        for keeper in going:
            keeper.stop()
        for keeper in going:
            keeper.join(_JOIN_S)
        is_left = any(keeper.is_alive for keeper in self._left)
        self._is_stuck = is_left or any(keeper.stuck for keeper in self._keepers)


def _source_of(config: Config) -> tuple[str | None, str]:
    """Return what a radar must begin again for: its port and speed."""
    return config.sensor.port, config.sensor.speed
