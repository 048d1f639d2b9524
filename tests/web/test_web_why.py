"""A decision in words: which stage decided, with its numbers."""

import pytest

from radard.alarm.explain import explain
from radard.alarm.sensor_state import SensorState
from radard.config.config import Config, load_config
from tests.web_helpers import decision, event, open_decision

HELLO = {"pet_limit": 0.8, "policy": "window"}


def config(**sections):
    return load_config(environ={}, options={"sensor": {"port": "sim:empty"}, **sections})


def said(*records, events=(), hello=HELLO, state=(), **sections):
    """What decided, and in which words."""
    state = SensorState(t_s=records[-1]["t_s"] - 1, **dict(state))
    found = explain(records, hello, config(**sections), events, state)
    # Exactly one stage decides, and it is the last.
    *before, by = found["stages"]
    assert by["name"] == found["decided_by"]
    assert [stage["outcome"] for stage in before] == ["passed"] * len(before)
    return found["decided_by"], found["headline"], by["text"]


def seen(n=1, human=0.9, **changes):
    """Decisions with the gate open, a second from one to the next."""
    return [open_decision(k, 1.45 + k, human=human) | changes for k in range(1, n + 1)]


INVALID = {"gate": "invalid", "label": "invalid"}
FAULT = event(kind="fault", reason="internal error", start_t_s=2.0, end_t_s=None)
BEGAN = event(start_t_s=3.45, cause="human at 1.8 m")
PENDING = {"label": "pending", "alarm": False, "fused_p_human": 0.4}
ENDED = event(phase="end", start_t_s=0.5, end_t_s=2.0)
QUIET = {"quiet": ["05:00-06:30"], "timezone": "UTC"}
UNSURE = "Not confirmed yet: 1 of the last 3 windows"
ONE = {"confirm_k": 1, "confirm_n": 1}
EXIT = {"panel": "exit", "delay_left_s": 9.2}
ENTRY = {"panel": "entry", "delay_left_s": 20.0}
AWAY = {"away": [[0, 100]]}
NO_MODEL = dict.fromkeys(("label", "p_human", "fused_p_human")) | {"alarm": False}
CONFIRMED = "Confirmed: 2 of the last 3 windows say human; 2 are needed. The alarm began here."


@pytest.mark.parametrize(
    ("records", "around", "decided_by", "headline", "text"),
    [
        ([decision()], {}, "gate", "Nothing moves", "5.9 dB under the threshold"),
        (
            *([decision(**INVALID, frames=140, dropped=7)], {}, "frames", ""),
            "7 of 147 frames are missing",
        ),
        (
            *([decision(**INVALID)], {"events": [FAULT]}, "frames", ""),
            "The window is invalid: internal error.",
        ),
        (seen(human=0.1), {}, "rule", "A pet", "p(pet) 0.90 > 0.80: a pet, no alarm."),
        (seen(human=0.5, **PENDING), {}, "rule", "Not decided yet", ""),
        (seen(**NO_MODEL), {}, "classifier", "no model", ""),
        (seen(2), {"events": [BEGAN]}, "confirmation", "A person: alarm", CONFIRMED),
        (seen(2, 0.3), {"events": [BEGAN]}, "confirmation", "Undecided: alarm", ""),
        (seen(3), {"events": [BEGAN]}, "panel", "", "The alarm is on already (human at 1.8 m)."),
        (seen(2), {"state": {"panel": "disarmed"}}, "panel", "", "disarmed"),
        (seen(2), {"state": EXIT}, "panel", "", "delay is running: 8 s left"),
        (seen(2), {"state": ENTRY}, "panel", "", "running: 19 s left to disarm"),
        ([*seen(human=0.05), *seen(human=0.26, seq=2, t_s=3.45)], {}, "confirmation", "", UNSURE),
        (seen(), {"zones": AWAY, "state": {"mode": "home"}}, "zones", "", "outside"),
        (seen(), {"zones": AWAY}, "confirmation", "", ""),
        (seen(2), {"alarm": {"entry_delay_s": 30}}, "panel", "", "begins here: 30 s to disarm"),
        (seen(2), {"events": [ENDED]}, "panel", "", "pause after the last alarm: 9 s left."),
        (seen(2), {"alarm": QUIET}, "panel", "", "a quiet period: 0 h 30 min left."),
        (seen(), {"alarm": ONE}, "panel", "", "This window says human, and one is enough, but"),
        (seen(), {"zones": {"exclude": [[1.5, 2.5]]}}, "zones", "", "outside"),
    ],
)
def test_a_decision_in_words(records, around, decided_by, headline, text):
    by, said_headline, said_text = said(*records, **around)
    assert by == decided_by
    assert headline in said_headline
    assert text in said_text


@pytest.mark.parametrize(
    ("started_utc", "words"),
    [
        ("2026-03-01T05:59:00Z", "a quiet period: 0 h 30 min left."),
        ("2026-03-01T12:00:00Z", "it counts from when it was armed"),
        (None, "it counts from when it was armed"),
    ],
)
def test_hours_of_a_replay_are_those_of_its_recording(started_utc, words):
    config = Config(alarm={"quiet": ["05:00-06:30"], "timezone": "UTC"})
    hello = {"policy": "window", "replayed": True, "started_utc": started_utc}
    records = seen(62)
    assert words in explain(records, hello, config)["stages"][-1]["text"]


def test_who_left_undecided_is_not_called_nobody():
    pending = open_decision(1, 2.45, human=0.3) | {"label": "pending", "alarm": False}
    left = decision(2, 3.45) | {"alarm": True}
    began = event(start_t_s=3.45, reason="undecided at 2.2 m")
    found = explain([pending, left], HELLO, config(alarm={"confirm_k": 1}), [began])
    gate = next(s for s in found["stages"] if s["name"] == "gate")
    assert gate["plain"] == "Yes: it left undecided, and that counts as a person."
    assert (found["headline"], found["decided_by"]) == ("Undecided: alarm", "confirmation")


def test_who_showed_but_briefly_is_not_called_nobody_either():
    pending = open_decision(1, 2.45, human=0.3) | {"label": "pending", "alarm": False}
    lost = decision(2, 3.45) | {"gate": "invalid", "label": "invalid"}
    for before in ([pending], [pending, lost]):
        found = explain([*before, decision(3, 4.45)], HELLO, config())
        assert found["stages"][-1]["plain"].startswith("No: it showed but briefly")
        assert found["decided_by"] == "gate"
