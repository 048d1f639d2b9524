"""Who may look, who may arm, and what is turned away: the application without a network."""

import contextlib
import hmac
import http.client
import json
import os
import re
import socket
from csv import DictReader
from types import SimpleNamespace

import pytest
from starlette.requests import HTTPConnection
from websockets.exceptions import ConnectionClosed, InvalidStatus

from radard.config.sink_table import WebSection
from radard.errors import ConfigError, UsageError
from radard.web.auth import SESSION_S, AccessControl, is_loopback, read_tokens
from radard.web.guard import MAX_BODY
from radard.web.sink import parse_address
from tests.dashboard_helpers import post
from tests.web_helpers import HEADERS, ULID, decision, event, open_decision

VIEWER, OPERATOR = "look-but-not-touch", "may-arm-and-disarm"
ANYWHERE = "0.0.0.0"  # noqa: S104 - with a token


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.8.9.1", "::ffff:127.0.0.1", "::1", "localhost", "LOCALHOST"]
)
def test_every_address_of_loopback_is_served(make, host):
    assert is_loopback(host)
    named = f"[{host}]:80" if ":" in host else host
    assert make().get("/healthz", headers={"Host": named}).status_code == 503


@pytest.mark.parametrize("host", [ANYWHERE, "192.168.1.2", "::", "radar.local", "1270.0.1"])
def test_not_loopback_wants_a_token(host):
    assert not is_loopback(host)
    with pytest.raises(ConfigError, match=r"web\.token_file"):
        read_tokens(WebSection(), host)


def test_addresses():
    assert parse_address("http://localhost/") == ("localhost", 8434)
    assert parse_address("http://[::1]:80") == ("::1", 80)
    for url in ("http://", "http://h/path", "http://h:x", "http://h:99999", "https://h"):
        with pytest.raises(UsageError, match="--output"):
            parse_address(url)


@pytest.mark.parametrize(("token", "why"), [("short", "12 characters"), (VIEWER, "the same")])
def test_a_short_token_and_one_for_looking_on_and_arming_are_refused(tmp_path, token, why):
    (tmp_path / "t").write_text(token)
    section = WebSection(token_file=tmp_path / "t", operator_token_file=tmp_path / "t")
    with pytest.raises(ConfigError, match=why):
        read_tokens(section, "127.0.0.1")


@pytest.mark.parametrize("token", ["k\u00fcche-und-flur", "\u5ba4\u5185-radar-token"])
def test_a_token_may_have_any_letters(token):
    """As curl sends it: in UTF-8, which a server reads as Latin-1."""
    access = AccessControl(viewer=token)
    for given, role in ((token, "viewer"), (token + "x", "nobody")):
        header = (b"authorization", f"Bearer {given}".encode())
        assert access.role(HTTPConnection({"type": "http", "headers": [header]})) == role


def test_sessions_end_and_are_bounded(monkeypatch):
    def role(session):
        cookie = (b"cookie", f"radard={session}".encode())
        return guard.role(HTTPConnection({"type": "http", "headers": [cookie]}))

    now = [0.0]
    monkeypatch.setattr("radard.web.auth.time", SimpleNamespace(monotonic=lambda: now[0]))
    guard = AccessControl(operator=OPERATOR)
    sessions = [guard.log_in(OPERATOR, "")[1] for _ in range(100)]
    assert (role(sessions[-1]), role(sessions[0])) == ("operator", "nobody")
    now[0] = SESSION_S + 1
    assert role(sessions[-1]) == "nobody"


