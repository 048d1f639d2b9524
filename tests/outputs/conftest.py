"""What tests of outputs share: sinks that are closed at the end, also on a broker."""

import contextlib

import pytest

from radard.config.sink_table import SinkOptions
from tests.sink_helpers import QUICK, open_sink


@pytest.fixture
def opened():
    """Open outputs that try again at once, with sections of the configuration."""
    with contextlib.ExitStack() as stack:

        def begin(url, state_dir=None, *, host=None, mark="", can_wait=False, **sections):
            options = SinkOptions(**{"log": QUICK, **sections})
            context = {"host": host, "mark": mark, "can_wait": can_wait}
            sink = open_sink(url, options, state_dir=state_dir, **context)
            stack.callback(sink.close, 1.0)
            return sink

        yield begin


@pytest.fixture
def publish(broker, tmp_path, opened):
    """Open a sink on the broker that takes commands, and write to it."""

    def begin(*records, url=None, radar=None, mark="", **section):
        section = {"keepalive_s": 1, "commands": "always", **section}
        url = url or f"mqtt://127.0.0.1:{broker.port}"
        sink = opened(url, tmp_path / f"state{mark}", mqtt=section, host=radar, mark=mark)
        for record in records:
            sink.write(record)
        return sink

    return begin
