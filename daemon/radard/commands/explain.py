"""`radard explain`: what the chosen sensitivity means for delay, missed people, false alarms."""

from collections.abc import Iterator, Sequence

from radard.alarm.sensitivity import alarm_policy
from radard.commands.explain_rates import passage_rates, percent, window_rates
from radard.config.config import Config, load_config
from radard.config.options import add_options, config_options, tell_taken
from radard.config.profiles import USUAL_HZ, Profile, front
from radard.config.sections import AUTO_MODEL, AlarmSection, DecisionSection
from radard.judge.bundle import Bundle, load_bundle
from radard.judge.card import read_card
from radard.judge.decision import MIN_P, pet_limit_of
from radard.judge.model_choice import OF_ONE_MODULE, hop_warning, model_for
from x2radar.command import Parser, new_parser
from x2radar.ports import parse_port

_EXAMPLES = """\
examples:
  radard explain                         the configuration that holds
  radard explain --sensitivity low
  radard explain --model mine.onnx --pass-time 8
"""


def in_use(config: Config) -> Profile | None:
    """Return the profile whose settings hold, with all else of a decision as usual; else None."""
    if config.alarm.sensitivity != "normal":
        return None
    port = config.sensor.port
    asked = parse_port(port).options.get("rate") if port else None
    for profile in front().profiles:
        settings = DecisionSection(hop_s=profile.hop_s, bodies=profile.bodies)
        is_same = config.decision == settings and model_for(profile.model) == model_for(
            config.model.name
        )
        if asked is None:
            is_timed = profile.rate_hz is None or config.model.profile == profile.name
        else:
            is_timed = float(asked) == (profile.rate_hz or USUAL_HZ)
        if is_same and is_timed:
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
    yield (
        f"profile {profile.name}: CPU {much} with an open gate, "
        f"{100 * profile.cpu_closed:.0f} % in an empty room;"
    )
    yield f"  people missed {percent(profile.missed)},"
    yield f"  pets' visits with an alarm {percent(profile.pets)},"
    yield f"  alarm after {profile.half_s:.1f} s (half), {profile.slow_s:.1f} s (90 %)"
    yield f"  of {basis(profile.passages)}"
    if front().bundles.get(bundle.name, bundle.judges_as) != bundle.judges_as:
        yield f"  (measured with an earlier '{bundle.name}')"


def basis(n: int) -> str:
    """Return on what errors were measured."""
    return f"{n} simulated people and {n} visits of pets before an X2"


def run(argv: Sequence[str]) -> int:
    parser = make_parser()
    args = parser.parse_args(argv)
    if not 1 <= args.pass_time <= 120:
        parser.error(f"--pass-time {args.pass_time:g}: must be 1 to 120 s")
    config = tell_taken(load_config(args.config, options=config_options(args)))
    if args.sensor or not config.sensors:
        config = config.of_sensor(args.sensor)
    print("\n".join(explained(config, pass_s=args.pass_time)))
    return 0


def make_parser() -> Parser:
    parser = new_parser(
        "radard explain",
        "Say what becomes of verdicts, and how often that is wrong, by the model's card.",
        _EXAMPLES,
    )
    add_options(parser)
    parser.add_argument("--sensor", metavar="NAME", help="one of the configuration's sensors")
    parser.add_argument(
        "--pass-time", type=float, default=5.0, metavar="S", help="how long a body is in sight (5)"
    )
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
    yield from _the_policy(config.alarm, decides)
    yield ""
    card = read_card(name)
    if card.policy == decides:
        yield from passage_rates(config, bundle, card)
    else:
        yield from window_rates(config, card, decides, max(1, round(pass_s / hop_s)))


def _the_policy(section: AlarmSection, decides: str) -> Iterator[str]:
    policy = alarm_policy(section, decides)
    yield f"sensitivity {section.sensitivity}: {policy.k} of {policy.n} verdicts make an alarm"
    if policy.p_on > 0:
        yield f"  a verdict counts from p(human) {policy.p_on:g} on"
    yield f"  somebody is still there above p(human) {policy.p_off:g}"
    yield f"  entry delay {policy.entry_delay_s:g} s; disarm within it and nothing happens"
    yield f"  the alarm lasts until acknowledged, or {policy.latch_s:g} s after they are gone"
    yield f"  no new one for {policy.refractory_s:g} s after that"
