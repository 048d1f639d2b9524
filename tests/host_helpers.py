"""A sensor that is nothing but what its sinks may ask of it."""

from radard.config.config import Config
from radard.health.health import Health


class FakeHost:
    """A `radard.outputs.base.Host` that notes what is asked of it."""

    def __init__(self, sensor="radar", *, config=None, state=None, sinks=()):
        self.sensor, self.health = sensor, Health()
        self.asked, self.n_reloads = [], 0
        self.held = Config() if config is None else config
        self.state, self.player, self.the_ring, self.all_sinks = state, None, None, sinks
        self.command = self.asked.append

    def config(self):
        return self.held

    def panel(self):
        return self.state

    def ring(self):
        return self.the_ring

    def playback(self):
        return self.player

    def driver(self):
        return {}

    def sinks(self):
        return self.all_sinks

    def reload(self):
        self.n_reloads += 1

    def test_alarm(self):
        return ()

    def mark(self):
        return ""
