"""MQTT against a real broker over TCP: topics, last will, commands, discovery, limits."""

import json
import ssl

import pytest

from radard.alarm.sensor_state import SensorState
from radard.config.sink_table import MqttSection, SinkOptions
from radard.health.health import Status
from radard.outputs.base import SinkContext
from radard.outputs.mqtt import link as link_module
from radard.outputs.mqtt.link import MqttLink, PacketLimits, Publication
from radard.outputs.mqtt.topics import MqttTopics
from radard.outputs.registry import make_output
from tests import sink_helpers as far
from tests.sink_helpers import MQTT_MARKS, Listener, Relay, decision, event, hello, status, ulid
from tests.waiting import wait_for

BASE = "radard/hall"
pytestmark = MQTT_MARKS


def last(listener, topic):
    found = listener.on(f"{BASE}/{topic}")
    return found[-1].decode() if found else None


def ids(listener):
    return [json.loads(body)["id"] for body in listener.on(f"{BASE}/event")]


def test_topics_of_a_run_and_their_clean_end(publish, listen):
    listener = listen("radard/#")
    sink = publish(hello(), status("online"), event(1), discovery="off")
    wait_for(lambda: last(listener, "availability") == "online" and ids(listener))
    sink.write(decision(1))
    wait_for(lambda: last(listener, "decision"))
    wait_for(lambda: json.loads(last(listener, "state") or "{}").get("alarm"))
    state = json.loads(last(listener, "state"))
    wanted = {"armed": True, "alarm": True, "label": "human", "gate": "open", "t_s": 2.45}
    assert state == {**wanted, "panel": "triggered", "sensitivity": "normal"}
    assert json.loads(last(listener, "decision"))["seq"] == 1
    sink.write(event(1, phase="end"))
    wait_for(lambda: json.loads(last(listener, "state"))["alarm"] is False)
    sink.close()
    wait_for(lambda: last(listener, "availability") == "offline")
    late = listen("radard/#")
    wait_for(lambda: last(late, "availability") == "offline" and last(late, "health"))
    kept = {topic for topic, _, is_retained in late.messages if is_retained}
    assert kept == {f"{BASE}/{name}" for name in ("availability", "state", "health")}


def test_that_it_is_there_is_said_again_and_again():
    """Before, the will of a connection that was replaced, or of another daemon, was the last."""
    topics = MqttTopics("hall", "radard", MqttSection(), takes_commands=False)
    topics.on_record(hello(), 0.0)
    told = []
    for k in range(30):
        for found in (
            topics.refresh(float(k), Status("online", ""), None),
            topics.on_record(decision(k), float(k)),
        ):
            told += [k for each in found if each.topic.endswith("/availability")]
    assert sorted(set(told)) == [0, 9, 18, 27]


def test_health_is_asked_for_and_not_only_heard_of(publish, listen):
    listener = listen(f"{BASE}/#")
    radar = far.well_host()
    publish(hello(), decision(1), discovery="off", radar=radar)
    wait_for(lambda: last(listener, "availability") == "online")
    # No record says so: the thread that writes them is the one that hangs.
    radar.health.on_failure("no answer")
    wait_for(lambda: last(listener, "availability") == "offline")
    wait_for(lambda: json.loads(last(listener, "health"))["reason"] == "no answer")
    radar.health, radar.state = far.well_host().health, SensorState(armed=False)
    wait_for(lambda: last(listener, "availability") == "online")
    wait_for(lambda: json.loads(last(listener, "state"))["armed"] is False)


def test_commands_and_what_is_none(publish, listen, caplog):
    listener = listen(f"{BASE}/#")
    radar = far.well_host()
    listener.say(f"{BASE}/command/disarm", "now", retain=True)
    publish(hello(), discovery="off", radar=radar)
    wait_for(lambda: "retained" in caplog.text)
    # A flood of what is none is logged once.
    for n in range(20):
        listener.say(f"{BASE}/command/explode{n}{'x' * 200}")
    listener.say(f"{BASE}/command/arm", "1")
    for name in ("ack", "arm", "disarm", "calibrate"):
        listener.say(f"{BASE}/command/{name}")
    wait_for(lambda: len(radar.asked) == 4)
    assert radar.asked == ["ack", "arm", "disarm", "calibrate"]
    lines = [r.getMessage() for r in caplog.records if " command " in r.getMessage()]
    (line,) = [line for line in lines if "ignored" in line or "no command" in line]
    assert len(line) < 200


