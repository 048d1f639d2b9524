"""The front of speed against accuracy that `--profile` chooses from: `docs/tradeoff.md`.

Every candidate is a bundle with a hop, a frame rate and what is made of several bodies. Its
errors are those of `levers.py`'s people and pets, and of folders of recorded motion; its CPU time
is that of a pipeline behind a radar's frames, as a share of the usual settings' in the same run.
Of the candidates of a name the best is taken, and none that is dearer and no better than a cheaper
one. The settings of `levers.py` are measured on the same passages, and go into the same page.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import get_args

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import levers
from levers import USUAL, Figures, measure
from profiles_measure import BEST, Candidate, Recorded, candidates, cpu_shares, judge_recorded
from radard.config.json_file import parse_json
from radard.config.profiles import Bodies, Front, Profile, Three
from radard.judge.bundle import load_bundle
from study import (
    RESULTS,
    Marks,
    check_picture,
    check_within,
    one_thread,
    processor,
    publish,
    run_script,
    save,
    say,
    script_parser,
)
from x2train.commands import counted
from x2train.judge.estimates import Estimate

MARKS: Marks = ("<!-- profiles -->", "<!-- end of profiles -->")
FILE = Path(__file__).parents[1] / "daemon" / "radard" / "profiles.json"
_BANDS = (("eco", 0.25), ("fast", 0.45), ("balanced", 0.7), ("accurate", 1.0))
"""Names, and the share of the usual CPU time that each may take at most."""
_SHORT = "--passages 1 --rounds 1 --duration 5 --file build/profiles.json"
_BODIES: tuple[Bodies, ...] = get_args(Bodies)
_MISS = 10.0  # a person missed counts as so many visits of pets with an alarm


def main(argv: Sequence[str] | None = None) -> int:
    """Measure every candidate and setting; print them and the profiles."""
    parser = script_parser(
        "profiles",
        "Measure bundles with settings; choose the profiles among them.",
        "--passages 100\n"
        "--cpu-only --page docs/tradeoff.md --plot docs/images/profiles.png\n"
        "--passages 2 --rounds 1 --duration 6 --file build/profiles.json",
    )
    add = parser.add_argument
    add("--passages", type=int, default=100, help="people, and as many visits of pets (100)")
    add("--rounds", type=int, default=9, help="how often CPU time is measured (9)")
    add("--duration", type=float, default=20.0, metavar="S", help="seconds of stream (20)")
    add("--cpu-only", action="store_true", help="keep --file's errors on simulated passages")
    add("--errors-only", action="store_true", help="keep --file's CPU time; no settings' table")
    add(
        "--recorded",
        nargs="+",
        type=Path,
        default=[],
        metavar="DIR",
        help="folders of recorded motion with a truth.json (docs/evaluation.md#recorded-motion)",
    )
    add("--file", type=Path, default=FILE, metavar="FILE", help="JSON of all that was measured")
    add("--page", type=Path, metavar="FILE", help="a page whose tables are replaced")
    add("--plot", type=Path, metavar="FILE", help="PNG of errors over CPU time")
    add("--levers-plot", type=Path, metavar="FILE", help="PNG of the settings' errors")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(args, passages=(1, 1e6), rounds=(1, 100), duration=(5, 600))
    check_picture(args.plot)
    check_picture(args.levers_plot)
    rows: list[Figures] = []
    if args.errors_only:
        made, about = _judged_again(args)
    else:
        made, about = _timed_again(args) if args.cpu_only else _everything(args, rows)
        load = f"load {os.getloadavg()[0]:.1f} of {os.cpu_count()}"
        about = replace(about, timed_on=f"{processor()}, {load}")
    measured = sorted(choose(made), key=lambda p: (_candidate(p) == BEST, p.cpu_open))
    told = replace(about, measured=tuple(measured), untimed=())
    page, lines = list(table(told)), list(levers.table(rows, args.passages)) if rows else []
    say("\n".join([*page, *lines]))
    args.file.parent.mkdir(parents=True, exist_ok=True)
    args.file.write_text(json.dumps(asdict(told), indent=1) + "\n", "utf-8")
    if args.page:
        publish(args.page, MARKS, page, told.command, _SHORT)
        if lines:
            publish(args.page, RESULTS, lines, told.command, _SHORT)
    if args.plot:
        save(drawn(told.measured), args.plot, 110)
    if args.levers_plot and rows:
        save(levers.drawn(rows), args.levers_plot, 110)


def _timed_again(args: argparse.Namespace) -> tuple[list[Profile], Front]:
    """Measure CPU time, and errors on recorded motion, of all whose other errors are known."""
    before = parse_json(Front, args.file.read_bytes())
    known = {_candidate(p).case: p for p in (*before.untimed, *before.measured)}
    tried = tuple(each for each in candidates() if each.case in known)
    with counted("timing") as tell:
        shares = cpu_shares(tried, args.duration, args.rounds, tell)
    # What is made of several bodies changes no verdict.
    made = [_timed(replace(known[c.case], bodies=c.bodies), shares[c]) for c in tried]
    if args.recorded:
        with counted("recorded motion") as tell:
            recorded = judge_recorded(tuple(known), args.recorded, tell)
        made = [replace(p, recorded=recorded[_candidate(p).case]) for p in made]
    return made, before


def _judged_again(args: argparse.Namespace) -> tuple[list[Profile], Front]:
    """Measure the errors of all whose CPU time is known."""
    before = parse_json(Front, args.file.read_bytes())
    timed = {_candidate(p): p for p in before.measured}
    tried = tuple(each for each in candidates() if each in timed)
    found, recorded, _ = _errors(args, tried, ())
    made = [
        replace(
            _profile(c, found[c.case], recorded.get(c.case), args.passages),
            cpu_open=timed[c].cpu_open,
            cpu_one=timed[c].cpu_one,
            cpu_closed=timed[c].cpu_closed,
        )
        for c in tried
    ]
    return made, replace(before, command=_command(args), bundles=_bundles(tried))


def _everything(args: argparse.Namespace, rows: list[Figures]) -> tuple[list[Profile], Front]:
    """Measure everything; put the settings' figures into `rows`."""
    tried = candidates()
    with counted("timing") as tell:
        shares = cpu_shares(tried, args.duration, args.rounds, tell)
    found, recorded, others = _errors(args, tried, levers.cases(levers.MODELS))
    rows += others
    made = [
        _timed(_profile(c, found[c.case], recorded.get(c.case), args.passages), shares[c])
        for c in tried
    ]
    return made, Front(command=_command(args), timed_on="", bundles=_bundles(tried), measured=())


