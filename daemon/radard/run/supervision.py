"""Supervision: what a process does beside its radars; signals, outputs, the heartbeat, reloads.

The main thread supervises: it never waits for a disk, a port or a reader of stdout while
radars run, so signals are always heard.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from radard.config.config import Config
from radard.config.directories import runtime_dir
from radard.errors import RadardError
from radard.health.heartbeat import Heartbeat, Watched
from radard.health.status_file import status_path
from radard.health.systemd import Notifier
from radard.health.thread_dump import force_after, state_dump, state_of
from radard.outputs.fanout import Outputs
from radard.run.control import ControlServer
from radard.run.os_signals import Signals
from radard.run.radar_run import RadarRun, RunOptions
from radard.run.sink_watch import SinkWatch

log = logging.getLogger("radard")
_BEAT_S = 1.0  # chosen: outputs in trouble are noticed that late
_DEADLINE_S = 4.5  # from the first signal to a forced end; chosen: below 5 s


@dataclass(frozen=True, slots=True)
class RadarChange:
    """What a reload changes: names of radars that go, and radars that come."""

    gone: Sequence[str] = ()
    new: Sequence[RadarRun] = ()


class Supervisor:
    """What runs of one radar and of several have in common; heeds `signals`."""

    def __init__(
        self, config: Config, options: RunOptions, signals: Signals, radars: Sequence[RadarRun]
    ) -> None:
        self._config = config
        self._options = options
        self.signals = signals
        self._radars = list(radars)
        self._notifier = Notifier()
        self._force: threading.Timer | None = None
        self._is_stuck = False
        self._outputs = Outputs(
            [radar.host for radar in radars], stdout_is_terminal=options.stdout_is_terminal
        )
        self._folder = folder = runtime_dir(config)
        self._heart = Heartbeat([self._watched(radar) for radar in radars], self._notifier)
        self._control = ControlServer(self._radars, folder)
        self._watch = SinkWatch()
        self._troubled: dict[str, set[str]] = {radar.name: set() for radar in radars}
        for radar in radars:
            radar.bind(self._outputs)

    def _watched(self, radar: RadarRun) -> Watched:
        path = status_path(self._folder, radar.name)
        return Watched(radar.name, radar.health, path, radar.panel)

    def _show_life(self) -> None:
        """Begin to show that this process lives, and to take commands; a second call is none."""
        self._heart.start()
        if not self._outputs.can_wait:
            self._control.start()

    def _supervise(self, goes_on: Callable[[], bool]) -> bool:
        """Heed signals while it goes on; return whether one asked for the end."""
        while goes_on():
            self._heart.main_is_alive()
            self._outputs.retry()
            self._look_at_outputs()
            self.signals.wake.wait(_BEAT_S)
            self.signals.wake.clear()
            # Before the end that may have been asked for since.
            if self.signals.take("dump"):
                log.warning("state %s", state_dump(self._states()))
            if self.signals.take("stop"):
                self._force = force_after(_DEADLINE_S)
                return True
            if self.signals.take("reload"):
                self._reload()
        return False

    def _look_at_outputs(self) -> None:
        """Let every radar's health know which of its outputs are in trouble, and which no more."""
        if self._outputs.can_wait:
            # Nobody is guarded by it, and a replay says the same every time.
            return
        found = self._watch.look(self._outputs.sinks) | self._outputs.faults
        for radar in self._radars:
            own = {name: why for (of, name), why in found.items() if of in {None, radar.name}}
            for name in self._troubled[radar.name] | set(own):
                radar.tell(radar.health.complain(f"output {name}", own.get(name, "")))
            self._troubled[radar.name] = set(own)

    def _states(self) -> dict[str, object]:
        states: dict[str, object] = {}
        for radar in self._radars:
            state = state_of(radar.health, radar.panel())
            states |= {radar.name: state} if self._config.is_one_of_several else state
        return states

    def _shut(self) -> None:
        """Report the shutdown and close what all radars share."""
        self._control.stop()
        self._heart.stop()
        self._outputs.close()
        if self._is_stuck:
            # The interpreter's own end would wait for ever for what a stuck thread holds: stdout,
            # or HDF5's lock.
            (self._force or force_after(_DEADLINE_S)).join()
        elif self._force is not None:
            self._force.cancel()

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
            change = self._change_of_radars(config)
            remade = [
                (radar, parts)
                for radar in self._radars
                if radar.name not in change.gone
                and (parts := radar.remade(self._of(radar, config))) is not None
            ]
        except RadardError as err:
            log.warning("reload: the old configuration stays: %s", err)
        else:
            hellos = []
            for radar, parts in remade:
                radar.exchange(parts)
                hellos.append(radar.hello(parts))
            kept = {"sensor": self._config.sensor, "service": self._config.service}
            self._config = config.model_copy(update=kept)
            self._change_radars(change)
            self._outputs.reload(self._config, hellos)
            self._begin(change.new)
            log.info("reload: done")
        self._notifier.ready(self._heart.status.state)

    def _change_of_radars(self, config: Config) -> RadarChange:  # noqa: ARG002 - for several
        """Return which radars a configuration takes away and adds; raises as `RadarRun`."""
        return RadarChange()

    def _change_radars(self, change: RadarChange) -> None:
        """Take radars away, and let those that are new be seen and heard; they begin later."""
        for name in change.gone:
            self._radars[:] = [radar for radar in self._radars if radar.name != name]
            self._heart.remove(name)
            self._control.remove(name)
            self._outputs.remove(name)
            del self._troubled[name]
        for radar in change.new:
            self._radars.append(radar)
            radar.bind(self._outputs)
            self._heart.add(self._watched(radar))
            self._control.add(radar)
            self._outputs.add(radar.host)
            self._troubled[radar.name] = set()

    def _begin(self, radars: Sequence[RadarRun]) -> None:
        """Let radars that are new begin to work, once they have their outputs."""

    def _of(self, radar: RadarRun, config: Config) -> Config:
        return config.of_sensor(radar.name) if config.is_one_of_several else config