def test_a_stranger_cannot_disarm_where_nothing_is_said_of_commands(publish, listen, caplog):
    listener, found = listen(f"{BASE}/#"), listen("homeassistant/#")
    radar = far.well_host()
    sink = publish(hello(), status("online"), commands="auto", radar=radar)
    wait_for(lambda: last(listener, "availability") == "online")
    listener.say(f"{BASE}/command/disarm")
    wait_for(lambda: last(listener, "command/disarm") == "")
    sink.write(event(1))
    wait_for(lambda: ids(listener))
    assert radar.asked == []
    assert "takes no commands" in caplog.text
    topic = "homeassistant/device/radard_hall/config"
    parts = json.loads(wait_for(lambda: found.on(topic))[-1])["cmps"]
    # The platform alone: what an earlier version offered goes.
    assert parts["disarm"] == {"p": "button"}
    assert "stat_t" in parts["alarm"]


@pytest.mark.parametrize("given", ["auto", "always", "off"])
def test_what_takes_commands(given, tmp_path, monkeypatch):
    monkeypatch.setattr(MqttLink, "_new_client", lambda _: None)
    (tmp_path / "words").write_text("x\n")
    password = {"username": "u", "password_file": tmp_path / "words"}
    certificate = {"cert_file": tmp_path / "cert", "key_file": tmp_path / "key"}
    taken = set()
    for scheme in ("mqtt", "mqtts"):
        for name, section in (("-", {}), ("password", password), ("certificate", certificate)):
            options = SinkOptions(mqtt=MqttSection(commands=given, **section))
            context = SinkContext(sensor="hall", host=far.well_host())
            topics = make_output(f"{scheme}://h", options, context)._link.subscriptions
            taken |= {f"{scheme} {name}"} if f"{BASE}/command/+" in topics else set()
    everything = {f"{s} {n}" for s in ("mqtt", "mqtts") for n in ("-", "password", "certificate")}
    secure = {"mqtts password", "mqtts certificate"}
    assert taken == {"auto": secure, "always": everything}.get(given, set())


@pytest.mark.parametrize("form", ["device", "components"])
def test_discovery_of_home_assistant(publish, listen, form):
    listener = listen("homeassistant/#")
    publish(hello(), discovery=form)

    def configs():
        told = dict(message[:2] for message in listener.messages if message[1] != b"online")
        return {topic: json.loads(body) for topic, body in told.items() if body}

    whole = "homeassistant/device/radard_hall/config"
    last_one = whole if form == "device" else "homeassistant/button/radard_hall/ack/config"
    wait_for(lambda: last_one in configs())
    found = configs()
    if form == "device":
        assert set(found) == {whole}
        parts = found[whole]["cmps"]
        one = {**found[whole], **parts["alarm"]}
        wanted = {"binary_sensor", "sensor", "button", "alarm_control_panel", "event", "image"}
        assert {part["p"] for part in parts.values()} == wanted | {"select"}
    else:
        assert whole not in found
        one = found["homeassistant/binary_sensor/radard_hall/alarm/config"]
        assert all(config["dev"]["ids"] == ["radard_hall"] for config in found.values())
    wanted = {"dev_cla": "motion", "stat_t": f"{BASE}/state", "avty_t": f"{BASE}/availability"}
    assert one | wanted | {"exp_aft": 30} == one
    # Home Assistant has started anew and asks who is there.
    listener.messages.clear()
    listener.say("homeassistant/status", "online")
    wait_for(lambda: last_one in configs())


def test_a_change_of_form_leaves_nothing_behind(publish, listen):
    sink = publish(hello(), discovery="device")
    listener = listen("homeassistant/#")
    wait_for(lambda: listener.messages)
    sink.close()
    again = publish(hello(), discovery="off", client_id="another")
    wait_for(lambda: listener.messages[-1][1] == b"" and len(listener.messages) > 1)
    again.close()
    late = listen("homeassistant/#", "end")
    late.say("end")
    wait_for(lambda: late.on("end"))
    assert [topic for topic, _, _ in late.messages] == ["end"]


@pytest.mark.parametrize("max_bytes", [10_000, 4096])
def test_a_broker_that_limits_packets_gets_every_event_and_the_rest_is_said(
    publish, listen, broker, tmp_path, max_bytes
):
    listener, relay = listen("#"), Relay(broker.port, max_bytes)
    relay.open()
    clip = tmp_path / f"{ulid(1)}.h5"
    clip.with_suffix(".png").write_bytes(b"x" * 20_000)
    sink = publish(hello(), status("online"), decision(1), url=f"mqtt://127.0.0.1:{relay.port}")
    for n in range(1, 31):
        sink.write({**event(n), "clip": str(clip)})
    wait_for(lambda: set(ids(listener)) == {ulid(n) for n in range(1, 31)})
    wait_for(lambda: sink.state.remark)
    wait_for(lambda: last(listener, "state"))
    sink.write(event(31))
    wait_for(lambda: ulid(31) in ids(listener))
    assert "picture is left out" in sink.state.remark or max_bytes == 4096
    sink.close(1.0)
    relay.close()


