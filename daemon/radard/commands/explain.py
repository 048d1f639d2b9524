"""`radard explain`: what the chosen sensitivity means for delay, missed people, false alarms."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

from radard.alarm.sensitivity import SENSITIVITIES, alarm_policy
from radard.config.config import Config, load_config
from radard.config.options import add_options, check_limits, config_options, tell_taken
from radard.config.profiles import USUAL_HZ, Profile, front
from radard.config.sections import AUTO_MODEL, DecisionSection, GateSection
from radard.judge.bundle import Bundle, Card, Three, load_bundle, read_card
from radard.judge.decision import MIN_P, pet_limit_of
from radard.judge.model_choice import OF_ONE_MODULE, hop_warning, model_for
from x2radar.command import Parser, new_parser
from x2radar.ports import parse_port

_ABOUT = "Say what becomes of verdicts, and how often that is wrong, by the model's card."
_EXAMPLES = """\
examples:
  radard explain                         the configuration that holds
  radard explain --sensitivity low
  radard explain --model mine.onnx --pass-time 8
"""
BASIS = "{0} simulated people and {0} visits of pets before an X2"  # of errors
_SHARE = "share without alarm, "
_PEOPLE = ("human", "person", "people", "adult", "child", "walker")


def in_use(config: Config) -> Profile | None:
    """Return the profile whose settings hold, with all else of a decision as usual; else None."""
    if config.alarm.sensitivity != "normal":
        return None
    port = config.sensor.port
    rate_hz = parse_port(port).options.get("rate") if port else None
    bundle = model_for(config.model.name)
    for profile in front().profiles:
        settings = DecisionSection(hop_s=profile.hop_s, bodies=profile.bodies)
        if rate_hz is None:
            is_timed = profile.rate_hz is None or config.model.profile == profile.name
        else:
            is_timed = float(rate_hz) == (profile.rate_hz or USUAL_HZ)
        if is_timed and config.decision == settings and model_for(profile.model) == bundle:
            return profile
    return None


def profile_lines(config: Config, bundle: Bundle) -> Iterator[str]:
    """Yield what the profile in use costs."""
    profile = in_use(config)
    if profile is None:
        yield "no profile: what these settings cost was not measured together; see radard bench"
        return
    dearest, much = front().profiles[-1], "as much as any profile takes"
    if profile != dearest:
        much = f"{100 * profile.cpu_open:.0f} % of what '{dearest.name}' takes"
    closed = f"{100 * profile.cpu_closed:.0f} % in an empty room"
    yield f"profile {profile.name}: CPU {much} with an open gate, {closed};"
    yield f"  people missed {estimate(profile.missed)},"
    yield f"  pets' visits with an alarm {estimate(profile.pets)},"
    yield f"  alarm after {profile.half_s:.1f} s (half), {profile.slow_s:.1f} s (90 %)"
    yield f"  of {BASIS.format(profile.passages)}"
    if front().bundles.get(bundle.name, bundle.judges_as) != bundle.judges_as:
        yield f"  (measured with an earlier '{bundle.name}')"


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, pass_time=(1, 120))
    config = tell_taken(load_config(args.config, options=config_options(args)))
    if args.sensor or not config.sensors:
        config = config.of_sensor(args.sensor)
    print("\n".join(explained(config, pass_s=args.pass_time)))
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard explain", _ABOUT, _EXAMPLES)
    add_options(parser)
    parser.add_argument("--sensor", metavar="NAME", help="one of the configuration's sensors")
    text = "how long a body is in sight (5)"
    parser.add_argument("--pass-time", type=float, default=5.0, metavar="S", help=text)
    return parser


def explained(config: Config, *, pass_s: float) -> Iterator[str]:
    """Yield the lines of `radard explain`: rule, numbers, and what sensitivities cost."""
    if config.model.name == "none":
        yield "model none: the gate alone; there are no verdicts and no alarms"
        return
    name = model_for(config.model.name)
    bundle = load_bundle(name)
    decides = config.decision.policy or bundle.policy
    limit = pet_limit_of(config, bundle)
    if config.model.name == AUTO_MODEL:
        others = ", ".join(OF_ONE_MODULE)
        yield f"model auto: {bundle.name}, or where it does not take the stream: {others}"
    yield f"model {bundle.name}, policy {decides}: alarm unless p(pet) + p(other) > {limit:g}"
    yield f"and one of the two is at least {MIN_P:g},"
    hop_s = config.decision.hop_s
    if decides == "window":
        columns_s = bundle.features.dwell_s
        yield f"judged every {hop_s:g} s on one window alone: {columns_s:g} s of columns"
    else:
        yield f"judged every {hop_s:g} s on the evidence of all windows since motion began"
        if config.mount.level_db is not None:
            yield "and on the visit's greatest strength over an adult's (mount.level_db)"
    if warning := hop_warning(bundle, hop_s):
        yield warning
    yield from profile_lines(config, bundle)
    yield ""
    level, policy = config.alarm.sensitivity, alarm_policy(config.alarm, decides)
    yield f"sensitivity {level}: {policy.k} of {policy.n} verdicts make an alarm"
    if policy.p_on > 0:
        yield f"  a verdict counts from p(human) {policy.p_on:g} on"
    yield f"  somebody is still there above p(human) {policy.p_off:g}"
    yield f"  entry delay {policy.entry_delay_s:g} s; disarm within it and nothing happens"
    yield f"  the alarm lasts until acknowledged, or {policy.latch_s:g} s after they are gone"
    yield f"  no new one for {policy.refractory_s:g} s after that"
    yield ""
    card = read_card(name)
    if card.policy == decides:
        yield from _passage_rates(config, bundle, card)
    else:
        yield from _window_rates(config, card, decides, max(1, round(pass_s / hop_s)))


def _passage_rates(config: Config, bundle: Bundle, card: Card) -> Iterator[str]:
    """Yield the rates of the bundle's own policy on whole passages."""
    yield f"by the card ({card.passages} simulated passages, in brackets 95 % intervals):"
    row = "{:<2}{:<13}{:<24}{:<24}{:<24}{}".format
    yield row("", "sensitivity", "people missed", "alarm after", "pets' visits", "alarms per")
    yield row("", "", "", "(half, 90 %)", "with an alarm", "pet-hour")
    delay_s = config.alarm.entry_delay_s
    for level, made in card.sensitivities.items():
        mark = ">" if level == config.alarm.sensitivity else ""
        times = (made.half_alarmed_after_s, made.nine_in_ten_alarmed_after_s)
        after = ", ".join("never" if s is None else f"{s + delay_s:.1f} s" for s, _, _ in times)
        pets, alarms = estimate(made.visits_with_alarm), estimate(made.alarms_per_pet_hour, 1, "")
        yield row(mark, level, estimate(made.missed), after, pets, alarms)
    yield ""
    if of := next(iter(card.sensitivities.values()), None):
        visit_s = 3600 * of.pet_hours / max(of.pet_visits, 1)
        visits = f"{of.pet_visits} visits of pets of {visit_s:.0f} s"
        yield f"{of.intrusions} people come in, {visits}; none of them real"
    if delay_s:
        yield f"times with the entry delay of {delay_s:g} s"
    if given := _given(config, bundle, card):
        yield f"{', '.join(given)} given: the rates then differ, and are not known"
    yield f"made by: {card.command}"


