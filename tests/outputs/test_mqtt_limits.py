"""Brokers that take no large packets: what they state, and what breaking lines teach."""

from radard.outputs.mqtt import link as link_module
from radard.outputs.mqtt.link import PacketLimits, Publication

PICTURE = Publication("radard/hall/picture", b"x" * 20_000)
STATE = Publication("radard/hall/state", "{}")


def never():
    return False


def test_what_a_broker_states_is_the_limit_and_said_once():
    said = []
    limits = PacketLimits(said.append)
    limits.max_bytes = 10_000
    assert [limits.takes(message) for message in (STATE, PICTURE, PICTURE)] == [True, False, False]
    assert len(said) == 1
    assert "radard/hall/picture is left out" in said[0]


def test_the_largest_in_flight_is_left_out_when_the_line_broke_twice():
    said = []
    limits = PacketLimits(said.append)
    for n in range(2):
        assert limits.takes(PICTURE)
        for message in (STATE, PICTURE):
            limits.sent(message, never)
        assert not limits.is_idle
        assert len(said) == 0, n
        assert limits.broke()
    assert limits.takes(STATE)
    assert not limits.takes(PICTURE)
    # A smaller one may pass.
    assert limits.takes(Publication(PICTURE.topic, b"x" * 5_000))
    assert len(said) == 1


def test_small_and_confirmed_messages_are_never_to_blame(monkeypatch):
    limits = PacketLimits(lambda _text: None)
    for _ in range(5):
        limits.sent(STATE, never)
        limits.sent(PICTURE, lambda: True)
        assert not limits.broke()
    assert limits.takes(STATE)
    assert limits.takes(PICTURE)


def test_after_a_day_it_is_tried_again(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(link_module.time, "monotonic", lambda: now_s[0])
    limits = PacketLimits(lambda _text: None)
    limits.sent(PICTURE, never)
    assert limits.broke()
    now_s[0] = 100_000.0
    limits.sent(PICTURE, never)
    assert limits.broke()
    assert limits.takes(PICTURE)