def test_a_test_alarm_is_an_event_and_sounds_no_siren(publish, listen):
    listener = listen(f"{BASE}/#")
    test = {**event(1), "test": True}
    sink = publish(hello(), status("online"), decision(1), test, discovery="off")
    wait_for(lambda: ids(listener) and last(listener, "state"))
    sink.write(event(2))
    wait_for(lambda: json.loads(last(listener, "state"))["alarm"])
    panels = [json.loads(body)["panel"] for body in listener.on(f"{BASE}/state")]
    assert (panels[0], panels[-1]) == ("armed_away", "triggered")
    sink.write({**event(2, phase="end"), "test": True})
    assert json.loads(listener.on(f"{BASE}/event")[0])["test"] is True


@pytest.mark.parametrize("mark", ["simulated", "replayed"])
def test_what_no_module_sends_has_topics_and_a_client_of_its_own(publish, listen, tmp_path, mark):
    listener = listen("#")
    for each in ("", mark):
        told = (hello(), status("online"), event(1))
        publish(*told, mark=each, client_id="house", decisions=False)
    base = f"radard/hall-{mark}"
    wait_for(lambda: listener.on(f"{base}/event") and ids(listener))
    wait_for(lambda: listener.on(f"{base}/availability")[-1:] == [b"online"])
    wait_for(lambda: listener.on(f"homeassistant/device/radard_hall-{mark}/config"))
    found = json.loads(listener.on(f"homeassistant/device/radard_hall-{mark}/config")[-1])
    assert found["dev"]["ids"] == [f"radard_hall-{mark}"]
    own = [c["uniq_id"] for c in found["cmps"].values() if "uniq_id" in c]
    assert own
    assert all(text.startswith(f"radard_hall-{mark}_") for text in own)
    wait_for(lambda: last(listener, "availability") == "online")
    assert len(ids(listener)) == len(listener.on(f"{base}/event")) == 1


def test_over_tls_and_with_a_password_commands_are_taken(tmp_path):
    cert = far.make_cert(tmp_path)
    broker = far.MqttBroker(tmp_path, cert=cert, auth=True)
    trusted = ssl.create_default_context(cafile=cert[0])
    listener = Listener(broker.port, f"{BASE}/#", tls=trusted, user=(far.USER, far.PASSWORD))
    good, bad, radar = tmp_path / "good", tmp_path / "bad", far.well_host()
    good.write_text(f"{far.PASSWORD}\n")
    bad.write_text("wrong\n")
    try:
        for section, words in (
            ({"password_file": good}, "certificate is not accepted"),
            ({"password_file": bad, "ca_file": cert[0]}, "refuses"),
            ({"password_file": good, "ca_file": cert[0]}, ""),
        ):
            # Nothing is said of commands.
            options = SinkOptions(log=far.QUICK, mqtt=MqttSection(discovery="off", **section))
            url = f"mqtts://{far.USER}@localhost:{broker.port}"
            sink = far.open_sink(url, options, host=radar)
            for record in (hello(), status("online"), event(1)):
                sink.write(record)
            if words:
                wait_for(lambda s=sink, w=words: w in s.state.reason)
                assert "wrong" not in sink.state.reason
            else:
                wait_for(lambda: ids(listener))
                listener.say(f"{BASE}/command/disarm")
                wait_for(lambda: radar.asked == ["disarm"])
            sink.close(0.5)
    finally:
        listener.close()
        broker.stop()


PICTURE = Publication("radard/hall/picture", b"x" * 20_000)
STATE = Publication("radard/hall/state", "{}")


def test_what_a_broker_states_is_the_limit_and_said_once():
    said = []
    limits = PacketLimits(said.append)
    limits.max_bytes = 10_000
    assert [limits.takes(message) for message in (STATE, PICTURE, PICTURE)] == [True, False, False]
    assert said == ["radard/hall/picture is left out: 20031 bytes, and the broker takes 10000"]


def test_the_largest_in_flight_is_left_out_for_a_day_when_the_line_broke_twice(monkeypatch):
    said, now_s = [], [0.0]
    monkeypatch.setattr(link_module.time, "monotonic", lambda: now_s[0])
    limits = PacketLimits(said.append)
    for _ in range(5):
        # Small and confirmed messages are never to blame.
        limits.sent(STATE, bool)
        limits.sent(PICTURE, lambda: True)
        assert not limits.broke()
    # Breaks that lie more than a day apart had two causes.
    for now_s[0], is_taken in ((0.0, True), (100_000.0, True), (100_001.0, False)):
        for message in (STATE, PICTURE):
            limits.sent(message, bool)
        assert limits.in_flight()
        assert said == []
        assert limits.broke()
        assert limits.takes(PICTURE) is is_taken
    assert limits.takes(STATE)
    # A smaller one may pass.
    assert limits.takes(Publication(PICTURE.topic, b"x" * 5_000))
    assert len(said) == 1
