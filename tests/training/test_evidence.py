"""Evidence over windows, and the rule over time."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.errors import ModelMismatch
from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Answer, Probabilities
from radard.judge.decision import HIGH_PET_LIMIT, LONGER, MIN_P, SHORTER, Verdict, judge
from radard.judge.evidence import Evidence
from radard.judge.features import FeatureSettings
from radard.judge.installation import size_nats
from x2train.sets.windows import dwell_ends


def window(human, pet, other):
    return Probabilities(human, pet, other)


def array(p):
    return np.array([p.human, p.pet, p.other])


def fused(windows, **settings):
    evidence = Evidence(EvidenceSettings(**settings))
    return [array(evidence.add(w)) for w in windows]


@st.composite
def windows_of_three(draw):
    """Windows of any calibrated probabilities, the extreme ones included."""
    part = st.one_of(st.sampled_from([0.0, 1e-300, 1e-9, 1.0]), st.floats(1e-3, 1.0))
    rows = draw(st.lists(st.tuples(part, part, part), min_size=1, max_size=30))
    whole = [row if sum(row) > 0 else (1.0, 0.0, 0.0) for row in rows]
    return [window(*(v / sum(row) for v in row)) for row in whole]


@given(windows_of_three())
def test_whatever_comes_the_sum_is_one_and_nothing_is_lost_for_good(windows):
    most = 5.0
    for p, w in zip(fused(windows, most=most), windows, strict=True):
        assert np.isfinite(p).all()
        assert abs(math.fsum(p) - 1) < 1e-12
        known = p if w.other > 0 else p[:2]
        assert known.min() > 0
        # No class further behind the leading one; the leading one may be a hidden third.
        assert np.log(known.max() / known.min()) <= most + 1e-9


@given(windows_of_three())
def test_a_reset_forgets_everything(windows):
    evidence = Evidence(EvidenceSettings())
    for w in windows:
        evidence.add(w)
    evidence.reset()
    again = [array(evidence.add(w)) for w in windows]
    np.testing.assert_array_equal(again, fused(windows))


@pytest.mark.parametrize("discount", [0.2, 0.6, 1.0])
def test_within_the_bounds_it_is_the_discounted_product_in_any_order(discount):
    rows = [(0.5, 0.3, 0.2), (0.3, 0.4, 0.3), (0.6, 0.3, 0.1), (0.4, 0.4, 0.2)]
    logs = discount * np.log(np.array(rows)).sum(axis=0) + [0.7, 0, 0]
    reference = np.exp(logs) / np.exp(logs).sum()
    for order in itertools.permutations(rows):
        made = fused([window(*row) for row in order], discount=discount, prior_human=0.7)[-1]
        np.testing.assert_allclose(made, reference, rtol=1e-12)


def test_a_pet_of_minutes_is_outvoted_by_a_person_as_fast_as_one_of_seconds():
    pet, person = window(0.02, 0.97, 0.01), window(0.97, 0.02, 0.01)
    after = [fused([pet] * n + [person] * 6)[n:] for n in (4, 600)]
    np.testing.assert_allclose(after[0], after[1], rtol=1e-12)
    assert after[1][-1][0] > 0.8


@pytest.mark.parametrize("p", [0.0, 1e-300, 5e-324, 1e-6])
def test_a_window_that_is_sure_weighs_no_more_than_one_in_a_million(p):
    assert fused([window(1.0, p, p)], most=50.0)[-1][0] == pytest.approx(
        fused([window(1.0, 1e-6, 1e-6)], most=50.0)[-1][0] if p else 1 / (1 + 1e-6**0.6), rel=1e-9
    )


def test_networks_of_two_classes_keep_other_at_zero():
    for p in fused([window(0.4, 0.6, 0.0), window(0.0, 1.0, 0.0), window(1.0, 0.0, 0.0)] * 5):
        assert p[2] == 0.0
        assert abs(p[0] + p[1] - 1) < 1e-12


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        ({"speed": 1}, "evidence.speed: unknown key"),
        ({"discount": 0}, "evidence.discount: .*greater than or equal to 0.001 .got 0"),
        ({"most": float("nan")}, "evidence.most"),
        ({"most": float("inf")}, "evidence.most"),
        ({"human_limit": True}, "evidence.human_limit: .*valid number .got True"),
        ({"human_limit": "0.8"}, "valid number"),
    ],
)
def test_settings_that_make_no_sense_are_named(raw, words):
    with pytest.raises(ModelMismatch, match=words):
        EvidenceSettings.from_mapping(raw)


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [
        ("discount", 0.001, 1.0),
        ("most", 1.4, 50.0),
        ("prior_human", -10.0, 10.0),
        ("human_limit", 0.2, 1.0),
        ("leaning", 0.5, 1.0),
        ("brief_s", 0.0, 3.0),
    ],
)
def test_the_bounds_of_settings_are_within_them(key, low, high):
    for value in (low, high):
        assert getattr(EvidenceSettings.from_mapping({key: value}), key) == value
    for value in (math.nextafter(low, -math.inf), math.nextafter(high, math.inf)):
        with pytest.raises(ModelMismatch, match=key):
            EvidenceSettings.from_mapping({key: value})


def test_settings_are_read_from_a_sidecar():
    assert EvidenceSettings.from_mapping({}) == EvidenceSettings()
    assert EvidenceSettings.from_mapping({"most": 8, "discount": 1}).most == 8
    # Models are in use whose sidecars say nothing of it: these numbers are theirs.
    s = EvidenceSettings()
    assert (s.discount, s.most, s.prior_human, s.human_limit) == (0.6, 5.0, 0.0, 0.8)


def over_time(within_s=3.0, **settings):
    return Verdict(0.8, EvidenceSettings(**settings), within_s)


@pytest.mark.parametrize(
    ("p", "within_s", "t_s", "expected"),
    [
        ((0.1, 0.9, 0.0), 3.0, [10], [("pet", False)]),
        ((0.1, 0.1, 0.8), 3.0, [10], [("other", False)]),
        ((0.5, 0.5, 0.0), 3.0, [10, 11, 12], [("pending", False)] * 3),
        ((0.5, 0.5, 0.0), 3.0, [10, 12.9, 13], [("pending", False)] * 2 + [("human", True)]),
        ((0.5, 0.5, 0.0), 3.0, [0, 2.93], [("pending", False), ("human", True)]),  # and rounding
        ((0.5, 0.5, 0.0), 0.0, [10], [("human", True)]),
        ((0.8, 0.2, 0.0), 3.0, [10], [("human", True)]),
        ((0.9, 0.1, 0.0), 3.0, [10], [("human", True)]),
        ((0.2, 0.8, 0.0), 3.0, [10, 20], [("pending", False), ("human", True)]),
    ],
)
def test_the_rule_over_time(p, within_s, t_s, expected):
    verdict = over_time(within_s)
    assert [verdict.judge(window(*p), t) for t in t_s] == expected


@pytest.mark.parametrize(
    ("p", "within_s", "waits_s"),
    [
        ((0.4, 0.6, 0.0), 3.0, 3.0),  # near even
        ((0.39, 0.61, 0.0), 3.0, 7.5),  # a pet, or a thing, is likelier by far
        ((0.3, 0.1, 0.6), 3.0, 7.5),
        ((0.25, 0.5, 0.25), 3.0, 7.5),
        ((0.1, 0.45, 0.45), 3.0, 3.0),  # resembles nothing
        ((0.6, 0.4, 0.0), 3.0, 3.0),
        ((0.61, 0.39, 0.0), 3.0, 2.0),  # a person is
        ((0.3, 0.7, 0.0), 0.0, 0.0),
    ],
)
def test_what_leans_to_a_pet_waits_longer_and_to_a_person_less(p, within_s, waits_s):
    verdict = over_time(within_s, human_limit=0.9, leaning=0.6)
    times = [10.0, 10 + waits_s - 0.1, 10 + waits_s]
    told = [verdict.judge(window(*p), t)[1] for t in times if t >= 10]
    assert told == ([False, False, True] if waits_s else [True, True])


@given(windows_of_three(), st.floats(0.0, 8.0))
def test_whoever_is_never_surely_harmless_alarms_in_time(windows, within_s):
    """Whatever the evidence does meanwhile: near even at once when its time is over."""
    verdict = over_time(within_s, human_limit=0.9, leaning=0.6)
    before = over_time(LONGER * within_s, human_limit=0.9)
    for t_s, p in enumerate(windows):
        (label, alarm), (_, late) = verdict.judge(p, t_s), before.judge(p, t_s)
        assert alarm == (label == "human")
        if judge(p, 0.8)[1] and t_s >= LONGER * within_s:
            assert alarm
        near_even = p.pet + p.other <= 0.6 or max(p.pet, p.other) < MIN_P
        if judge(p, 0.8)[1] and near_even and t_s >= within_s:
            assert alarm
        if p.human > 0.6 and t_s >= SHORTER * within_s:
            assert alarm
        # It is never later than if all of it waited as long.
        assert alarm or not late


def test_who_leaves_undecided_alarms_and_who_was_judged_does_not():
    verdict = over_time()
    assert not verdict.leave()
    verdict.judge(window(0.5, 0.5, 0.0), 5.0)
    assert verdict.leave()
    assert not verdict.leave()
    for last in (window(0.1, 0.9, 0.0), window(0.9, 0.1, 0.0)):
        verdict.judge(window(0.5, 0.5, 0.0), 8.0)
        verdict.judge(last, 9.0)
        assert not verdict.leave()


@pytest.mark.parametrize(
    ("p", "stays_s", "is_alarm"),
    [
        ((0.4, 0.6, 0.0), 1.0, False),
        ((0.1, 0.45, 0.45), 0.0, False),  # resembles nothing, but hardly shows
        ((0.5, 0.3, 0.2), 0.0, True),
        ((0.4, 0.6, 0.0), 1.93, True),  # whole frames: 2 s may last a little less
        ((0.4, 0.6, 0.0), 2.0, True),
    ],
)
def test_who_shows_but_briefly_alarms_only_if_likelier_a_person(p, stays_s, is_alarm):
    verdict = over_time(brief_s=2.0)
    for t_s in (0.0, stays_s):
        assert verdict.judge(window(*p), t_s) == ("pending", False)
    assert verdict.leave() == is_alarm
    assert (verdict.undecided_s is not None) == is_alarm
    assert not verdict.leave()
    # Nothing of it is left for the next who comes.
    for t_s in (30.0, 31.0, 32.0):
        verdict.judge(window(0.4, 0.6, 0.0), t_s)
    assert verdict.leave()


def test_who_asks_for_few_misses_has_nobody_passed_over():
    verdict = over_time(brief_s=2.0)
    for limit, is_alarm in ((0.8, False), (HIGH_PET_LIMIT, True), (0.8, False)):
        verdict.pet_limit = limit
        assert verdict.judge(window(0.4, 0.6, 0.0), 10.0) == ("pending", False)
        assert verdict.leave() == is_alarm


def test_it_knows_for_how_long_neither_side_has_been_reached():
    verdict, unsure, pet = over_time(), window(0.4, 0.6, 0.0), window(0.1, 0.9, 0.0)
    told = []
    for t_s, p in enumerate([pet, pet, unsure, unsure, unsure, pet, unsure]):
        verdict.judge(p, 10.0 + t_s)
        told.append(verdict.undecided_s)
    assert told == [None, None, 0, 1, 2, None, 0]
    assert verdict.judge(window(0.5, 0.5, 0.0), 17.0) == ("human", True)
    assert verdict.undecided_s is None
    assert not verdict.leave()
    assert verdict.undecided_s is None
    verdict.judge(unsure, 30.0)
    verdict.judge(unsure, 31.0)
    assert verdict.leave()
    assert verdict.undecided_s == 1.0


@pytest.mark.parametrize("forget", [Verdict.leave, Verdict.reset])
def test_the_wait_begins_anew_with_the_next_body(forget):
    verdict, unsure = over_time(), window(0.5, 0.5, 0.0)
    assert [verdict.judge(unsure, t)[0] for t in (0, 3)] == ["pending", "human"]
    forget(verdict)
    assert not verdict.leave()
    assert [verdict.judge(unsure, t)[0] for t in (4, 6, 7)] == ["pending", "pending", "human"]


@pytest.mark.parametrize(
    ("before", "p", "within_s", "limit", "told"),
    [
        ((0.1, 0.9, 0.0), (0.03, 0.49, 0.48), 0.5, 0.8, ("pet", False)),
        ((0.1, 0.1, 0.8), (0.03, 0.48, 0.49), 3.0, 0.8, ("other", False)),
        ((0.1, 0.9, 0.0), (0.041, 0.49, 0.469), 3.0, 0.8, ("human", True)),
        ((0.1, 0.9, 0.0), (0.25, 0.75, 0.0), 3.0, 0.8, ("human", True)),
        ((0.4, 0.6, 0.0), (0.03, 0.49, 0.48), 3.0, 0.8, ("human", True)),  # never known
        ((0.1, 0.9, 0.0), (0.03, 0.49, 0.48), 0.0, 0.8, ("human", True)),  # policy window
        ((0.01, 0.99, 0.0), (0.03, 0.49, 0.48), 3.0, 0.98, ("human", True)),
    ],
)
def test_what_is_known_stays_harmless_as_a_bit_of_both(before, p, within_s, limit, told):
    verdict = Verdict(limit, EvidenceSettings(), within_s)
    assert [verdict.judge(window(*each), t) for t, each in ((0, before), (9, p))][1] == told
    verdict.leave()
    assert verdict.judge(window(0.03, 0.49, 0.48), 10)[0] == ("pending" if within_s else "human")


@pytest.mark.parametrize("rate_hz", [14.5, 28.0, 30.5, 60.0, 117.3])
def test_the_wait_is_as_long_wherever_in_the_stream_it_begins(rate_hz):
    unsure = window(0.5, 0.5, 0.0)
    ends = list(dwell_ends(FeatureSettings().dwell_shape(1.0, rate_hz), 4000))
    for first in range(len(ends) - 5):
        verdict = over_time()
        times = [end / rate_hz for end in ends[first : first + 5]]
        assert [verdict.judge(unsure, t)[1] for t in times] == [False] * 3 + [True] * 2


def test_a_temporal_head_answers_instead_of_the_sum():
    evidence = Evidence(EvidenceSettings(prior_human=1.0))
    own = window(0.1, 0.8, 0.1)
    head = np.log([0.2, 0.5, 0.3])
    hidden = np.arange(4.0)
    made = evidence.fuse(Answer(own, head, hidden))
    odds = np.array([0.2 * math.e, 0.5, 0.3])
    assert array(made) == pytest.approx(odds / odds.sum())
    assert evidence.hidden is hidden
    evidence.reset()
    assert evidence.hidden is None
    # Without a head the windows' sum, of which the head's answer is no part.
    without = Evidence(EvidenceSettings(prior_human=1.0))
    assert evidence.fuse(Answer(own)) == without.add(own)
    assert evidence.hidden is None


def test_size_counts_by_the_strongest_echo_of_a_visit():
    evidence, plain = (Evidence(EvidenceSettings(prior_human=0.3)) for _ in range(2))
    answer = Answer(window(0.3, 0.6, 0.1), np.log([0.4, 0.5, 0.1]), np.arange(4.0))

    def gain(strength_db):
        ours, others = evidence.fuse(answer, strength_db), plain.fuse(answer)
        return math.log(ours.human / ours.pet) - math.log(others.human / others.pet)

    strengths = (None, -15.0, -6.0, -9.0, None, -30.0)
    expected = [0.0, *map(size_nats, (-15.0, -6.0, -6.0, -6.0, -6.0))]
    assert [gain(each) for each in strengths] == pytest.approx(expected)
    evidence.reset()
    assert gain(None) == pytest.approx(0.0)


@pytest.mark.parametrize(("hop_s", "apart"), [(0.25, 4), (0.3, 3), (0.5, 2), (1.0, 1), (2.0, 1)])
def test_a_memory_goes_on_from_the_window_about_a_second_before(hop_s, apart):
    evidence, given = Evidence(EvidenceSettings(), hop_s), []
    likely = np.log([0.5, 0.3, 0.2])
    for k in range(9):
        given.append(evidence.hidden)
        evidence.fuse(Answer(Probabilities(0.5, 0.3, 0.2), likely, np.full(2, k, np.float32)))
    assert given[:apart] == [None] * apart
    assert [int(each[0]) for each in given[apart:]] == list(range(9 - apart))
    evidence.reset()
    assert evidence.hidden is None


@pytest.mark.parametrize(
    ("hop_s", "own", "discount"),
    [(0.25, 0.4, 0.1), (1.0, 0.4, 0.4), (2.0, 0.4, 0.8), (1.0, 1.0, 1.0), (2.0, 0.6, 1.0)],
)
def test_a_second_counts_as_much_at_any_hop_and_no_window_for_more_than_itself(
    hop_s, own, discount
):
    window = Probabilities(0.6, 0.4, 0.0)
    found = Evidence(EvidenceSettings(discount=own), hop_s).add(window)
    share = 0.6**discount / (0.6**discount + 0.4**discount)
    assert found.human == pytest.approx(share, rel=1e-12)


def visit(evidence, p_human, t_s, range_m, windows=3):
    """The first fused odds of a person in nats, of windows that say the same each."""
    answer = Answer(window(p_human, 1 - p_human, 0.0), np.log([p_human, 1 - p_human, 1e-9]), None)
    made = [evidence.fuse(answer, t_s=t_s + k, range_m=range_m).human for k in range(windows)]
    evidence.end_visit()
    assert np.ptp(made) < 1e-12
    return math.log(made[0] / (1 - made[0]))


@pytest.mark.parametrize("p_human", [1e-9, 0.02, 0.3, 0.7, 0.999])
def test_what_begins_where_a_visit_ended_is_likely_the_same_body(p_human):
    settings = EvidenceSettings(prior_human=0.3)
    plain = visit(Evidence(settings), 0.5, 0.0, 2.0)

    def lean(gap_s, apart_m, *, again=1):
        evidence = Evidence(settings)
        for k in range(again):
            visit(evidence, p_human, 5.0 * k, 2.0)
        last_s = 5.0 * (again - 1) + 2.0
        return visit(evidence, 0.5, last_s + gap_s, 2.0 + apart_m) - plain

    prior = math.exp(0.3) / (2 + math.exp(0.3))
    odds = math.exp(visit(Evidence(settings), p_human, 0.0, 2.0))
    for gap_s in (1.0, 30.0, 300.0):
        same = 0.8 * math.exp(-gap_s / 60)
        mixed = same * odds / (1 + odds) + (1 - same) * prior
        expected = math.log(mixed / (1 - mixed)) - math.log(prior / (1 - prior))
        assert lean(gap_s, 0.5) == pytest.approx(expected, abs=1e-4)
        # A visit's own evidence is remembered, not what was remembered with it.
        assert lean(gap_s, -0.4, again=4) == pytest.approx(expected, abs=1e-4)
    assert lean(1.0, 0.6) == lean(1.0, math.nan) == 0.0
    assert lean(1e6, 0.0) == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 100), st.floats(0, 9)), max_size=9))
def test_no_past_takes_more_than_two_nats_from_a_person(visits):
    evidence, t_s = Evidence(EvidenceSettings(prior_human=0.25)), 0.0
    for p_human, gap_s, range_m in visits:
        t_s += gap_s
        visit(evidence, min(max(p_human, 1e-9), 1 - 1e-9), t_s, range_m)
        t_s += 3.0
    plain = visit(Evidence(EvidenceSettings(prior_human=0.25)), 0.5, 0.0, 2.0)
    assert visit(evidence, 0.5, t_s + 1.0, 2.0) - plain > -2.05


def test_who_was_a_person_for_sure_is_remembered_as_one():
    evidence = Evidence(EvidenceSettings())
    sure = Answer(window(1.0, 0.0, 0.0), np.array([0.0, -80.0, -80.0]), None)
    assert evidence.fuse(sure, range_m=2.0).human == 1.0
    evidence.end_visit()
    assert visit(evidence, 0.5, 1.0, 2.0) > 1.0


def test_a_module_that_restarts_has_seen_nobody():
    evidence = Evidence(EvidenceSettings())
    plain = visit(Evidence(EvidenceSettings()), 0.5, 0.0, 2.0)
    visit(evidence, 0.01, 0.0, 2.0)
    evidence.reset()
    assert visit(evidence, 0.5, 5.0, 2.0) == plain