def _errors(
    args: argparse.Namespace, tried: Sequence[Candidate], more: Sequence[levers.Case]
) -> tuple[dict[levers.Case, Figures], dict[levers.Case, Recorded], list[Figures]]:
    """Return the errors of candidates, simulated and recorded, and those of more settings."""
    own = tuple(dict.fromkeys(each.case for each in tried))
    with counted("passages") as tell:
        figures = measure((*own, *more), args.passages, tell)
    with counted("recorded motion") as tell:
        recorded = judge_recorded(own, args.recorded, tell)
    return {f.case: f for f in figures[: len(own)]}, recorded, list(figures[len(own) :])


def _command(args: argparse.Namespace) -> str:
    return f"python research/profiles.py --passages {args.passages}"


def _bundles(tried: Sequence[Candidate]) -> dict[str, str]:
    return {each.case.model: load_bundle(each.case.model).judges_as for each in tried}


def _candidate(p: Profile) -> Candidate:
    rate_hz = p.rate_hz or USUAL.radar.frame_rate_hz
    return Candidate(p.model, rate_hz, p.hop_s, p.bodies)


def _profile(each: Candidate, found: Figures, recorded: Recorded | None, n: int) -> Profile:
    return Profile(
        name="",
        model=each.model,
        hop_s=each.hop_s,
        bodies=each.bodies,
        rate_hz=None if each.rate_hz == USUAL.radar.frame_rate_hz else each.rate_hz,
        cpu_open=1.0,
        cpu_one=1.0,
        cpu_closed=1.0,
        passages=n,
        missed=_three(found.missed),
        pets=_three(found.pets),
        half_s=round(found.median_s, 2),
        slow_s=round(found.slow_s, 2),
        recorded=recorded,
    )


def _timed(p: Profile, cpu: dict[str, float]) -> Profile:
    shares = {f"cpu_{name}": round(share, 3) for name, share in cpu.items()}
    return replace(p, name="", **shares)


def _three(e: Estimate) -> Three:
    value, low, high = (round(x, 4) for x in e)
    return value, low, high


def choose(made: Sequence[Profile]) -> tuple[Profile, ...]:
    """Return all, the best of every band by its name.

    None of these is dearer and no better than another.
    """
    best: list[tuple[Profile, str]] = []
    for (name, most), least in zip(_BANDS, (0.0, *(m for _, m in _BANDS)), strict=False):
        within = [p for p in made if least < p.cpu_open <= most]
        if name == _BANDS[-1][0]:
            within = [made[-1]]
        if within:
            found = min(within, key=lambda p: (_price(p), p.cpu_open))
            best.append((found, name))
    named = tuple(replace(p, name=name) for p, name in best)
    left_out = set(dominated(named))
    names = {id(p): name for p, name in best if name not in left_out}
    return tuple(replace(p, name=names.get(id(p), "")) for p in made)


