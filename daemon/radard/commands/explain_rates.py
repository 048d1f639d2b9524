"""Expected rates of `radard explain`, from a bundle's card: of passages, or of windows alone.

Of windows alone two cases bound what happens: every window is a draw of its own, or all windows
of one pass fare alike. Real windows overlap and lie in between.
"""

from collections.abc import Iterable, Iterator
from itertools import islice

from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.config.config import Config
from radard.config.sections import DecisionSection, GateSection
from radard.judge.bundle import Bundle
from radard.judge.card import Card, Three

_SHARE = "share without alarm, "
_PEOPLE = ("human", "person", "people", "adult", "child", "walker")
_COLUMNS = (13, 24, 24, 24, 20)

_NUMBERS = ("confirm_k", "confirm_n", "p_on")


def passage_rates(config: Config, bundle: Bundle, card: Card) -> Iterator[str]:
    """Yield the rates of the bundle's own policy on whole passages."""
    yield f"by the card ({card.passages} simulated passages, in brackets 95 % intervals):"
    titles = ("people missed", "alarm after", "pets' visits", "alarms per")
    below = ("", "(half, 90 %)", "with an alarm", "pet-hour")
    yield "  " + _columns(("sensitivity", *titles))
    yield "  " + _columns(("", *below))
    delay_s = config.alarm.entry_delay_s
    for level, made in card.sensitivities.items():
        mark = ">" if level == config.alarm.sensitivity else " "
        times = (made.half_alarmed_after_s, made.nine_in_ten_alarmed_after_s)
        cells = (
            percent(made.missed),
            ", ".join("never" if s is None else f"{s + delay_s:.1f} s" for s, _, _ in times),
            percent(made.visits_with_alarm),
            estimate(made.alarms_per_pet_hour),
        )
        yield f"{mark} " + _columns((level, *cells))
    yield ""
    for made in islice(card.sensitivities.values(), 1):
        visit_s = 3600 * made.pet_hours / max(made.pet_visits, 1)
        yield (
            f"{made.intrusions} people come in, {made.pet_visits} visits of pets of "
            f"{visit_s:.0f} s; none of them real"
        )
    if delay_s:
        yield f"times with the entry delay of {delay_s:g} s"
    given = _given(config, bundle, card)
    if given:
        yield f"{', '.join(given)} given: the rates then differ, and are not known"
    yield f"made by: {card.command}"


def _given(config: Config, bundle: Bundle, card: Card) -> list[str]:
    """Return the settings that differ from those that were evaluated."""
    names = [f"alarm.{n}" for n in _NUMBERS if getattr(config.alarm, n) is not None]
    limit = config.decision.pet_limit
    if limit is not None and limit != bundle.pet_limit:
        names.append("decision.pet_limit")
    usual, own = DecisionSection(), config.decision
    timing = ("decide_within_s", "hop_s")
    names += [f"decision.{n}" for n in timing if getattr(own, n) != getattr(usual, n)]
    rate = GateSection().false_alarms_per_day
    if config.gate.false_alarms_per_day != card.gate.get("false_alarms_per_day", rate):
        names.append("gate.false_alarms_per_day")
    return names


def _columns(cells: Iterable[str]) -> str:
    return "".join(f"{c:<{w}}" for c, w in zip(cells, _COLUMNS, strict=True)).rstrip()


def percent(three: Three) -> str:
    """Return a share and its interval."""
    return estimate(three, 100, " %")


def estimate(three: Three, times: float = 1, unit: str = "") -> str:
    """Return a figure and its interval; what is not known is a question mark."""
    value, low, high = ("?" if v is None else f"{times * v:.2g}" for v in three)
    return f"{value}{unit} ({low} to {high})"


def window_rates(config: Config, card: Card, decides: str, n_windows: int) -> Iterator[str]:
    """Yield what the rates of single windows bound, for so many windows in sight."""
    quiet = {
        name.removeprefix(_SHARE): value
        for name, value in card.metrics.items()
        if name.startswith(_SHARE) and isinstance(value, int | float) and 0 <= value <= 1
    }
    if not quiet:
        yield f"the card has no line '{_SHARE}...': miss and false-alarm rates are unknown"
        return
    hop_s = config.decision.hop_s
    pass_s = n_windows * hop_s
    yield f"by the card (single windows of simulated bodies), for {pass_s:g} s in sight;"
    yield "first figure: every window a draw of its own, second: all windows fare alike"
    yield ""
    titles = [f"{who} {'missed' if _is_person(who) else 'false alarm'}" for who in quiet]
    yield _row(" ", "sensitivity", "k of n", titles)
    for level in SENSITIVITIES[decides]:
        chosen = level == config.alarm.sensitivity
        # Another level has the numbers of its name alone.
        own = {} if chosen else dict.fromkeys(("confirm_k", "confirm_n", "p_on", "p_off"))
        section = config.alarm.model_copy(update={"sensitivity": level, **own})
        policy = alarm_policy(section, decides)
        cells = [
            _rate(1 - share, policy.k, policy.n, n_windows, is_person=_is_person(name))
            for name, share in quiet.items()
        ]
        mark = ">" if chosen else " "
        yield _row(mark, level, f"{policy.k} of {policy.n}", cells)
    yield ""
    yield "p_on is left out: the card's rates are those of the verdict alone"
    if decides == "fused":
        yield "policy fused weighs windows together and waits while undecided: slower than this,"
        yield "and surer than one window; the card lacks its rates: train-export evaluate --card"


def _row(mark: str, level: str, of: str, cells: Iterable[str]) -> str:
    return f"{mark} {level:<13}{of:<8}{''.join(f'{cell:<24}' for cell in cells)}".rstrip()


def _rate(p_alarm: float, k: int, n: int, n_windows: int, *, is_person: bool) -> str:
    apart = alarm_probability(p_alarm, k, n, n_windows)
    alike = p_alarm if n_windows >= k else 0.0
    if is_person:
        apart, alike = 1 - apart, 1 - alike
    return f"{100 * apart:.2g} %, {100 * alike:.2g} %"


def _is_person(name: str) -> bool:
    return any(word in name.lower() for word in _PEOPLE)


def alarm_probability(p_hit: float, k: int, n: int, n_windows: int) -> float:
    """Return the probability of an alarm, K of N hits, within `n_windows` independent windows."""
    keep = (1 << (n - 1)) - 1
    pending = {0: 1.0}
    done = 0.0
    for _ in range(n_windows):
        following: dict[int, float] = {}
        for history, p in pending.items():
            with_hit = history << 1 | 1
            if with_hit.bit_count() >= k:
                done += p * p_hit
            else:
                following[with_hit & keep] = following.get(with_hit & keep, 0.0) + p * p_hit
            without = history << 1 & keep
            following[without] = following.get(without, 0.0) + p * (1 - p_hit)
        pending = following
    return min(done, 1.0)
