"""Keeper: keeps one radar at work, in a thread of its own; none is stopped by another.

The only radar of a process ends with what ends its work. One of several is started again after a
pause; one that never came to work stays away until the process is started again.
"""

import contextlib
import threading
import time
from collections.abc import Callable

from radard.errors import OutputError, RadardError
from radard.run.sensor import Sensor
from x2radar.errors import X2RadarError

# A passing fault is soon over, a lasting one must not fill the log.
_FIRST_PAUSE_S = 5.0
_MAX_PAUSE_S = 300.0
MAX_AT_ONCE = 8  # brought up at once: more are answered so late that they are reset again
_MAX_WAIT_S = 60.0  # nobody waits longer for ports that hang
_LOOK_S = 0.2  # so late a radar that waits to be brought up heeds the end


class Keeper:
    """Keep a sensor at work; `begin_again` whether work that broke off is started again.

    `turns` lets so many be brought up at the same time.
    """

    def __init__(
        self,
        sensor: Sensor,
        turns: threading.Semaphore,
        *,
        begin_again: bool,
        open_outputs: Callable[[], object],
        wake: Callable[[], object],
    ) -> None:
        self.sensor = sensor
        self.failure: BaseException | None = None  # what ended its work, but for the stream
        self.stuck: list[str] = []
        self._turns, self._has_turn = turns, False
        self._begin_again = begin_again
        self._open_outputs = open_outputs
        self._wake = wake
        self._halt = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"{sensor.sensor} keeper")
        self._thread.daemon = True

    @property
    def is_alive(self) -> bool:
        """Whether it is at work, or will be again."""
        return self._thread.is_alive()

    @property
    def has_lost_output(self) -> bool:
        """Whether it ended because an output that the run was started for is gone."""
        return isinstance(self.failure, BrokenPipeError | OutputError) and not self.is_alive

    def start(self) -> None:
        """Start the thread that runs the sensor."""
        self._thread.start()

    def stop(self) -> None:
        """Ask for the end; returns at once."""
        self._halt.set()
        self.sensor.stop()
        self._over.set()

    def join(self, timeout_s: float) -> None:
        """Wait `timeout_s` for the thread; note its name in `stuck` if it goes on."""
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self.stuck.append(self._thread.name)

    def _run(self) -> None:
        why = self._keep()
        status = self.sensor.health.on_end(why)
        with contextlib.suppress(BrokenPipeError, OutputError):
            if not isinstance(self.failure, BrokenPipeError):
                self.sensor.tell(status or self.sensor.health.status)
        self._wake()

    def _keep(self) -> str:
        """Keep the sensor at work until the end; return why that came."""
        sensor, pause_s = self.sensor, _FIRST_PAUSE_S
        while True:
            has_worked = self._work()
            failure = self.failure
            is_lost = isinstance(failure, BrokenPipeError | OutputError)
            if failure is None or (self._halt.is_set() and not is_lost):
                return "stopped" if self._halt.is_set() else "end of stream"
            why = " ".join(str(failure).split()) or repr(failure)
            if is_lost or not self._begin_again:
                return why
            sensor.log.error("%s", why)
            if not has_worked:
                return why
            sensor.leave()
            sensor.tell(sensor.health.on_failure(why))
            if self._halt.wait(pause_s):
                return "stopped"
            pause_s = min(2 * pause_s, _MAX_PAUSE_S)
            sensor.tell(sensor.health.on_start())

    def _work(self) -> bool:
        """Work until the stream ends, something fails or `stop`; return whether work began."""
        sensor, has_worked, opened = self.sensor, False, None
        self.failure = None
        try:
            self._take_turn()
            opened = sensor.open(self._on_notice, is_wanted=lambda: not self._halt.is_set())
            self._leave_turn()
            self._open_outputs()
            run = sensor.start(opened, self._over.set)
            has_worked = True
            # `stop` sets the one and then the other.
            if not self._halt.is_set():
                self._over.wait()
            run.stop()
            self.stuck = run.finish()
            self.failure = run.failure
            self._over.clear()
        except (RadardError, X2RadarError, BrokenPipeError) as err:
            self.failure = err
        except Exception as err:
            # Whatever it is, the other radars go on.
            if self._begin_again:
                sensor.log.exception("the run of %s broke off", sensor.sensor)
            self.failure = err
        finally:
            self._leave_turn()
            if opened is not None and not opened.close():
                self.stuck.append("recording")
        return has_worked

    def _take_turn(self) -> None:
        """Wait for one's turn, a minute at most, or for the end."""
        end_s = time.monotonic() + _MAX_WAIT_S
        while not (self._has_turn or self._halt.is_set() or time.monotonic() > end_s):
            self._has_turn = self._turns.acquire(timeout=_LOOK_S)

    def _leave_turn(self) -> None:
        if self._has_turn:
            self._has_turn = False
            self._turns.release()

    def _on_notice(self, _kind: str, _reason: str) -> None:
        # It may take for ever until an absent one comes.
        self._leave_turn()
        self._open_outputs()
        self.sensor.tell(self.sensor.health.status)
