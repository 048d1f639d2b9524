"""What strangers may cost the dashboard: connections, numbers, bodies, requests that change."""

import contextlib
import http.client
import json
import resource
import socket
import threading
import time

import pytest
from starlette.routing import Route

from radard.stream.playback import Playback
from radard.web import server
from tests.dashboard_helpers import all_routes, post
from tests.device_helpers import in_thread
from tests.waiting import wait_for
from tests.web_helpers import HEADERS, event

TOKEN = "-".join(("may", "look", "and", "arm"))
STRANGER = "127.0.0.9"


@pytest.fixture
def strangers(monkeypatch):
    """Only 127.0.0.1 is this machine: 127.0.0.9 is another."""
    monkeypatch.setattr(server, "is_loopback", lambda address: address == "127.0.0.1")


@pytest.fixture
def half_open():
    """A function that opens connections from an address and sends half of a header on each."""
    lines = []

    def open_some(n, port, address, data=b"GET / HTTP/1.1\r\nHost: "):
        for _ in range(n):
            line = socket.create_connection(("127.0.0.1", port), 60, (address, 0))
            lines.append(line)
            with contextlib.suppress(OSError):
                line.sendall(data)
        return lines

    yield open_some
    for line in lines:
        line.close()


def is_closed(line, within_s=60.0):
    """Whether the other end closes a connection in time."""
    line.settimeout(within_s)
    try:
        while line.recv(4096):
            pass
    except OSError as err:
        return not isinstance(err, TimeoutError)
    return True


def ask_from(address, client, path):
    """Ask from an address; return the status code."""
    line = http.client.HTTPConnection("127.0.0.1", client.port, 60, source_address=(address, 0))
    with contextlib.closing(line):
        line.request("GET", path)
        return line.getresponse().status


@pytest.mark.integration
@pytest.mark.parametrize("address", ["127.0.0.1", STRANGER])
def test_half_open_connections_keep_nobody_out(make, half_open, strangers, address):
    client = make(served=True)
    half_open(400, client.port, address)
    assert client.get("/healthz").json()["state"] == "starting"
    assert post(client, "/api/v1/command", {"command": "disarm"}).status_code == 202
    assert ask_from("127.0.0.8", client, "/healthz") == 503
    assert client.run.asked == ["disarm"]


@pytest.mark.integration
def test_an_address_has_no_more_connections_than_its_share(make, half_open, strangers):
    client = make(served=True)
    lines = half_open(server._MAX_OF_ONE_ADDRESS + 5, client.port, STRANGER)
    assert client.get("/healthz").status_code == 503
    assert all(is_closed(line) for line in lines[:5])
    assert not is_closed(lines[-1], 0.2)


@pytest.mark.integration
def test_busy_connections_leave_room_for_this_machine(make, half_open, strangers, monkeypatch):
    monkeypatch.setattr(server, "_MAX_CONNECTIONS", 12)
    monkeypatch.setattr(server, "_KEPT_FOR_LOOPBACK", 4)
    client = make(served=True)
    begun = f"Host: {client.host}\r\nX-Radard: 1\r\nContent-Length: 9\r\n\r\n"
    # Their bodies do not come: these are being answered, none is idle.
    half_open(8, client.port, STRANGER, f"POST /api/v1/login HTTP/1.1\r\n{begun}".encode())
    assert client.get("/healthz").status_code == 503
    (refused,) = half_open(1, client.port, STRANGER)[-1:]
    assert is_closed(refused)
    assert client.get("/healthz").status_code == 503


@pytest.mark.integration
def test_every_requests_header_has_its_time(make, half_open, monkeypatch):
    monkeypatch.setattr(server, "_HEADER_S", 0.3)
    client = make(served=True)
    (first,) = half_open(1, client.port, "127.0.0.1")
    assert is_closed(first)
    line = socket.create_connection(("127.0.0.1", client.port), 60)
    with contextlib.closing(line):
        line.sendall(f"GET /healthz HTTP/1.1\r\nHost: {client.host}\r\n\r\n".encode())
        assert line.recv(4096).startswith(b"HTTP/1.1 503")
        # The second one drips: each byte alone must not begin the time again.
        stop = threading.Event()

        def drip():
            with contextlib.suppress(OSError):
                while not stop.wait(0.05):
                    line.sendall(b"G")

        dripping = in_thread(drip)
        assert is_closed(line)
        stop.set()
        dripping.join(60)


