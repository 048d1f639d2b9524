"""What the daemon tells of itself: every metric that there is, readiness, resources."""

import contextlib
import socket
import time

import pytest
from prometheus_client.parser import text_string_to_metric_families

from radard.alarm.sensor_state import SensorState
from radard.pipeline import Pipeline
from radard.stream.frame_timing import Drift
from radard.web.metrics import HELP, Metrics, exposition
from tests import alarm_helpers
from tests.sink_helpers import event, well_host
from tests.waiting import free_port, wait_for
from tests.web_helpers import ask, wait


def samples(text):
    """Values by name and labels; the parser itself refuses what is not the format."""
    families = text_string_to_metric_families(text)
    found = [sample for family in families for sample in family.samples]
    return {(each.name, *sorted(each.labels.items())): each.value for each in found}


@pytest.fixture
def scraped(request, tmp_path, launch):
    """A daemon whose module loses frames, and what it tells at a moment."""
    base = f"http://127.0.0.1:{free_port()}"
    daemon = launch(
        stale_s=getattr(request, "param", 60.0),
        sensor={"port": "sim:human?fault=drop_frames:0.01", "speed": "10"},
        model={"name": "thesis"},
        alarm={"sensitivity": "high"},
        clips={"enabled": False},
        output=[base, f"json:{tmp_path / 'out.jsonl'}"],
    )
    wait(lambda: ask(base + "/healthz")[0] == 200)

    def scrape():
        return samples(ask(base + "/metrics")[1].decode())

    scrape.daemon = daemon
    yield scrape
    assert daemon.stop() == 0


@pytest.mark.integration
def test_all_of_them_are_fed(scraped):
    json_sink = ("sink", f"json:{scraped.daemon.config.output[1].removeprefix('json:')}")
    wait_for(lambda: scraped().get(("radard_human_score_count",), 0) > 2)
    wait_for(lambda: scraped().get(("radard_frames_dropped_total", ("reason", "lost")), 0) > 0)
    found = scraped()
    assert found["radard_up",] == 1
    told = {name for name, *_ in found}
    for family, (kind, _) in HELP.items():
        wanted = f"{family}_count" if kind == "histogram" else family
        # No event yet, and a clock is compared over minutes.
        is_late = family == "radard_events_total" or "clock_drift" in family
        assert wanted in told or is_late, family
    assert found["radard_frames_total",] > 300
    assert (found["radard_armed",], found["radard_frame_rate_hertz",]) == (1, 60)
    n = found["radard_decision_latency_seconds_count",]
    decisions = sum(v for (name, *_), v in found.items() if name == "radard_decisions_total")
    # A dwell whose last frame was lost has no frame to count from.
    assert 0 <= decisions - n <= found["radard_frames_dropped_total", ("reason", "lost")]
    assert found["radard_sink_ok", json_sink] == 1
    wait_for(lambda: scraped()["radard_sink_sent_records_total", json_sink] > n)
    wait_for(lambda: scraped()["radard_frames_total",] > found["radard_frames_total",])
    wait_for(lambda: ("radard_events_total", ("kind", "alarm"), ("phase", "new")) in scraped())


@pytest.mark.integration
@pytest.mark.parametrize("scraped", [1.5], indirect=True, ids=["soon stale"])
def test_a_daemon_that_decides_nothing_is_not_up(scraped, monkeypatch, gate):
    gate.before(monkeypatch, Pipeline, "decide")
    wait_for(lambda: scraped()["radard_up",] == 1)
    gate.shut()
    # One scrape: it may decide once more between two.
    seen = []
    wait_for(lambda: seen.append(scraped()) or seen[-1]["radard_up",] == 0)
    assert seen[-1]["radard_state", ("state", "offline")] == 1
    scraped.daemon.radar.command("disarm")
    gate.open()
    wait_for(lambda: scraped()["radard_armed",] == 0)
    wait_for(lambda: scraped()["radard_up",] == 1)


def test_drift_is_told_where_it_is_known_and_numbers_of_ours_alone():
    both = []
    for name, drift in (("hall", Drift(2e-5, 1e-6)), ("attic", None)):
        metrics, host = Metrics(name), well_host()
        host.driver, host.state = lambda: {"frames": 7, "odd": 1}, SensorState(clock_drift=drift)
        metrics.refresh(host)
        both.append(metrics)
    text = exposition(both)
    found = samples(text)
    assert [found["radard_frames_total", ("sensor", name)] for name in ("hall", "attic")] == [7, 7]
    assert {key: value for key, value in found.items() if "clock_drift" in key[0]} == {
        ("radard_module_clock_drift_ratio", ("sensor", "hall")): 2e-5,
        ("radard_module_clock_drift_uncertainty_ratio", ("sensor", "hall")): 1e-6,
    }
    assert "odd" not in text


def test_a_test_alarm_is_no_alarm_for_those_who_count():
    metrics = Metrics()
    metrics.on_record({**event(1), "test": True})
    found = samples(exposition([metrics]))
    assert found["radard_event_active", ("kind", "alarm")] == 0
    assert not any(name == "radard_events_total" for name, *_ in found)


def test_ready_is_more_than_alive(client):
    health = client.run.health
    assert client.get("/readyz").status_code == 503
    health.on_decision(alarm_helpers.decision(1.0, t_mono_s=time.monotonic()))
    assert client.get("/readyz").json() == {"state": "online", "reason": ""}
    health.complain("mqtt", "no broker")
    assert client.get("/healthz").status_code == 200
    answer = client.get("/readyz")
    assert (answer.status_code, answer.json()["reason"]) == (503, "mqtt: no broker")
    health.on_end("stopped")
    assert client.get("/readyz").status_code == 503


def test_what_the_process_uses(client):
    client.tell({"type": "status", "state": "online", "reason": ""})

    def scrape(what):
        return samples(client.get("/metrics").text)[f"radard_process_{what}",]

    assert 10e6 < scrape("resident_memory_bytes") < 4e9
    assert scrape("cpu_seconds_total") == pytest.approx(time.process_time(), abs=1)
    assert scrape("threads") >= 1
    n_before = scrape("open_fds")
    with contextlib.ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(socket.socket())
        assert scrape("open_fds") >= n_before + 15
