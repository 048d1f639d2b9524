"""A dashboard without a daemon behind it, and a client of it."""

import json
from urllib.parse import urlsplit

from radard.config.config import load_config
from radard.config.sink_table import WebSection
from radard.health.health import Health
from radard.outputs.fanout import Host
from radard.web.sink import WebSink
from tests.web_helpers import HEADERS, Client


class Run:
    """A run that only notes what is asked of it."""

    def __init__(self, tmp_path, **sections):
        self.asked = []
        self.config = load_config(
            environ={},
            options={"sensor": {"port": "sim:empty"}, "service": {"state_dir": tmp_path}}
            | sections,
        )
        panel = {"armed": True, "panel": "armed", "alarm_id": None, "open": {}, "seq": 0}
        self.host = Host(
            "radar", Health(), lambda: panel, self.asked.append, config=lambda: self.config
        )


def maker(tmp_path):
    """A fixture's function: it makes a dashboard and a client of it."""
    made = []

    def build(*, host="127.0.0.1", base=None, section=None, tokens=(), **sections):
        values = dict(section or {})
        for name, token in zip(("token", "operator_token"), tokens, strict=False):
            if token is not None:
                (tmp_path / name).write_text(token + "\n")
                values[f"{name}_file"] = tmp_path / name
        sink = WebSink(host, 0, WebSection(**values))
        run = Run(tmp_path, **sections)
        sink.attach(run.host)
        sink.write({"type": "hello", "version": "1", "model": None, "frame_rate_hz": 60.0})
        sink.start()
        client = Client(urlsplit(sink.url).port, base)
        client.run, client.sink = run, sink
        made.append(sink)
        return client

    yield build
    for sink in made:
        sink.close()


def post(client, path, body, headers=HEADERS, **options):
    """POST as the page does; return the answer."""
    return client.post(path, content=json.dumps(body), headers=headers, **options)