def test_guessing_is_slow_and_locks_out_nobody_else(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("radard.web.auth.time", SimpleNamespace(monotonic=lambda: now[0]))
    guard = AccessControl(viewer=VIEWER)
    stranger, owner = "192.168.1.66", "192.168.1.5"
    for _ in range(10):
        assert guard.log_in("not it, not it", stranger)[0] == "nobody"
    # Ten wrong ones stop neither the owner nor one who then finds the right one.
    assert guard.log_in(VIEWER, owner)[0] == "viewer"
    assert guard.log_in(VIEWER, stranger)[0] == "viewer"
    for _ in range(1000):
        guard.log_in("not it, not it", stranger)
    assert guard.is_locked(stranger)
    assert guard.log_in(VIEWER, stranger)[0] == "nobody"
    assert guard.log_in(VIEWER, owner)[0] == "viewer"
    now[0] = 61.0
    for _ in range(11):
        guard.log_in("not it, not it", stranger)
    assert guard.is_locked(stranger)
    now[0] = 122.0
    assert guard.log_in(VIEWER, stranger)[0] == "viewer"


def test_tokens_are_compared_in_constant_time(monkeypatch):
    compared = []
    equal = hmac.compare_digest
    monkeypatch.setattr(hmac, "compare_digest", lambda a, b: compared.append(b) or equal(a, b))
    guard = AccessControl(viewer=VIEWER, operator=OPERATOR)
    for token in (OPERATOR, VIEWER, "neither of both"):
        compared.clear()
        guard.log_in(token, "")
        # Both, whichever it is.
        assert compared == [OPERATOR.encode(), VIEWER.encode()]


def test_on_loopback_everybody_is_the_operator_and_unknown_commands_reach_nobody(client):
    assert client.get("/api/v1/status").json()["role"] == "operator"
    known = ("arm", "disarm", "ack", "calibrate")
    for name in (*known, "reboot", "", None, 1, ["arm"], {"arm": 1}):
        code = post(client, "/api/v1/command", {"command": name}).status_code
        assert code == (202 if name in known else 400)
    assert client.run.asked == list(known)


def test_a_flood_of_commands_is_cut(client):
    codes = [post(client, "/api/v1/command", {"command": "ack"}).status_code for _ in range(60)]
    assert set(codes) == {202, 429}
    assert len(client.run.asked) < 40


def test_commands_can_be_switched_off(make):
    client = make(section={"commands": False})
    assert client.get("/api/v1/status").json()["role"] == "viewer"
    assert post(client, "/api/v1/command", {"command": "disarm"}).status_code == 403


@pytest.mark.parametrize(
    "host", ["evil.example:8434", "192.168.1.5", "127.0.0.1.evil.example", ""]
)
def test_another_name_for_loopback_is_turned_away(make, host):
    answer = make().get("/api/v1/status", headers={"Host": host})
    assert answer.status_code == 421
    assert f"Host is '{host}'" in answer.json()["error"]


def test_a_proxy_that_changes_the_host_is_told_what_is_wrong(make):
    client = make()
    headers = {**HEADERS, "Origin": "https://radar.example"}
    answer = post(client, "/api/v1/command", {"command": "arm"}, headers)
    assert answer.status_code == 403
    for words in ("https://radar.example", f"Host is '{client.host}'", "proxy"):
        assert words in answer.json()["error"]
    # Handed on as it came, it is our own page.
    headers |= {"Host": "radar.example"}
    client = make(tokens=(None, OPERATOR))
    post(client, "/api/v1/login", {"token": OPERATOR})
    assert post(client, "/api/v1/command", {"command": "arm"}, headers).status_code == 202


def test_one_of_several_has_its_pages_below_its_name(make):
    client = make(sensor={}, sensors={"radar": {"port": "sim:empty"}})
    answer = client.get("/sensor/radar")
    assert (answer.status_code, answer.headers["location"]) == (307, "radar/")
    for path in ("", "static/app.js", "api/v1/status", "sw.js"):
        assert client.get(f"/sensor/radar/{path}").status_code == 200
    assert client.get("/sensor/cellar/static/app.js").status_code == 404


def test_pages_name_all_they_need_relative_to_themselves(make):
    client = make(tokens=(None, OPERATOR))
    for page in (client.get("/"), client.get("/static/index.html")):
        assert re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', page.text)
        assert not re.findall(r'(?:src|href)="(/|\w+:)', page.text)
    manifest = client.get("/static/manifest.webmanifest").json()
    assert (manifest["start_url"], manifest["icons"][0]["src"]) == ("../", "icon.svg")


OWN = {"Origin": "http://127.0.0.1:8434", "Sec-Fetch-Site": "same-origin"}
ARM = b'{"command": "arm"}'
OTHERS = [{"Origin": o} for o in ("http://evil.example", "null", "http://127.0.0.1:9999")]
OTHERS += [{"Sec-Fetch-Site": site} for site in ("cross-site", "same-site")]
KINDS = [{"Content-Type": k} for k in ("text/plain", "application/x-www-form-urlencoded", "")]


@pytest.mark.parametrize(
    ("headers", "body", "code"),
    [
        (OWN, ARM, 202),
        ({"Content-Type": "Application/JSON ; charset=utf-8"}, ARM, 202),
        ({}, b'{"command": "arm", "command": "disarm"}', 400),
        *((headers, ARM, 403) for headers in OTHERS),
        *((headers, ARM, 400) for headers in KINDS),
        *(({}, body, 400) for body in (b"", b"[", b"[1]", b"\xff", b'"arm"', b"[" * 4000)),
    ],
)
def test_only_our_own_page_arms_and_with_json_alone(client, headers, body, code):
    assert client.post("/api/v1/command", body, {**HEADERS, **headers}).status_code == code
    assert client.run.asked == (["arm"] if code == 202 else [])
    bare = {"Content-Type": "application/json", **headers}
    assert client.post("/api/v1/command", body, bare).status_code == 403


@pytest.mark.parametrize(
    ("origin", "host", "code"),
    [
        ("http://localhost", "localhost:80", 202),
        ("https://localhost", "localhost:443", 202),
        ("https://localhost:8443", "localhost", 403),
        ("http://localhost", "localhost:443", 403),
        ("https://evil.example", "localhost:443", 403),
        ("http://[", "localhost", 403),
        ("", "localhost", 403),
    ],
)
def test_a_proxy_may_name_the_usual_port(client, origin, host, code):
    headers = {**HEADERS, "Origin": origin, "Host": host}
    assert client.post("/api/v1/command", ARM, headers).status_code == code


@pytest.mark.integration
def test_a_health_check_without_a_host_is_answered_and_what_is_no_http_is_no_news(make, caplog):
    """As of load balancers, by HTTP/1.0; a stranger's bytes filled the log, a line each."""
    client = make(served=True)
    for sent, code in ((b"GET / HTTP/1.0", b" 200 "), (b"\x16\x03\x01", b" 400 ")):
        with socket.create_connection(("127.0.0.1", client.port), timeout=60) as line:
            line.sendall(sent + b"\r\n\r\n")
            assert code in line.recv(100)
    assert [r.message for r in caplog.records if "listening at" not in r.message] == []


@pytest.mark.integration
@pytest.mark.parametrize(
    ("target", "code"),
    [("http://{}/api/v1/events?limit=1", 200), ("HTTPS://{}", 200), ("http://evil.example/", 421)],
)
def test_a_request_for_a_whole_url_is_taken_by_its_path_and_its_host(make, target, code):
    client = make(served=True)
    answer = client.get(target.format(client.host), headers={"Host": client.host})
    assert answer.status_code == code


@pytest.mark.integration
def test_another_page_gets_no_socket(make):
    client = make(served=True)
    with pytest.raises(InvalidStatus):
        client.socket(origin="http://evil.example")
    client.socket(origin=f"http://{client.host}").close()


def test_long_bodies(client):
    body = b'{"command": "arm", "x": "' + b"x" * MAX_BODY + b'"}'
    assert client.post("/api/v1/command", content=body, headers=HEADERS).status_code == 413
    chunks = (body[i : i + 1000] for i in range(0, len(body), 1000))
    assert client.post("/api/v1/command", content=chunks, headers=HEADERS).status_code == 413
    assert client.run.asked == []


OUTSIDE = ("/static/../sink.py", "/static/%2e%2e/sink.py", "/static//etc/passwd", "/nowhere")


def test_only_the_pages_own_files_are_served_and_every_answer_shields_the_page(client):
    for path in ("/", "/healthz", "/static/app.js", "/api/v1/status", *OUTSIDE):
        answer = client.get(path)
        assert (answer.status_code == 404) is (path in OUTSIDE)
        policy = answer.headers["content-security-policy"]
        assert {"default-src 'none'", "frame-ancestors 'none'"} <= set(policy.split("; "))
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert "server" not in answer.headers


def bearer(token):
    return {"Authorization": f"Bearer {token}"}


@pytest.mark.integration
def test_without_a_token_only_the_way_in_is_shown(make):
    client = make(served=True, tokens=(VIEWER, OPERATOR))
    for path in ("status", "decisions", "decisions/1", "events", "events/export", "config"):
        assert client.get(f"/api/v1/{path}").status_code == 401
    assert client.get("/metrics").status_code == 401
    assert b"Token" in client.get("/").content
    assert client.get("/healthz").json() == {"state": "starting"}
    assert post(client, "/api/v1/command", {"command": "arm"}).status_code == 401
    with pytest.raises(InvalidStatus):
        client.socket()


def test_roles_of_tokens(make):
    client = make(tokens=(VIEWER, OPERATOR))
    for token, role, code in ((VIEWER, "viewer", 403), (OPERATOR, "operator", 202)):
        headers = bearer(token)
        assert client.get("/api/v1/status", headers=headers).json()["role"] == role
        body = {"command": "disarm"}
        assert post(client, "/api/v1/command", body, {**HEADERS, **headers}).status_code == code
    assert client.run.asked == ["disarm"]
    assert client.get("/api/v1/status", headers=bearer("wrong")).status_code == 401


@pytest.mark.integration
def test_a_session_in_a_cookie_that_scripts_cannot_read(make):
    client = make(served=True, host=ANYWHERE, base="radar.local:8434", tokens=(VIEWER,))
    assert post(client, "/api/v1/login", {"token": "not the right one"}).status_code == 401
    cookie = post(client, "/api/v1/login", {"token": VIEWER}).headers["set-cookie"].lower()
    told = [words in cookie for words in ("httponly", "samesite=strict", VIEWER)]
    assert told == [True, True, False]
    assert client.get("/api/v1/status").json()["role"] == "viewer"
    with client.socket() as page:
        assert json.loads(page.recv(60))["role"] == "viewer"
    assert post(client, "/api/v1/logout", {}).status_code == 200
    assert client.get("/api/v1/status").status_code == 401


def test_no_secret_is_shown(make, caplog):
    output = ["mqtt://user:hunter2@broker", "webhook:https://h/s3cret"]
    client = make(tokens=(VIEWER, OPERATOR), output=output)
    for path in ("/", "/api/v1/status", "/api/v1/config", "/metrics"):
        text = client.get(path, headers=bearer(OPERATOR)).text
        for secret in (VIEWER, OPERATOR, "hunter2", "s3cret"):
            assert secret not in text
    post(client, "/api/v1/login", {"token": "a wrong, typed token"})
    assert "a wrong" not in caplog.text


def test_decisions_and_reasons(client):
    for k in range(1, 11):
        client.tell(decision(k, k + 1.45))
    found = client.get("/api/v1/decisions?limit=3&before_seq=9").json()["decisions"]
    assert [d["seq"] for d in found] == [6, 7, 8]
    assert client.get("/api/v1/decisions/7").json()["decided_by"] == "gate"
    assert client.get("/api/v1/decisions/11").status_code == 404
    for query in ("limit=-1", "limit=x", "limit=99999", "before_seq=1.5"):
        assert client.get(f"/api/v1/decisions?{query}").status_code == 400


def test_events_of_a_run_are_one_row_each(client):
    client.tell(event())
    client.tell(event(ULID, "end", end_t_s=9.0, peak=0.5, reason="acknowledged"))
    client.tell(event("01J0000000000000000000000B", kind="fault", reason="no frames"))
    (alarm,) = client.get("/api/v1/events?kind=alarm").json()["events"]
    assert (alarm["phase"], alarm["peak"], alarm["reason"]) == ("end", 0.9, "human at 1.8 m")
    assert len(client.get("/api/v1/events").json()["events"]) == 2
    assert len(client.get("/api/v1/events?text=NO%20FR").json()["events"]) == 1
    for query in ("kind=x", "label=x", "since=yesterday", "limit=0x1"):
        assert client.get(f"/api/v1/events?{query}").status_code == 400


def test_export(client):
    client.tell(event(reason="=cmd|' /C calc'!A0", simulated=True))
    csv = client.get("/api/v1/events/export?format=csv")
    assert "attachment" in csv.headers["content-disposition"]
    (row,) = DictReader(csv.text.splitlines())
    assert (row["reason"][:5], row["simulated"], row["replayed"]) == ("'=cmd", "True", "")
    assert json.loads(client.get("/api/v1/events/export?format=jsonl").text)["id"] == ULID


def test_labels_become_lines(client, tmp_path):
    client.tell(event())
    path = tmp_path / "labels.jsonl"
    for label in ("pet", "wrong"):
        assert post(client, "/api/v1/labels", {"event": ULID, "label": label}).status_code == 201
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [line["label"] for line in lines] == ["pet", "wrong"]
    assert lines[0]["format"] == "radard-label"
    assert client.get("/api/v1/events?label=wrong").json()["events"][0]["id"] == ULID
    assert client.get("/api/v1/events?label=none").json()["events"] == []
    assert post(client, "/api/v1/labels", {"event": ULID, "label": "dragon"}).status_code == 400
    unknown = {"event": "01J0000000000000000000000Z", "label": "pet"}
    assert post(client, "/api/v1/labels", unknown).status_code == 404


def test_a_clip_is_only_ever_the_events_own_file(client, tmp_path):
    secret = tmp_path / "secret.h5"
    secret.write_text("x")
    client.tell(event(clip=str(secret)))
    assert client.get(f"/api/v1/events/{ULID}/clip").status_code == 404
    assert client.get("/api/v1/events/..%2f..%2fetc/clip").status_code == 404
    clip = tmp_path / f"{ULID}.h5"
    clip.write_bytes(b"no recording")
    client.tell(event(clip=str(clip)))
    assert client.get(f"/api/v1/events/{ULID}/clip").content == b"no recording"


@pytest.mark.integration
def test_a_clip_that_changes_while_it_is_sent_comes_as_it_was(make, tmp_path):
    """One that is being made grows, and is cut and replaced when the alarm ends."""
    client = make(served=True)
    clip = tmp_path / f"{ULID}.h5"
    as_it_was = bytes(range(256)) * 80_000
    clip.write_bytes(as_it_was)
    client.tell(event(clip=str(clip)))
    line = http.client.HTTPConnection("127.0.0.1", client.port, timeout=60)
    with contextlib.closing(line):
        line.request("GET", f"/api/v1/events/{ULID}/clip", headers={"Host": client.host})
        answer = line.getresponse()
        os.truncate(clip, 1000)
        assert answer.read() == as_it_was
    clip.unlink()
    clip.mkdir()
    assert client.get(f"/api/v1/events/{ULID}/clip").status_code == 404


@pytest.mark.integration
def test_a_page_is_welcomed_with_what_there_is_and_those_beyond_the_limit_are_sent_away(make):
    client = make(served=True, section={"max_viewers": 1})
    client.tell(open_decision(1, 2.45, human=0.9))
    client.tell(event())
    with client.socket() as page:
        welcome = json.loads(page.recv(60))
        with client.socket() as second, pytest.raises(ConnectionClosed) as err:
            second.recv(60)
        assert err.value.rcvd.code == 1013
    (decided,), (seen,) = welcome["decisions"], welcome["events"]
    assert (welcome["type"], decided["seq"], seen["id"]) == ("welcome", 1, ULID)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("text", "n"), [("[", 1), ("5", 1), ("x" * 600, 1), ('{"drawn": 1}', 1000)]
)
def test_nonsense_or_a_flood_closes_a_page(make, text, n):
    with make(served=True).socket() as page:
        json.loads(page.recv(60))
        with contextlib.suppress(ConnectionClosed):
            for _ in range(n):
                page.send(text)
        with pytest.raises(ConnectionClosed):
            page.recv(60)
