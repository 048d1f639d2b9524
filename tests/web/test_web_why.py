"""A decision in words: which stage decided, with its numbers."""

import pytest

from radard.alarm.explain import explain
from radard.config.config import load_config
from tests.web_helpers import decision, event, open_decision

HELLO = {"pet_limit": 0.8, "policy": "window"}


def config(**sections):
    return load_config(environ={}, options={"sensor": {"port": "sim:empty"}, **sections})


def said(*records, events=(), panel="armed", hello=HELLO, **sections):
    """What decided, and in which words."""
    found = explain(records, hello, config(**sections), events, panel)
    by = next(s for s in found["stages"] if s["name"] == found["decided_by"])
    return found["decided_by"], found["headline"], by["text"]


def test_a_closed_gate():
    by, headline, text = said(decision())
    assert (by, headline) == ("gate", "Nothing moves")
    assert "5.9 dB under the threshold" in text


def test_who_left_undecided_is_not_called_nobody():
    pending = open_decision(1, 2.45, human=0.3) | {"label": "pending", "alarm": False}
    left = decision(2, 3.45) | {"alarm": True}
    began = event(start_t_s=3.45, reason="undecided at 2.2 m")
    found = explain([pending, left], HELLO, config(alarm={"confirm_k": 1}), [began], "armed")
    gate = next(s for s in found["stages"] if s["name"] == "gate")
    assert gate["plain"] == "Yes: it left undecided, and that counts as a person."
    assert (found["headline"], found["decided_by"]) == ("Undecided: alarm", "confirmation")


def test_an_undecided_visit_is_not_called_a_person():
    records = [open_decision(k, 1.45 + k, human=0.3) for k in (1, 2)]
    _, headline, _ = said(*records, events=[event(start_t_s=3.45)])
    assert headline == "Undecided: alarm"


def test_a_gap():
    by, _, text = said(decision(gate="invalid", label="invalid", frames=140, dropped=7))
    assert by == "frames"
    assert "7 of 147 frames are missing" in text


def test_a_fault_of_another_kind_takes_its_reason_from_the_event():
    fault = event(kind="fault", reason="internal error", start_t_s=2.0, end_t_s=None)
    _, _, text = said(decision(gate="invalid", label="invalid"), events=[fault])
    assert text == "The window is invalid: internal error."


def test_a_pet():
    by, headline, text = said(open_decision(human=0.1))
    assert (by, headline) == ("rule", "A pet")
    assert text == "p(pet) 0.90 > 0.80: a pet, no alarm."


def test_a_pet_that_is_not_sure_enough_counts_as_human():
    records = [open_decision(1, 2.45, human=0.05), open_decision(2, 3.45, human=0.26)]
    found = explain(records, HELLO, config(), (), "armed")
    rule = next(s for s in found["stages"] if s["name"] == "rule")
    assert rule["text"].startswith("p(pet) 0.74 ≤ 0.80")
    assert found["decided_by"] == "confirmation"
    assert "Not confirmed yet: 1 of the last 3 windows" in found["stages"][-1]["text"]


def test_the_window_that_begins_an_alarm():
    records = [open_decision(k, 1.45 + k, human=0.9) for k in (1, 2)]
    alarm = event(start_t_s=3.45)
    by, headline, text = said(*records, events=[alarm])
    assert (by, headline) == ("confirmation", "A person: alarm")
    assert (
        text == "Confirmed: 2 of the last 3 windows say human; 2 are needed. The alarm began here."
    )


def test_windows_after_that_say_that_it_is_on():
    records = [open_decision(k, 1.45 + k, human=0.9) for k in (1, 2, 3)]
    by, _, text = said(*records, events=[event(start_t_s=3.45, cause="human at 1.8 m")])
    assert (by, text) == ("panel", "The alarm is on already (human at 1.8 m).")


def test_disarmed():
    records = [open_decision(k, 1.45 + k, human=0.9) for k in (1, 2)]
    by, _, text = said(*records, panel="disarmed")
    assert by == "panel"
    assert "disarmed" in text


def test_the_exit_delay():
    by, _, text = said(open_decision(human=0.9), open_decision(human=0.9), panel="exit")
    assert (by, "exit delay is running" in text) == ("panel", True)


def test_who_is_at_home_where_people_are_at_home():
    zones = {"away": [[0, 100]]}
    for mode, wanted in (("home", "zones"), ("away", "confirmation")):
        record = open_decision(human=0.9)
        found = explain([record], HELLO, config(zones=zones), (), "armed", mode=mode)
        assert found["decided_by"] == wanted


def test_entry_delay_or_quiet():
    records = [open_decision(k, 1.45 + k, human=0.9) for k in (1, 2)]
    by, _, text = said(*records, panel="entry")
    assert by == "panel"
    assert "entry delay" in text


def test_outside_of_the_zones():
    by, _, text = said(open_decision(human=0.9), zones={"exclude": [[1.5, 2.5]]})
    assert by == "zones"
    assert "outside" in text


def test_no_model():
    record = open_decision(human=0.9) | dict.fromkeys(("label", "p_human", "fused_p_human"))
    by, headline, _ = said(record | {"alarm": False})
    assert by == "classifier"
    assert "no model" in headline


def test_pending_evidence():
    record = open_decision(human=0.5) | {"label": "pending", "alarm": False, "fused_p_human": 0.4}
    by, headline, _ = said(record)
    assert (by, headline) == ("rule", "Not decided yet")


@pytest.mark.parametrize("human", [0.0, 0.1, 0.19, 0.21, 0.5, 1.0])
@pytest.mark.parametrize("other", [0.0, 0.05])
def test_exactly_one_stage_decides_and_it_is_the_last(human, other):
    if human + other > 1:
        return
    found = explain([open_decision(human=human, other=other)], HELLO, config(), (), "armed")
    outcomes = [s["outcome"] for s in found["stages"]]
    assert outcomes.count("decided") == 1
    assert outcomes[-1] == "decided"