def _price(p: Profile) -> float:
    """Return what errors cost, of simulated and of recorded passages alike."""
    price = _MISS * p.missed[0] + p.pets[0]
    if p.recorded:
        n_alarmed, n_people, n_pets_alarmed, n_pets = p.recorded
        price += _MISS * (1 - n_alarmed / max(n_people, 1)) + n_pets_alarmed / max(n_pets, 1)
    return price


def dominated(profiles: tuple[Profile, ...]) -> Iterator[str]:
    """Yield the names of those that are dearer and no better in anything than another."""
    for a in profiles:
        if any(a.cpu_open > b.cpu_open and _is_no_better(a, b) for b in profiles):
            yield a.name


def _is_no_better(a: Profile, b: Profile) -> bool:
    ours, theirs = ((p.missed[0], p.pets[0], p.slow_s) for p in (a, b))
    knows_more = _BODIES.index(a.bodies) < _BODIES.index(b.bodies)
    return not knows_more and all(x >= y for x, y in zip(ours, theirs, strict=True))


def table(front: Front) -> Iterator[str]:
    """Yield the lines of the table: every candidate, the profiles in bold."""
    yield (
        "Of so many people, and as many visits of pets; intervals hold 95 %. *Recorded*: of so "
        "many recorded passages of people and of a dog these raise an alarm. CPU time on "
        f"{front.timed_on} cores."
    )
    yield ""
    heads = (
        *("profile", "bundle", "frames a second", "hop", "several bodies"),
        *("CPU, always open", "one body", "empty room"),
        *("of", "people missed, %", "pets' visits with an alarm, %", "alarm after, half / 90 %"),
        "recorded: people; dog",
    )
    yield f"| {' | '.join(heads)} |"
    yield "|" + len(heads) * "---|"
    for p in front.measured:
        name = f"**{p.name}**" if p.name else ""
        shares = " | ".join(
            f"{100 * v:.1f} ({100 * low:.1f} to {100 * high:.1f})"
            for v, low, high in (p.missed, p.pets)
        )
        cpu = " | ".join(f"{share:.2f}" for share in (p.cpu_open, p.cpu_one, p.cpu_closed))
        recorded = "{} of {}; {} of {}".format(*p.recorded) if p.recorded else ""
        yield (
            f"| {name} | {p.model} | {p.rate_hz or 60:g} | {p.hop_s:g} s | {p.bodies} | {cpu} | "
            f"{p.passages} | {shares} | {p.half_s:.1f} / {p.slow_s:.1f} s | {recorded} |"
        )


def drawn(made: Sequence[Profile]) -> Figure:
    """Draw both errors over CPU time: a point a candidate, profiles with their names.

    Filled are simulated passages, with their 95 % intervals; hollow is recorded motion.
    """
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    people, pets = figure.subplots(1, 2)
    for p in made:
        colour = "C1" if p.name else "0.7"
        for axis, three in ((people, p.missed), (pets, p.pets)):
            value, low, high = (100 * v for v in three)
            axis.plot([p.cpu_open] * 2, [low, high], color=colour, alpha=0.4, lw=3)
            axis.plot(p.cpu_open, value, "o", color=colour, zorder=3 if p.name else 2)
            if p.name:
                axis.annotate(
                    p.name, (p.cpu_open, high), (0, 4), textcoords="offset points", ha="center"
                )
        if p.recorded:
            n_alarmed, n_people, n_pets_alarmed, n_pets = p.recorded
            for axis, share in (
                (people, 1 - n_alarmed / max(n_people, 1)),
                (pets, n_pets_alarmed / max(n_pets, 1)),
            ):
                axis.plot(p.cpu_open, 100 * share, "o", mfc="none", color=colour, zorder=2)
    for axis, title in ((people, "people missed, %"), (pets, "pets' visits with an alarm, %")):
        axis.set(
            xlabel="CPU time of a second, share of `accurate`'s with an open gate",
            ylabel=title,
            xlim=(0, 1.08),
            ylim=(0, None),
        )
        axis.grid(alpha=0.3)
    kinds = [
        Line2D([], [], marker="o", ls="", color="C1", label="a profile"),
        Line2D([], [], marker="o", ls="", color="0.7", label="other settings"),
        Line2D([], [], marker="o", ls="", mfc="none", color="0.4", label="on recorded motion"),
    ]
    pets.legend(handles=kinds)
    return figure


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