@pytest.mark.integration
def test_a_page_stays_connected_beyond_the_time_for_a_header(make, monkeypatch):
    monkeypatch.setattr(server, "_HEADER_S", 0.2)
    client = make(served=True)
    with client.socket() as page:
        page.recv(60)
        end_s = time.monotonic() + 0.6
        while time.monotonic() < end_s:
            page.send('{"drawn": 0}')
            time.sleep(0.1)
        client.tell(event())
        while json.loads(page.recv(60))["type"] != "event":
            pass


LONG = "9" * 5000
PATHS = [f"decisions{place}{LONG}" for place in ("?limit=", "?before_seq=", "/")]
PATHS += ["decisions/-1", "decisions/%C2%B2", f"events?limit={LONG}", f"events?since={LONG}d"]
PATHS += ["events?since=" + "9" * 190 + "w", "events?since=0001-01-01"]


@pytest.mark.parametrize("path", PATHS)
def test_numbers_of_any_length(client, caplog, path):
    assert client.get(f"/api/v1/{path}").status_code in {200, 400, 404}
    assert "Traceback" not in caplog.text


NUMBERS = (LONG[:4000], "-" + LONG[:4000], "1e999", "1e308", "NaN", "Infinity", '"\\ud800"')


@pytest.mark.parametrize("number", NUMBERS)
def test_numbers_of_any_length_in_json(make, caplog, number):
    client = make(tokens=(None, TOKEN))
    client.run.player = Playback(10.0, None)
    headers = {**HEADERS, "Authorization": f"Bearer {TOKEN}"}
    for path, text in (
        ("playback", '{"action": "seek", "value": %s}'),
        ("playback", '{"action": "speed", "value": %s}'),
        ("zones", '{"include": [[0, %s]], "exclude": []}'),
        ("labels", '{"event": %s, "label": "pet"}'),
        ("command", '{"command": %s}'),
        ("login", '{"token": %s}'),
    ):
        answer = client.post(f"/api/v1/{path}", (text % number).encode(), headers)
        assert answer.status_code in {400, 401, 404, 413}, (path, answer.status_code)
    assert "Traceback" not in caplog.text


@pytest.mark.integration
def test_lengths_of_bodies_that_are_no_numbers(make):
    client = make(served=True)
    for length in (LONG, "-1", "1e3"):
        headers = {**HEADERS, "Content-Length": length}
        try:
            status = client.post("/api/v1/command", b"{}", headers).status_code
        except ConnectionResetError:
            # The server has closed with the body unread: the answer may be lost on the way.
            status = 400
        assert status in {400, 413}
    assert client.run.asked == []


def test_no_get_changes_anything(client):
    client.tell(event())
    changing = [r for r in all_routes() if isinstance(r, Route) and "POST" in r.methods]
    assert len(changing) == 8
    for route in changing:
        assert route.methods == {"POST"}
        for method in ("GET", "HEAD", "PUT", "DELETE", "PATCH"):
            query = "?command=disarm&label=pet&forget=true&action=pause"
            code = client.request(method, route.path + query, headers=HEADERS).status_code
            assert code == 405, (method, route.path)
    assert client.run.asked == []
    assert client.get("/api/v1/events").json()["events"][0]["label"] is None


MAX_FILES = 48


@pytest.mark.integration
def test_more_pages_and_commands_than_files(launched, tmp_path):
    """Decisions go on, it is said once, and pages come back."""
    out = tmp_path / "out.jsonl"
    argv = ["--port", "sim:empty", "--speed", "4", "--model", "none", "-o", f"json:{out}"]
    daemon = launched(*argv).wait_online()
    resource.prlimit(daemon.process.pid, resource.RLIMIT_NOFILE, (MAX_FILES, MAX_FILES))
    lines = [socket.create_connection(("127.0.0.1", daemon.port)) for _ in range(MAX_FILES + 20)]
    n_bytes = out.stat().st_size
    # Twenty decisions.
    wait_for(lambda: out.stat().st_size > n_bytes + 10_000)
    for line in lines:
        line.close()
    told = daemon.wait_online().log.splitlines()
    assert daemon.end() == 0
    assert sum("no further page can be opened" in line for line in told) == 1, told
    assert len(told) < 20, told
