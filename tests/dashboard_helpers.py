"""A dashboard without a daemon behind it, and a client of it."""

import asyncio
import json
from urllib.parse import unquote, urlsplit

from radard.alarm.sensor_state import SensorState
from radard.config.config import load_config
from radard.config.sink_table import WebSection
from radard.log import EventLog
from radard.web.api import Api
from radard.web.auth import AccessControl
from radard.web.sink import WebSink
from radard.web.view import View
from tests.sink_helpers import FakeHost
from tests.web_helpers import HEADERS, Answer, Client


def all_routes():
    """Every route that a sensor's pages have."""
    view = View(WebSection(), EventLog(None), lambda *_: None, FakeHost(), "")
    return Api(view, AccessControl(), list).routes


class AppClient(Client):
    """A client that calls the application itself: no server, no socket."""

    app = None

    def send(self, method, path, sent, content):
        content = content.encode() if isinstance(content, str) else content or b""
        chunks = [content] if isinstance(content, bytes) else list(content)
        if method == "POST" and len(chunks) == 1:
            sent["Content-Length"] = str(len(chunks[0]))
        path, _, query = path.partition("?")
        scope = {"type": "http", "http_version": "1.1", "method": method, "scheme": "http"}
        scope |= {"path": unquote(path), "raw_path": path.encode(), "query_string": query.encode()}
        scope |= {"client": ("127.0.0.1", 50_000), "server": ("127.0.0.1", self.port)}
        scope["headers"] = [(k.lower().encode(), v.encode("latin-1")) for k, v in sent.items()]
        last = len(chunks) - 1
        messages = [{"body": chunk, "more_body": k < last} for k, chunk in enumerate(chunks)]
        start, body = {}, []

        async def receive():
            if messages:
                return {"type": "http.request", **messages.pop(0)}
            return await asyncio.Future()

        async def keep(message):
            start.update(message if message["type"] == "http.response.start" else {})
            body.append(message.get("body", b""))

        asyncio.run(self.app(scope, receive, keep))
        headers = {k.decode().lower(): v.decode() for k, v in start["headers"]}
        return Answer(start["status"], headers, b"".join(body))


def maker(tmp_path):
    """A fixture's function: it makes a dashboard and a client of it.

    Only what is `served` listens, and has sockets.
    """
    made = []

    def build(*, host="127.0.0.1", base=None, section=None, tokens=(), served=False, **sections):
        values = dict(section or {})
        for name, token in zip(("token", "operator_token"), tokens, strict=False):
            if token is not None:
                (tmp_path / name).write_text(token + "\n")
                values[f"{name}_file"] = tmp_path / name
        log = EventLog(None)
        sink = WebSink(host, 0, WebSection(**values), log)
        given = {"sensor": {"port": "sim:empty"}, "service": {"state_dir": tmp_path}}
        config = load_config(environ={}, options=given | sections)
        run = FakeHost(config=config, state=SensorState())
        sink.attach(run)
        sink.write({"type": "hello", "version": "1", "model": None, "frame_rate_hz": 60.0})
        if served:
            sink.start()
            client = Client(urlsplit(sink.url).port, base)
        else:
            client = AppClient(8434, base)
            client.app = sink.app
        client.run, client.sink, client.log = run, sink, log
        made.extend((sink, log))
        return client

    yield build
    for each in made:
        each.close()


def post(client, path, body, headers=HEADERS, **options):
    """POST as the page does; return the answer."""
    return client.post(path, content=json.dumps(body), headers=headers, **options)
