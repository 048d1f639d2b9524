"""webhook, exec and syslog with real servers and programs: retries, refusals, secrets."""

import contextlib
import json
import os
import re
import socket
import ssl
import sys

import pytest

from radard.errors import ConfigError, OutputError, UsageError
from radard.outputs.webhook import sign
from tests.device_helpers import in_thread
from tests.sink_helpers import QUICK, WebServer, decision, event, hello, make_cert, status, ulid
from tests.waiting import free_port, wait_for
from x2radar.errors import MissingExtra

pytestmark = pytest.mark.integration


@pytest.fixture
def hook(server, opened):
    """Open a webhook of the server."""
    return lambda path="", **more: opened(f"webhook:http://127.0.0.1:{server.port}/{path}", **more)


@pytest.fixture
def token(tmp_path):
    """A file with the word `letmein`."""
    (tmp_path / "token").write_text("letmein\n")
    return tmp_path / "token"


@pytest.mark.parametrize(
    ("n_read", "words"),
    [
        (0, "no answer within the time limit"),
        (65_536, "closes the connection without"),
        (1, "closes the connection without"),  # what was not read makes it a reset
    ],
)
def test_a_server_that_says_nothing_is_named_so(opened, n_read, words):
    """Before, all were said to speak no HTTP, or not to be reached."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"webhook:http://127.0.0.1:{silent.getsockname()[1]}"
        sink = opened(url, webhook={"timeout_s": 60 if n_read else 1})
        sink.write(event(1))
        line, _ = silent.accept()
        if n_read:
            line.recv(n_read)
            line.close()
        wait_for(lambda: words in sink.state.reason)
        line.close()


def test_a_post_has_sensor_id_token_and_signature(server, hook, token, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("shared\n")
    section = {"token_file": token, "secret_file": secret}
    # What a URL may not hold is quoted.
    sink = hook("alarm k\u00fcche?a=b c&d=%20", webhook=section)
    sink.write(event(1))
    wait_for(lambda: server.posts)
    path, headers, body = server.posts[0]
    assert path == "/alarm%20k%C3%BCche?a=b%20c&d=%20"
    assert json.loads(body) == {"sensor": "hall", **event(1)}
    assert headers["authorization"] == "Bearer letmein"
    key, stamp = headers["webhook-id"], headers["webhook-timestamp"]
    assert headers["webhook-signature"] == sign("shared", key, stamp, body)
    assert "a=b" not in sink.name


@pytest.mark.parametrize("code", [500, 503, 429, 401, 302])
def test_a_server_in_trouble_gets_it_later_with_the_same_id(server, hook, code):
    server.code = code
    server.headers = {"Location": "http://127.0.0.1:1/"}
    sink = hook()
    for k in (1, 2):
        sink.write(event(k))
    # More often than `attempts`: only a refusal of the record itself counts.
    wait_for(lambda: len(server.posts) > QUICK.attempts + 1)
    assert f"answers {code}" in sink.state.reason
    server.code = 200
    wait_for(lambda: sink.state.n_sent == 2)
    assert sink.state.n_dropped == 0
    *first, second = (headers["webhook-id"] for _, headers, _ in server.posts)
    assert {*first} == {first[0]} != {second}


@pytest.mark.parametrize(("kind", "give_up_h"), [("fault", 168.0), ("alarm", 1e-6)])
def test_an_event_that_is_refused_is_given_up_for_those_behind_it_an_alarm_when_it_is_old(
    server, hook, caplog, kind, give_up_h
):
    server.code = 400
    sink = hook(log=QUICK.model_copy(update={"give_up_h": give_up_h}))
    sink.write(event(1, kind=kind))
    wait_for(lambda: sink.state.n_dropped == 1)
    is_fault = kind == "fault"
    assert len(server.posts) == QUICK.attempts if is_fault else "too old" in caplog.text
    server.code = 204
    sink.write(event(2))
    wait_for(lambda: sink.state.n_sent == 1)
    assert "gives up" in caplog.text


@pytest.mark.parametrize("has_disk", [True, False])
def test_a_refused_alarm_is_not_given_up_and_stops_nobody(server, hook, tmp_path, has_disk):
    server.code = 400
    sink = hook(state_dir=tmp_path if has_disk else None)
    sink.write(event(1))
    sink.write(event(2))
    # Each is tried again after the other.
    wait_for(lambda: min(server.ids().count(ulid(n)) for n in (1, 2)) > QUICK.attempts)
    assert sink.state.n_dropped == 0
    server.code = 204
    wait_for(lambda: sink.state.n_sent == 2)


def test_chosen_kinds_phases_and_states(server, hook):
    sink = hook(webhook={"kinds": ("alarm",), "phases": ("new",), "statuses": True})
    others = event(1, phase="end"), event(2, kind="fault"), decision()
    for record in (hello(), event(1), *others, status("degraded", "dust")):
        sink.write(record)
    wait_for(lambda: sink.state.n_sent == 2)
    sink.close()
    assert [json.loads(body)["type"] for _, _, body in server.posts] == ["event", "status"]


def program(tmp_path, text):
    script = tmp_path / "hook"
    script.write_text(f"#!{sys.executable}\nimport json, os, sys, time\n{text}\n")
    script.chmod(0o755)
    return f"exec:{script}"


def test_a_program_gets_the_event_on_stdin_and_in_its_environment(opened, tmp_path):
    out = tmp_path / "out"
    told = "os.environ['RADAR_EVENT_KIND'] + os.environ['RADAR_EVENT_TEST']"
    sink = opened(program(tmp_path, f"open({str(out)!r}, 'w').write(sys.stdin.read() + {told})"))
    sink.write({**event(1), "test": True})
    wait_for(lambda: sink.state.n_sent == 1)
    sink.close()
    body, kind = out.read_text().rsplit("}", 1)
    assert json.loads(body + "}") == {"sensor": "hall", **event(1), "test": True}
    # A line, as `read` of a shell and `while read` want it; a siren must know a test.
    assert kind == "\nalarmTrue"


@pytest.mark.parametrize(
    ("text", "timeout_s", "words"),
    [
        ("sys.exit(3)", 60, "exit status 3"),
        ("os.kill(os.getpid(), 9)", 60, "ended by SIGKILL"),
        ("os.kill(os.getpid(), 35)", 60, "ended by signal 35"),
        ("time.sleep(60)", 0.3, "killed after 0.3 s"),
    ],
)
def test_a_program_that_fails_runs_again_and_is_given_up(opened, tmp_path, text, timeout_s, words):
    sink = opened(program(tmp_path, text), exec={"timeout_s": timeout_s})
    sink.write(event(1, kind="fault"))
    wait_for(lambda: sink.state.n_dropped == 1)
    assert sink.state.reason == words
    assert sink.state.n_failures == QUICK.attempts


@pytest.fixture
def other():
    """Another server, to which the first may redirect."""
    made = WebServer()
    yield made
    made.close()


@pytest.mark.parametrize("code", [0, 301, 302, 307, 308])
def test_a_redirect_is_followed_if_asked_and_gets_the_post_without_the_token(
    server, other, hook, token, code
):
    server.code = code or 307
    server.headers = {"Location": f"http://localhost:{other.port}/there?x=1"}
    sink = hook("here", webhook={"follow_redirects": bool(code), "token_file": token})
    sink.write(event(1))
    wait_for(lambda: sink.state.n_sent or sink.state.n_failures)
    assert "authorization" in server.posts[0][1]
    if not code:
        assert ("webhook.follow_redirects" in sink.state.reason, other.posts) == (True, [])
        return
    (path, headers, body), *more = other.posts
    assert (path, more) == ("/there?x=1", [])
    assert json.loads(body)["id"] == ulid(1)
    assert "authorization" not in headers


def test_redirects_in_a_circle_and_to_another_scheme_end(server, hook):
    server.code, server.headers = 302, {"Location": f"http://127.0.0.1:{server.port}/"}
    sink = hook(webhook={"follow_redirects": True})
    sink.write(event(1))
    wait_for(lambda: "answers 302" in sink.state.reason)
    server.headers = {"Location": "file:///etc/passwd"}
    wait_for(lambda: "redirects to what is no" in sink.state.reason)
    assert sink.state.n_dropped == 0


def test_https_wants_its_certificate_and_is_redirected_to_nothing_less(other, opened, tmp_path):
    cert = make_cert(tmp_path)
    with contextlib.closing(WebServer(cert=cert)) as server:
        # However it is spelt.
        url = f"webhook:HTTPS://localhost:{server.port}/"
        bad = opened(url)
        good = opened(url, webhook={"follow_redirects": True, "ca_file": cert[0]})
        for sink in (bad, good):
            sink.write(event(1))
        wait_for(lambda: "certificate is not accepted" in bad.state.reason)
        wait_for(lambda: good.state.n_sent == 1)
        server.code, server.headers = 307, {"Location": f"http://localhost:{other.port}/"}
        good.write(event(2))
        wait_for(lambda: "redirects to what is no" in good.state.reason)
        assert (other.posts, len(server.posts) > 1) == ([], True)
        # Before the server: a handshake that it breaks off leaves a socket to Python's collector.
        for sink in (bad, good):
            sink.close(1.0)


def test_a_log_that_nobody_hears_is_said_once(opened, caplog):
    sink = opened(f"syslog:udp://127.0.0.1:{free_port()}")
    for n in range(40):
        sink.write(event(n))
    sink.close(20.0)
    assert len([r.getMessage() for r in caplog.records if "cannot log" in r.getMessage()]) == 1
    # Each at most twice: nothing is repeated once it was sent.
    assert 40 <= sink.state.n_sent + sink.state.n_dropped <= 41


def tls_of(cert, key):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(cert, key)
    return context


@pytest.mark.parametrize("scheme", ["tcp", "tls"])
def test_syslog_over_a_stream_outlives_its_server(opened, scheme, tmp_path):
    """Over TCP a message is a line, over TLS its octets are counted."""
    cert, key = make_cert(tmp_path)

    def read(lines):
        if scheme == "tcp":
            return lines.readline().decode()
        length = b""
        while not length.endswith(b" "):
            length += lines.read(1)
        return lines.read(int(length)).decode()

    def served():
        """Two messages of one connection, which is then closed."""
        with contextlib.ExitStack() as stack:
            far = stack.enter_context(listener.accept()[0])
            if scheme == "tls":
                far = stack.enter_context(tls_of(cert, key).wrap_socket(far, server_side=True))
            far.settimeout(60)
            lines = stack.enter_context(far.makefile("rb"))
            return read(lines), read(lines)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(60)
        url = f"syslog:{scheme}://localhost:{listener.getsockname()[1]}"
        sink = opened(url, syslog={"ca_file": cert})
        for n in (1, 3):
            sink.write({**event(n), "reason": f"human\nat {n} m, \N{DEGREE SIGN}"})
            sink.write(event(n + 1))
            first, second = served()
            head, _, text = first.partition(" - ")
            assert re.fullmatch(rf"<25>1 2026-\S+Z \S+ radard {os.getpid()} event", head)
            gap = " " if scheme == "tcp" else "\n"
            assert text.startswith(f"hall: alarm new: human{gap}at {n} m, \N{DEGREE SIGN}")
            assert f"human at {n + 1}.0 m" in second
        sink.close()


def test_a_log_server_that_nobody_signed_gets_nothing(opened, tmp_path):
    context, heard = tls_of(*make_cert(tmp_path)), []

    def serve():
        with contextlib.suppress(OSError), listener.accept()[0] as plain:
            heard.append(context.wrap_socket(plain, server_side=True).recv(4096))

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = in_thread(serve)
        sink = opened(f"syslog:tls://localhost:{listener.getsockname()[1]}")
        sink.write(event(1))
        wait_for(lambda: "certificate is not accepted" in sink.state.reason)
        thread.join(60)
        sink.close(0.1)
    assert heard == []


def test_files_that_cannot_be_read_are_told_at_once(opened, tmp_path):
    for key in ("syslog.ca_file", "syslog.cert_file", "mqtt.password_file", "mqtt.code_file"):
        name, _, word = key.partition(".")
        url = "syslog:tls://h" if name == "syslog" else "mqtt://me@h"
        with pytest.raises(ConfigError, match=rf"{key}: .*none"):
            opened(url, **{name: {word: tmp_path / "none"}})


def test_syslog_over_udp_with_severity(opened):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.bind(("127.0.0.1", 0))
        far.settimeout(60)
        url = f"syslog:udp://127.0.0.1:{far.getsockname()[1]}"
        sink = opened(url, syslog={"facility": "local3"})
        trial = {**event(2), "test": True, "simulated": True}
        for record in (hello(), decision(), event(1), event(1, phase="end")):
            sink.write(record)
        sink.write(status("offline", "device absent"))
        sink.write(trial)
        told = [far.recv(4096).decode() for _ in range(4)]
    facility = 19 << 3
    heads = [re.match(r"(<\d+>1) 20\S+Z \S+ radard \d+ \w+ - hall: ", text)[1] for text in told]
    # A test rouses nobody at night, and is no real alarm to who reads it later.
    assert heads == [f"<{facility | severity}>1" for severity in (1, 5, 4, 5)]
    assert "hall: alarm new (test, simulated): human at 2.0 m" in told[3]
    assert not any("\0" in text for text in told)
    assert "hall: alarm new: human at 1.0 m" in told[0]
    assert "offline: device absent" in told[2]


HOSTS = ["h\\ost", "h..l", "h;x", "h,b", "h%2fx", "h:00", "h:0", "h ost", 64 * "h"]


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("scheme", ["webhook:http", "mqtt", "mqtts", "syslog:udp", "syslog:tls"])
def test_what_no_host_is_called_is_said(opened, scheme, host):
    with pytest.raises(ConfigError, match=r"^\S+ \S+ no host has such a name and port$"):
        opened(f"{scheme}://{host}")


BAD = ["u@h", ":secret@h", "u:secret@h\n", "h?x=1", "h#x"]


@pytest.mark.parametrize(
    ("url", "error", "words"),
    [
        ("webhook:ftp://h/", UsageError, "webhook:http://HOST"),
        ("webhook:http://u:secret@h/", UsageError, "do not belong there"),
        ("webhook:http://u:secret@h\n/", ConfigError, "no host has"),
        ("webhook:@/nowhere/url", ConfigError, "No such file"),
        *((f"syslog:udp://{rest}", UsageError, "use syslog:") for rest in BAD),
        *((f"http://{rest}", UsageError, "use http://127.0") for rest in [*BAD, "h/x", "h;x"]),
        ("mqtt://h/a\udcff", UsageError, "what no topic may"),
        ("mqtt://", UsageError, "no host"),
        ("mqtt://u:secret@h", UsageError, "no password in the URL"),
        ("mqtt://u:secret", UsageError, "no host has such a name and port"),
        ("mqtt://h:70000", UsageError, "--output mqtt: Port out of range"),
        ("mqtt://h?x=1", UsageError, "nothing may follow"),
        ("exec:/nowhere/program", OutputError, "no such program"),
        ("exec:'", UsageError, "No closing quotation"),
        ("exec: ", UsageError, "no command"),
        ("store:/proc/nope/x.db", OutputError, "cannot be used"),
        ("json:/nowhere/x", OutputError, "cannot write there"),
        *((odd, UsageError, "unknown or incomplete") for odd in ("smoke:signal", "webhook", "")),
    ],
)
def test_bad_outputs_give_one_clear_line(opened, url, error, words):
    with pytest.raises(error, match=re.escape(words)) as caught:
        opened(url)
    assert not re.search(r"secret|\n", str(caught.value))


def test_a_server_is_named_as_it_was(opened):
    for name in ("webhook:http://[::1]:80", "webhook:http://h\u00f6.a", "mqtt://[::1]:83/radard"):
        assert opened(name).name == name


def test_without_its_package_an_output_names_the_extra(opened, monkeypatch):
    for url, package, extra in (("apprise:a://h", "apprise", "notify"), ("lsl:x", "pylsl", "lsl")):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(MissingExtra, match=rf"needs {package}.*\[{extra}\]"):
            opened(url)
