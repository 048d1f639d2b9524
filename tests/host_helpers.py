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
        self.config = lambda: self.held
        self.panel = lambda: self.state
        self.ring = lambda: self.the_ring
        self.playback = lambda: self.player
        self.sinks = lambda: self.all_sinks
        self.driver, self.test_alarm, self.mark = dict, tuple, str

    def reload(self):
        self.n_reloads += 1