def _given(config: Config, bundle: Bundle, card: Card) -> list[str]:
    """Return the settings that differ from those that were evaluated."""
    alarm, own, usual = config.alarm, config.decision, DecisionSection()
    rate = card.gate.get("false_alarms_per_day", GateSection().false_alarms_per_day)
    differs = {
        "alarm.confirm_k": alarm.confirm_k is not None,
        "alarm.confirm_n": alarm.confirm_n is not None,
        "alarm.p_on": alarm.p_on is not None,
        "decision.pet_limit": own.pet_limit not in {None, bundle.pet_limit},
        "decision.decide_within_s": own.decide_within_s != usual.decide_within_s,
        "decision.hop_s": own.hop_s != usual.hop_s,
        "gate.false_alarms_per_day": config.gate.false_alarms_per_day != rate,
    }
    return [name for name, is_other in differs.items() if is_other]


def estimate(three: Three, times: float = 100, unit: str = " %") -> str:
    """Return a share, or another figure, and its interval; a question mark is not known."""
    value, low, high = ("?" if v is None else f"{times * v:.2g}" for v in three)
    return f"{value}{unit} ({low} to {high})"


def _window_rates(config: Config, card: Card, decides: str, n_windows: int) -> Iterator[str]:
    """Yield what the rates of single windows bound, for so many windows in sight.

    Real windows overlap: they lie between draws of their own and windows that all fare alike.
    """
    quiet = {
        name.removeprefix(_SHARE): value
        for name, value in card.metrics.items()
        if name.startswith(_SHARE) and isinstance(value, int | float) and 0 <= value <= 1
    }
    if not quiet:
        yield f"the card has no line '{_SHARE}...': miss and false-alarm rates are unknown"
        return
    pass_s = n_windows * config.decision.hop_s
    yield f"by the card (single windows of simulated bodies), for {pass_s:g} s in sight;"
    yield "first figure: every window a draw of its own, second: all windows fare alike"
    yield ""
    people = {who for who in quiet if any(word in who.lower() for word in _PEOPLE)}
    row = ("{:<2}{:<13}{:<8}" + "{:<24}" * len(quiet)).format
    titles = (f"{who} {'missed' if who in people else 'false alarm'}" for who in quiet)
    yield row("", "sensitivity", "k of n", *titles).rstrip()
    for level in SENSITIVITIES[decides]:
        chosen = level == config.alarm.sensitivity
        # Another level has the numbers of its name alone.
        own = {} if chosen else dict.fromkeys(("confirm_k", "confirm_n", "p_on", "p_off"))
        section = config.alarm.model_copy(update={"sensitivity": level, **own})
        policy = alarm_policy(section, decides)
        rates = []
        for who, share in quiet.items():
            apart = alarm_probability(1 - share, policy.k, policy.n, n_windows)
            alike = 1 - share if n_windows >= policy.k else 0.0
            told = (1 - p if who in people else p for p in (apart, alike))
            rates.append(", ".join(f"{100 * p:.2g} %" for p in told))
        yield row(">" if chosen else "", level, f"{policy.k} of {policy.n}", *rates).rstrip()
    yield ""
    yield "p_on is left out: the card's rates are those of the verdict alone"
    if decides == "fused":
        yield "policy fused weighs windows together and waits while undecided: slower than this,"
        yield "and surer than one window; the card lacks its rates: train-export evaluate --card"


def alarm_probability(p_hit: float, k: int, n: int, n_windows: int) -> float:
    """Return the probability of an alarm, K of N hits, within `n_windows` independent windows."""
    keep = (1 << (n - 1)) - 1
    pending = {0: 1.0}
    done = 0.0
    for _ in range(n_windows):
        following: defaultdict[int, float] = defaultdict(float)
        for history, p in pending.items():
            with_hit = history << 1 | 1
            if with_hit.bit_count() >= k:
                done += p * p_hit
            else:
                following[with_hit & keep] += p * p_hit
            following[history << 1 & keep] += p * (1 - p_hit)
        pending = following
    return min(done, 1.0)
