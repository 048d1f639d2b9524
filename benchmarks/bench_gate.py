"""What the gate sees and what it imagines: weak people, and rooms in which nobody is.

`--weak N`: N people each walk, stroll, sneak or run into the view of an X2 in rooms of their own
after six seconds of nobody, at strengths of -2 to 14 dB over the noise of a bin (mean over the
three seconds after they come in). Printed is the share
for whom the gate opened within 1, 2 and 3 s of the first half second at the strength of the noise,
at every rate of `gate.false_alarms_per_day`, whose thresholds are printed too.

`--rooms H`: H hours of rooms of each kind: empty, drifting (three times the drift), rain on a
window, each in stretches of five minutes with a room of its own. Printed are openings a day,
with a 95 % interval (exact, Poisson), at the same rates.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import DAY_S, Gate
from radard.judge.features import FeatureSettings
from radard.stream.ring import Dwell
from x2train.sets.families import family
from x2train.sets.passages import Passage, play
from x2train.sets.sites import X2, X4M03, Radar, Site, draw_site
from x2train.sets.windows import dwell_ends

STYLES = ("walk", "stroll", "stealth", "run")
LEAD_S, SEEN_S = 6.0, 6.0
STRETCH_S = 300.0
STRENGTHS_DB = (-2, 2, 6, 10, 14)
RATES_PER_DAY = (0.01, 1.0, 1000.0, 10000.0)
WITHIN_S = (1, 2, 3)


def dwells(passage: Passage) -> Iterator[Dwell]:
    """Yield a passage's dwells without their clutter, as the daemon's worker has them."""
    radar, remover = passage.site.radar, ClutterRemover()
    rate_hz = radar.frame_rate_hz
    shape = FeatureSettings(n_cpi=0).at(rate_hz).dwell_shape(1.0, rate_hz)
    n = shape.n_slow
    for end in dwell_ends(shape, len(passage.frames)):
        frames = passage.frames[end - n : end]
        dwell = Dwell(
            frames, np.ones(n, np.bool_), radar.axis(), rate_hz, end / rate_hz, end_frame=end
        )
        yield remover.remove(dwell)


def coming(number: int, strength_db: float, radar: Radar) -> tuple[Passage, float] | None:
    """Return a person who comes in at a strength, and when; None if nobody comes to be seen."""

    def at(level_db: float) -> Passage:
        rng = np.random.default_rng([77, number])
        site = replace(draw_site(rng, radar), level_db=level_db)
        cast = (family(f"human {STYLES[number % len(STYLES)]}"),)
        return play(
            rng, site, cast, duration_s=LEAD_S + SEEN_S, lead_s=(LEAD_S, LEAD_S), is_plain=True
        )

    first = round(LEAD_S * radar.frame_rate_hz)
    seen = slice(first, first + round(3 * radar.frame_rate_hz))
    snr = 10 ** (at(0.0).truth.snr_db[:, 0] / 10)
    if not snr[seen].mean() > 0:
        return None
    passage = at(strength_db - 10 * float(np.log10(snr[seen].mean())))
    power = 10 ** (passage.truth.snr_db[:, 0] / 10)
    half = round(radar.frame_rate_hz / 2)
    mean = np.convolve(power, np.ones(half) / half)[: len(power)]
    reached = np.flatnonzero(mean >= 1)
    reached = reached[reached >= first]
    return (passage, float(reached[0]) / radar.frame_rate_hz) if len(reached) else None


def gates() -> dict[str, Gate]:
    """Return a gate for every rate."""
    return {
        f"{rate:g} a day": Gate(GateSettings(false_alarms_per_day=rate)) for rate in RATES_PER_DAY
    }


def weak(n: int, radar: Radar) -> dict[str, dict[str, list[float]]]:
    """Return for every strength the shares that opened the gates within 1, 2 and 3 s."""
    found: dict[str, dict[str, list[float]]] = {}
    for strength_db in STRENGTHS_DB:
        waits: dict[str, list[float]] = {}
        for number in range(n):
            came = coming(number, strength_db, radar)
            if came is None:
                continue
            passage, since_s = came
            judging = gates()
            first = dict.fromkeys(judging, np.inf)
            for dwell in dwells(passage):
                for name, gate in judging.items():
                    if gate.read(dwell).is_open and dwell.t_s > LEAD_S:
                        first[name] = min(first[name], dwell.t_s - since_s)
            for name, wait_s in first.items():
                waits.setdefault(name, []).append(wait_s)
        found[f"{strength_db} dB"] = {
            name: [len(each), *(round(float(np.mean(np.array(each) <= s)), 3) for s in WITHIN_S)]
            for name, each in waits.items()
        }
    return found


def thresholds(radar: Radar) -> dict[str, float]:
    """Return what every gate asks of a cell, in dB over the noise of an empty room."""
    rng = np.random.default_rng(0)
    room = play(rng, draw_site(rng, radar), (), duration_s=6.0)
    (first, *_) = dwells(room)
    read = {name: gate.read(first) for name, gate in gates().items()}
    return {name: round(r.threshold_db - r.noise_floor_db, 2) for name, r in read.items()}


def room_of(rng: np.random.Generator, kind: str, radar: Radar) -> Site:
    """Return a drawn site, made as its kind demands."""
    site = draw_site(rng, radar)
    if kind == "drifting" and site.room is not None:
        room = replace(site.room, drift_m=3 * site.room.drift_m, drift_gain=0.005)
        site = replace(site, room=room)
    return site


def rooms(hours: float, radar: Radar) -> dict[str, dict[str, str]]:
    """Return openings a day of every gate in every kind of room."""
    found: dict[str, dict[str, str]] = {}
    for kind in ("empty", "drifting", "rain"):
        n_stretches = max(1, round(hours * 3600 / STRETCH_S))
        openings, heard_s = dict.fromkeys(gates(), 0), 0.0
        for number in range(n_stretches):
            rng = np.random.default_rng([78, number])
            cast = (family("rain"),) if kind == "rain" else ()
            passage = play(rng, room_of(rng, kind, radar), cast, duration_s=STRETCH_S)
            judging = gates()
            was_open = dict.fromkeys(judging, False)
            heard_s += STRETCH_S
            for dwell in dwells(passage):
                for name, gate in judging.items():
                    is_open = gate.read(dwell).is_open
                    openings[name] += is_open and not was_open[name]
                    was_open[name] = is_open
        found[kind] = {name: per_day(n, heard_s) for name, n in openings.items()}
    return found


def per_day(n: int, heard_s: float) -> str:
    """Return a rate with its exact 95 % interval."""
    low = chi2.ppf(0.025, 2 * n) / 2 if n else 0.0
    high = chi2.ppf(0.975, 2 * n + 2) / 2
    value, low, high = (x * DAY_S / heard_s for x in (n, low, high))
    return f"{n} in {heard_s / 3600:.1f} h: {value:.3g} a day ({low:.3g} to {high:.3g})"


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--weak", type=int, default=100, metavar="N", help="people a strength")
    add("--rooms", type=float, default=2.0, metavar="H", help="hours a kind; 0: none")
    add("--radar", choices=("x2", "x4m03"), default="x2")
    add("--rate", type=float, default=60.0, help="frames a second")
    args = parser.parse_args()
    radar = replace({"x2": X2, "x4m03": X4M03}[args.radar], frame_rate_hz=args.rate)
    found = {
        "threshold over the noise, dB": thresholds(radar),
        "weak": weak(args.weak, radar),
        "rooms": rooms(args.rooms, radar) if args.rooms else {},
    }
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
