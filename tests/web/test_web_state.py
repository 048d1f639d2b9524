"""What the dashboard tells of the daemon itself: readiness, resources, what is not real."""

import contextlib
import socket
import time

from prometheus_client.parser import text_string_to_metric_families


def test_ready_is_more_than_alive(make):
    client = make()
    health = client.run.host.health
    assert client.get("/readyz").status_code == 503
    health.on_decision(Decided())
    assert client.get("/readyz").json() == {"state": "online", "reason": ""}
    health.complain("mqtt", "no broker")
    assert client.get("/healthz").status_code == 200
    answer = client.get("/readyz")
    assert (answer.status_code, answer.json()["reason"]) == (503, "mqtt: no broker")
    health.on_end("stopped")
    assert client.get("/readyz").status_code == 503


class Decided:
    """As much of a decision as health takes."""

    gate, fault = "closed", ""

    def __init__(self):
        self.t_mono_s = time.monotonic()


def test_what_the_process_uses(make):
    client = make()
    client.tell({"type": "status", "state": "online", "reason": ""})

    def scrape():
        families = text_string_to_metric_families(client.get("/metrics").text)
        return {s.name: s.value for f in families for s in f.samples}

    before = scrape()
    assert 10e6 < before["radard_process_resident_memory_bytes"] < 4e9
    end_s = time.process_time() + 0.2
    while time.process_time() < end_s:
        pass
    with contextlib.ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(socket.socket())
        after = scrape()
    used_s = after["radard_process_cpu_seconds_total"] - before["radard_process_cpu_seconds_total"]
    assert 0.15 < used_s < 60
    assert after["radard_process_open_fds"] >= before["radard_process_open_fds"] + 15
    assert after["radard_process_threads"] >= 1
