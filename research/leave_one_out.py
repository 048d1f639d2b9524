"""Networks trained without each law of motion or echo in turn, judged on it.

The figure is the window AUC of people against pets that go and are in view: a network that knows
its simulator by heart falls on the law that it has not seen. One passage in four is kept from all
trainings.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radard.config.atomic import write_atomically
from radard.errors import UsageError
from study import check_within, run_script, say, script_parser
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins.draw import SKINS
from x2train.commands import followed
from x2train.judge.estimates import Ranking
from x2train.nets.epoch import Epoch
from x2train.nets.map_fit import MapFitSettings, MapTrained, fit_maps, logits_of
from x2train.sets.window_set import Columns, load_windows

_KEPT, _A_ROUND = 4, 5  # one in so many rounds is judged on alone; labels come in rounds
_MIN_SHARE, _MIN_MPS = 0.7, 0.12  # of the window in view, and mean speed: who clearly walks
_LAWS: Mapping[str, tuple[str, ...]] = {"motion": MOTIONS, "skin": tuple(SKINS)}
Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Law:
    """A motion or a skin."""

    kind: str
    name: str

    def __str__(self) -> str:
        return f"{self.kind} {self.name}"

    def of(self, windows: Columns) -> Rows:
        """Return which windows of people and pets it made, shape (n,)."""
        is_this = windows[self.kind] == _LAWS[self.kind].index(self.name)
        return np.asarray(is_this & (windows["label"] < 2))


def main(argv: Sequence[str] | None = None) -> int:
    """Train without each law, and without none; print how each network does on each law."""
    parser = script_parser(
        "leave_one_out",
        "Train without each motion and skin in turn, judge on it.",
        "--sets sets/laws --epochs 8 --out left-out.json",
    )
    add = parser.add_argument
    add("--sets", type=Path, nargs="+", required=True, help="sets with several motions and skins")
    add("--epochs", type=int, default=8, help="passes over the windows (8)")
    add("--seed", type=int, default=0, help="same seed, same figures (0)")
    add("--out", type=Path, metavar="FILE", help="JSON; what it holds is not done again")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(args, epochs=(1, 1e6), seed=(0, 2**31))
    windows, _ = load_windows(*args.sets)
    laws = laws_of(windows)
    known: dict[str, dict[str, float | None]] = {}
    if args.out and args.out.exists():
        known = json.loads(args.out.read_text(encoding="utf-8"))
    for law in (None, *laws):
        name = str(law) if law else "nothing"
        if name not in known:
            net = followed(trained(windows, law, args.epochs, args.seed), args.epochs)
            known[name] = {str(k): auc_on(net, windows, k) for k in laws}
            if args.out:
                write_atomically(args.out, json.dumps(known, indent=1).encode())
        aucs = known[name].items()
        told = [f"{key} {'-' if auc is None else f'{auc:.3f}'}" for key, auc in aucs]
        say(f"without {name}: {', '.join(told)}")


def laws_of(windows: Columns) -> tuple[Law, ...]:
    """Return the laws that windows were made by; UsageError if there is one of each alone."""
    found = tuple(
        Law(kind, name)
        for kind, names in _LAWS.items()
        for k, name in enumerate(names)
        if (windows[kind] == k).any()
    )
    if len(found) <= len(_LAWS):
        msg = "the sets hold one motion and one skin: make one with --motion and --skin"
        raise UsageError(msg)
    return found


def trained(
    windows: Columns, left_out: Law | None, epochs: int, seed: int
) -> Iterator[Epoch | MapTrained]:
    """Train a network without a law; yields as `fit_maps`."""
    is_kept = _is_kept(windows)
    use = ~is_kept if left_out is None else ~is_kept & ~left_out.of(windows)
    settings = MapFitSettings(epochs=epochs, seed=seed)
    return fit_maps(_rows(windows, use), _rows(windows, is_kept), settings)


def auc_on(made: MapTrained, windows: Columns, law: Law) -> float | None:
    """Return the AUC of people against pets on the kept windows of a law, to four digits.

    None if there are not both of them.
    """
    clear = (windows["share"] > _MIN_SHARE) & (windows["speed_mps"] > _MIN_MPS)
    rows = _rows(windows, law.of(windows) & clear & _is_kept(windows))
    logits = logits_of(made.net, rows)
    others = np.logaddexp(logits[:, 1], logits[:, 2])
    auc = Ranking(logits[:, 0] - others, np.asarray(rows["label"] == 0)).auc()
    return None if np.isnan(auc) else round(auc, 4)


def _is_kept(windows: Columns) -> Rows:
    """Return which windows no training sees, of all labels evenly, shape (n,)."""
    return np.asarray(windows["passage"] // _A_ROUND % _KEPT == 0)


def _rows(windows: Columns, use: Rows) -> Columns:
    return {key: column[use] for key, column in windows.items()}


if __name__ == "__main__":
    sys.exit(main())
