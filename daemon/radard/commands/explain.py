"""`radard explain`: what the chosen sensitivity means for delay, missed people, false alarms."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from radard.classifier import Bundle, bundle_names, load_bundle
from radard.config import Config, load_config
from radard.config_sections import AlarmSection
from radard.confirmation import alarm_probability, windows_until
from radard.options import add_options, config_options
from radard.pipeline import HOP_S
from radard.sensitivity import SENSITIVITIES, alarm_policy
from x2radar.command import new_parser

_EXAMPLES = """\
examples:
  radard explain                         the configuration that holds
  radard explain --sensitivity low
  radard explain --model mine.onnx --pass-time 8
"""
_SHARE = "share without alarm, "
_PEOPLE = ("human", "person", "people", "adult", "child", "walker")


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
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
    args = parser.parse_args(argv)
    if not 1 <= args.pass_time <= 120:
        parser.error(f"--pass-time {args.pass_time:g}: must be 1 to 120 s")
    config = load_config(args.config, options=config_options(args))
    if args.sensor or not config.sensors:
        config = config.of_sensor(args.sensor)
    print("\n".join(explained(config, pass_s=args.pass_time)))
    return 0


def explained(config: Config, *, pass_s: float) -> Iterator[str]:
    """Yield the lines.

    Parameters
    ----------
    config : Config
        What holds.
    pass_s : float
        How long somebody is in sight when they pass, in seconds.

    Raises
    ------
    BundleError, ModelMismatch
        If the model cannot be had.
    """
    if config.model.name == "none":
        yield "model none: the gate alone; there are no verdicts and no alarms"
        return
    bundle = load_bundle(config.model.name)
    decides = config.decision.policy or bundle.policy
    limit = config.decision.pet_limit or bundle.pet_limit
    yield f"model {bundle.name}, policy {decides}: alarm unless p(pet) + p(other) > {limit:g},"
    if decides == "window":
        yield f"judged every {HOP_S:g} s on the last {bundle.features.dwell_s:g} s alone"
    else:
        yield f"judged every {HOP_S:g} s on the evidence of all windows since motion began"
    yield ""
    yield from _the_policy(config.alarm, decides)
    yield ""
    yield from _the_rates(config, bundle, decides, max(1, round(pass_s / HOP_S)))


def _the_policy(section: AlarmSection, decides: str) -> Iterator[str]:
    policy = alarm_policy(section, decides)
    yield f"sensitivity {section.sensitivity}: {policy.k} of {policy.n} verdicts make an alarm"
    if policy.p_on > 0:
        yield f"  a verdict counts from p(human) {policy.p_on:g} on"
    yield f"  somebody is still there above p(human) {policy.p_off:g}"
    yield f"  entry delay {policy.entry_delay_s:g} s; disarm within it and nothing happens"
    yield f"  the alarm lasts until acknowledged, or {policy.latch_s:g} s after they are gone"
    yield f"  no new one for {policy.refractory_s:g} s after that"


def _the_rates(config: Config, bundle: Bundle, decides: str, n_windows: int) -> Iterator[str]:
    metrics = _card(bundle.name, config.model.name)
    quiet = {
        name.removeprefix(_SHARE): value
        for name, value in metrics.items()
        if name.startswith(_SHARE) and isinstance(value, int | float) and 0 <= value <= 1
    }
    for name, value in metrics.items():
        if any(word in name for word in ("per crossing", "per hour", "per day", "per night")):
            yield f"the card says: {name} = {value}"
    if not quiet:
        yield f"the card has no line '{_SHARE}...': miss and false-alarm rates are unknown"
        return
    yield f"by the card (single windows of simulated bodies), for {n_windows} s in sight;"
    yield "first figure: every window a draw of its own, second: all windows fare alike"
    yield ""
    yield _row(" ", "sensitivity", "k of n", "alarm after (half, 95 %)", map(_title, quiet))
    for level in SENSITIVITIES[decides]:
        section = config.alarm.model_copy(update={"sensitivity": level})
        chosen = level == config.alarm.sensitivity
        policy = alarm_policy(section if chosen else _named(section), decides)
        people = [1 - share for name, share in quiet.items() if _is_person(name)]
        delay = _delay(min(people), policy.k, policy.n, policy.entry_delay_s) if people else "-"
        cells = [
            _rate(1 - share, policy.k, policy.n, n_windows, is_person=_is_person(name))
            for name, share in quiet.items()
        ]
        mark = ">" if chosen else " "
        yield _row(mark, level, f"{policy.k} of {policy.n}", delay, cells)
    yield ""
    yield f"add up to {HOP_S:g} s until the next decision; p_on is left out: the card's rates are"
    yield "those of the verdict alone"
    if decides == "fused":
        within = f"{config.decision.decide_within_s:g} s"
        yield f"policy fused weighs windows together and waits up to {within}: slower than this,"
        yield "and surer than one window; what it achieves: docs/evaluation.md"


def _row(mark: str, level: str, of: str, delay: str, cells: Iterable[str]) -> str:
    columns = "".join(f"{cell:<24}" for cell in cells)
    return f"{mark} {level:<13}{of:<8}{delay:<27}{columns}".rstrip()


def _named(section: AlarmSection) -> AlarmSection:
    """Return a section with the numbers of its name alone."""
    raw = dict.fromkeys(("confirm_k", "confirm_n", "p_on", "p_off"))
    return section.model_copy(update=raw)


def _rate(p_alarm: float, k: int, n: int, n_windows: int, *, is_person: bool) -> str:
    apart = alarm_probability(p_alarm, k, n, n_windows)
    alike = p_alarm if n_windows >= k else 0.0
    if is_person:
        apart, alike = 1 - apart, 1 - alike
    return f"{100 * apart:.2g} %, {100 * alike:.2g} %"


def _delay(p_hit: float, k: int, n: int, entry_s: float) -> str:
    half, most = (windows_until(share, p_hit, k, n) for share in (0.5, 0.95))
    return ", ".join(
        "over 2 min" if count is None else f"{count * HOP_S + entry_s:g} s"
        for count in (half, most)
    )


def _title(name: str) -> str:
    return f"{name} {'missed' if _is_person(name) else 'false alarm'}"


def _is_person(name: str) -> bool:
    return any(word in name.lower() for word in _PEOPLE)


def _card(name: str, asked: str) -> Mapping[str, Any]:
    """Return the measures of a bundle's sidecar, which stand in its card as well."""
    if asked in bundle_names():
        text = (resources.files("radard.models") / f"{name}.json").read_text(encoding="utf-8")
    else:
        text = Path(asked).with_suffix(".json").read_text(encoding="utf-8")
    metrics = json.loads(text).get("metrics", {})
    return metrics if isinstance(metrics, Mapping) else {}
