"""A daemon in this process whose threads a test can hold up."""

import threading

from radard.config.config import load_config
from radard.run.process import Process
from radard.run.sensor import RunOptions
from tests.alarm_helpers import NotifySocket


class Gate:
    """A door that threads pass, and stand before while it is shut."""

    def __init__(self):
        self._open = threading.Event()
        self._open.set()
        self.shut, self.open = self._open.clear, self._open.set
        self.n_before = 0

    def wait(self):
        """Pass, or stand before it."""
        if not self._open.is_set():
            self.n_before += 1
            self._open.wait(120)

    def before(self, monkeypatch, cls, name):
        """Put the door before a method."""
        original = getattr(cls, name)

        def guarded(*args, **kwargs):
            self.wait()
            return original(*args, **kwargs)

        monkeypatch.setattr(cls, name, guarded)

    def before_each(self, monkeypatch, cls, name):
        """Put the door before every item that a generator method yields."""
        original = getattr(cls, name)

        def guarded(*args, **kwargs):
            for item in original(*args, **kwargs):
                self.wait()
                yield item

        monkeypatch.setattr(cls, name, guarded)


class Daemon:
    """A daemon on a simulated module ten times as fast, in a thread, as it runs under systemd."""

    n_made = 0

    def __init__(self, tmp_path, monkeypatch, *, stale_s=60.0, reload=None, **options):
        Daemon.n_made += 1
        self.far = NotifySocket(tmp_path / f"notify{Daemon.n_made}")
        monkeypatch.setenv("NOTIFY_SOCKET", self.far.name)
        monkeypatch.setenv("WATCHDOG_USEC", "200000")
        monkeypatch.setattr("radard.run.sensor.STALE_S", stale_s)
        monkeypatch.setattr("radard.health.heartbeat._EVERY_S", 0.05)
        monkeypatch.setattr("radard.health.heartbeat._MAIN_LATE_S", stale_s)
        monkeypatch.setattr("radard.run.process._BEAT_S", 0.05)
        one = {} if "sensors" in options else {"port": "sim:empty"}
        folders = {"runtime_dir": tmp_path, "state_dir": tmp_path / "state"}
        given = {"sensor": {**one, "speed": "10"}, "service": folders, "output": ["null"]}
        given |= {"model": {"name": "none"}, **options}
        self.options, self.config = given, load_config(environ={}, options=given)
        self.result, self.is_stopped = None, False
        self.run = Process(self.config, RunOptions(reload=reload))
        self.radar = self.run.sensors[0]
        self._thread = threading.Thread(target=self._go)
        self._thread.start()

    def _go(self):
        try:
            self.result = self.run.go()
        except Exception as err:  # noqa: BLE001 - looked at by the test
            self.result = err

    def panel(self):
        """What is told of the first radar; empty before there is a stream."""
        return told(self.radar)

    def ask(self, wish):
        self.run.signals.ask(wish)

    def stop(self):
        """End it, once, and return its exit code or error."""
        self.is_stopped = True
        self.ask("stop")
        self._thread.join(60)
        self.far.close()
        return self.result


def told(sensor):
    """What is told of a radar, as pages have it; empty before there is a stream."""
    state = sensor.panel()
    return state.as_record() if state is not None else {}
