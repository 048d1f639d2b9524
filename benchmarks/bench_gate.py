"""What the gate sees and what it imagines: weak people, and rooms in which nobody is.

`--weak N`: N people each walk, stroll, sneak or run into the view of an X2 in rooms of their own
after six seconds of nobody, at strengths of -2 to 14 dB over the noise of a bin (mean over the
three seconds after they come in). Printed is the share
for whom the gate opened within 1, 2 and 3 s of the first half second at the strength of the noise.

`--rooms H`: H hours of rooms of each kind: empty, drifting (three times the drift), rain on a
window, each in stretches of five minutes with a room of its own. Printed are openings a day,
with a 95 % interval (exact, Poisson), at the default and at rates that can be counted.

The gate before (mean power of 0.4 m and 2 s, 5 dB over its floor) judges the same dwells.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import chi2

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import DAY_S, Gate
from radard.stream.ring import Dwell, DwellShape
from x2train.sets.families import family
from x2train.sets.passages import Passage, play
from x2train.sets.sites import X2, X4M03, Radar, Site, draw_site
from x2train.sets.windows import dwell_ends

STYLES = ("walk", "stroll", "stealth", "run")
LEAD_S, SEEN_S = 6.0, 6.0
STRETCH_S = 300.0
STRENGTHS_DB = (-2, 2, 6, 10, 14)
RATES_PER_DAY = (0.01, 1000.0, 10000.0)
WITHIN_S = (1, 2, 3)


def dwells(passage: Passage) -> Iterator[Dwell]:
    """Yield a passage's dwells without their clutter, as the daemon's worker has them."""
    radar, remover = passage.site.radar, ClutterRemover()
    rate_hz = radar.frame_rate_hz
    shape = DwellShape.of(
        dwell_s=2.0, hop_s=1.0, frame_rate_hz=rate_hz, n_cpi=round(28 / 60 * rate_hz)
    )
    n = shape.n_slow
    for end in dwell_ends(shape, len(passage.frames)):
        frames = passage.frames[end - n : end]
        dwell = Dwell(
            frames, np.ones(n, np.bool_), radar.axis(), rate_hz, end / rate_hz, end_frame=end
        )
        yield remover.remove(dwell)


def opened_before(gate: Gate) -> bool:
    """Return what the gate of before says of the dwell that `gate` has just judged."""
    n_bins = max(1, round(0.4 / gate.bin_length_m))
    over = 10**0.5
    means = [
        sliding_window_view(row, n_bins).mean(axis=-1)
        for row in (
            gate.power,
            np.minimum(gate.power, over * gate.background) + (over - 1) * gate.floor,
        )
    ]
    return bool((means[0] > means[1]).any())


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


def weak(n: int, radar: Radar) -> dict[str, dict[str, list[float]]]:
    """Return for every strength the shares that opened the gates within 1, 2 and 3 s."""
    found: dict[str, dict[str, list[float]]] = {}
    for strength_db in STRENGTHS_DB:
        waits: dict[str, list[float]] = {"before": [], "now": []}
        for number in range(n):
            came = coming(number, strength_db, radar)
            if came is None:
                continue
            passage, since_s = came
            gate, first = Gate(GateSettings()), {"before": np.inf, "now": np.inf}
            for dwell in dwells(passage):
                is_open = gate.read(dwell).is_open
                for name, opens in (("now", is_open), ("before", opened_before(gate))):
                    if opens and dwell.t_s > LEAD_S:
                        first[name] = min(first[name], dwell.t_s - since_s)
            for name, wait_s in first.items():
                waits[name].append(wait_s)
        found[f"{strength_db} dB"] = {
            name: [len(each), *(round(float(np.mean(np.array(each) <= s)), 3) for s in WITHIN_S)]
            for name, each in waits.items()
        }
    return found


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
        names = ["before", *(f"{rate:g} a day" for rate in RATES_PER_DAY)]
        openings, heard_s = dict.fromkeys(names, 0), 0.0
        for number in range(n_stretches):
            rng = np.random.default_rng([78, number])
            cast = (family("rain"),) if kind == "rain" else ()
            passage = play(rng, room_of(rng, kind, radar), cast, duration_s=STRETCH_S)
            gates = [Gate(GateSettings(false_alarms_per_day=rate)) for rate in RATES_PER_DAY]
            was_open = dict.fromkeys(names, False)
            heard_s += STRETCH_S
            for dwell in dwells(passage):
                now = [gate.read(dwell).is_open for gate in gates]
                for name, is_open in zip(names, [opened_before(gates[0]), *now], strict=True):
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
    parser.add_argument("--weak", type=int, default=100, metavar="N", help="people a strength")
    parser.add_argument("--rooms", type=float, default=2.0, metavar="H", help="hours a kind")
    parser.add_argument("--radar", choices=("x2", "x4m03"), default="x2")
    parser.add_argument("--rate", type=float, default=60.0, help="frames a second")
    args = parser.parse_args()
    radar = replace({"x2": X2, "x4m03": X4M03}[args.radar], frame_rate_hz=args.rate)
    print(
        json.dumps({"weak": weak(args.weak, radar), "rooms": rooms(args.rooms, radar)}, indent=1)
    )


if __name__ == "__main__":
    main()
