"""Service: runs one radar, or several, until streams or the user end it.

What belongs to a radar is in `radard.run.radar_run`, what a process needs beside it in
`radard.run.supervision`; `radard.run.several` keeps more than one. Further threads: the
*heartbeat* (`radard.health.heartbeat`) shows that all this lives, and every output has its own.
"""

from radard.config.config import Config
from radard.config.state_lock import state_lock
from radard.run.components import Parts
from radard.run.os_signals import Signals
from radard.run.radar_run import RadarRun, RunOptions
from radard.run.several import SeveralRadars
from radard.run.supervision import Supervisor

__all__ = ["RunOptions", "run"]


def run(config: Config, options: RunOptions) -> int:
    """Run the daemon; return the exit code.

    Raises RadardError or X2RadarError with the exit code that the command ends with. Nothing was
    written when the fault is in what was asked for.
    """
    with state_lock(config):
        if config.is_one_of_several:
            return SeveralRadars(config, options).go()
        return OneRadar(config, options).go()


class OneRadar(Supervisor):
    """Run one radar; the process ends with it."""

    def __init__(self, config: Config, options: RunOptions) -> None:
        signals = Signals()
        self.radar = RadarRun(config, options, signals.wake.set, lambda: signals.ask("reload"))
        super().__init__(config, options, signals, [self.radar])

    @property
    def parts(self) -> Parts:
        """See `RadarRun.parts`."""
        return self.radar.parts

    def go(self) -> int:
        """Run until the end; return the exit code, or raise what ended it."""
        radar = self.radar
        with self.signals:
            self._open()
            why = "ended by a fault at the start"
            try:
                with radar.prepare() as tap:
                    self._outputs.open(self._config, can_wait=radar.can_wait)
                    radar.start(tap)
                    self._heart.main_is_alive()
                    self._show_life()
                    why = self._until_over()
            finally:
                radar.close()
                radar.health.on_end(why)
                self._shut()
        if radar.failure is not None:
            raise radar.failure
        return 0

    def _open(self) -> None:
        """Open the port, which may mean to wait for a device; the heartbeat beats meanwhile."""
        try:
            self.radar.open(self._on_notice)
        except BaseException as err:
            self.radar.health.on_end(" ".join(str(err).split()) or "stopped")
            if self._outputs.is_open:
                self._shut()
            raise
        self.signals.opened()

    def _on_notice(self, _kind: str, _reason: str) -> None:
        # Before there is a stream: outputs that show the state do so, the others stay silent.
        if not self._outputs.is_open:
            self._outputs.open(self._config)
            self._show_life()

    def _until_over(self) -> str:
        """Supervise until the end; return why it ended."""
        radar = self.radar
        is_stopped = self._supervise(lambda: radar.is_working)
        radar.stop()
        self._is_stuck = bool(radar.finish())
        why = "stopped" if is_stopped else "end of stream"
        if radar.failure is not None:
            why = " ".join(str(radar.failure).split())
        status = radar.health.on_end(why)
        if not isinstance(radar.failure, BrokenPipeError):
            radar.tell(status or radar.health.status)
        return why
