"""What tests of outputs share: sinks on a broker."""

import contextlib

import pytest

from radard.config.sink_table import MqttSection, SinkOptions
from tests.sink_helpers import QUICK, open_sink


@pytest.fixture
def publish(broker, tmp_path):
    """Open a sink on the broker that takes commands, and write to it; closed at the end."""
    with contextlib.ExitStack() as stack:

        def begin(*records, url=None, radar=None, mark="", **section):
            section = {"keepalive_s": 1, "commands": "always", **section}
            options = SinkOptions(log=QUICK, mqtt=MqttSection(**section))
            hosts = () if radar is None else (radar,)
            url = url or f"mqtt://127.0.0.1:{broker.port}"
            given = {"state_dir": tmp_path / f"state{mark}", "hosts": hosts, "mark": mark}
            sink = open_sink(url, options, **given)
            stack.callback(sink.close, 1.0)
            for record in records:
                sink.write(record)
            return sink

        yield begin
