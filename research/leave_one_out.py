"""Networks trained without each law of motion or echo, or source of clips, judged on it.

The figure is the window AUC of people against pets that go and are in view: a network that knows
its simulator by heart falls on the law that it has not seen. A source of clips has people or pets
alone; they are judged against all others' pets or people. One passage in four is kept from all
trainings.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from study import check_within, run_script, say, script_parser
from x2radar.atomic import write_atomically
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins import SKINS
from x2train.commands import followed
from x2train.judge.estimates import Ranking
from x2train.nets.calibration import Epoch, Trained
from x2train.nets.map_fit import device_of, fit_maps, logits_of
from x2train.nets.nets import MapFitSettings, MapNet
from x2train.sets.window_set import Columns, load_windows

_KEPT, _A_ROUND = 4, 5  # one in so many rounds is judged on alone; labels come in rounds
_MIN_SHARE, _MIN_MPS = 0.7, 0.12  # of the window in view, and mean speed: who clearly walks
_LAWS: Mapping[str, tuple[str, ...]] = {"motion": MOTIONS, "skin": tuple(SKINS)}
_SOURCE = "source"
_PEOPLE, _N_GROUPS = "cmu", 4  # all people of the library are of one source: groups of subjects
Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Law:
    """A motion, a skin or a source."""

    kind: str
    name: str
    individuals: tuple[int, ...] = ()  # of a source

    def __str__(self) -> str:
        return f"{self.kind} {self.name}"

    def of(self, windows: Columns) -> Rows:
        """Return which windows of people and pets it made, shape (n,)."""
        if self.kind == _SOURCE:
            return np.isin(windows["individual"], self.individuals)
        is_this = windows[self.kind] == _LAWS[self.kind].index(self.name)
        return np.asarray(is_this & (windows["label"] < 2))


def main(argv: Sequence[str] | None = None) -> int:
    """Train without each law, and without none; print how each network does on each law."""
    parser = script_parser(
        "leave_one_out",
        "Train without each motion, skin or source in turn, judge on it.",
        "--sets sets/laws --epochs 8 --out left-out.json",
    )
    add = parser.add_argument
    add("--sets", type=Path, nargs="+", required=True, help="sets with several motions and skins")
    add("--epochs", type=int, default=8, help="passes over the windows (8)")
    add("--of", choices=("laws", "sources"), default="laws", help="what is left out (laws)")
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help="where to train (auto)")
    add("--batch", type=int, default=128, help="windows a step (128)")
    add("--seed", type=int, default=0, help="same seed, same figures (0)")
    add("--out", type=Path, metavar="FILE", help="JSON; what it holds is not done again")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(args, epochs=(1, 1e6), seed=(0, 2**31), batch=(2, 1e6))
    windows, abouts = load_windows(*args.sets)
    laws = sources_of(windows, abouts) if args.of == "sources" else laws_of(windows)
    settings = MapFitSettings(
        epochs=args.epochs, seed=args.seed, batch=args.batch, device=device_of(args.device)
    )
    known: dict[str, dict[str, float | None]] = {}
    if args.out and args.out.exists():
        known = json.loads(args.out.read_text(encoding="utf-8"))
    for law in (None, *laws):
        name = str(law) if law else "nothing"
        if name not in known:
            net = followed(trained(windows, law, settings), args.epochs)
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


def sources_of(windows: Columns, abouts: Sequence[Mapping[str, Any]]) -> tuple[Law, ...]:
    """Return the sources of the clips that windows were made by; UsageError if there are none."""
    clips: Any = next((about["clips"] for about in abouts if about.get("clips")), [])
    names = list(dict.fromkeys(str(card["individual"]) for card in clips))
    found: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        source = name.partition("_")[0]
        if source == _PEOPLE:
            source = f"people {_number(name) % _N_GROUPS}"
        if (windows["individual"] == k).any():
            found.setdefault(source, []).append(k)
    if not found:
        msg = "the sets hold no recorded motion: make one with --clips"
        raise UsageError(msg)
    return tuple(Law(_SOURCE, name, tuple(rows)) for name, rows in sorted(found.items()))


def _number(name: str) -> int:
    """Return the number in a name such as 'cmu_subject_16 goes'."""
    return int("".join(filter(str.isdigit, name)) or "0")


def trained(
    windows: Columns, left_out: Law | None, settings: MapFitSettings
) -> Iterator[Epoch | Trained[MapNet]]:
    """Train a network without a law; yields as `fit_maps`."""
    is_kept = _is_kept(windows)
    use = ~is_kept if left_out is None else ~is_kept & ~left_out.of(windows)
    return fit_maps(_rows(windows, use), _rows(windows, is_kept), settings)


def auc_on(made: Trained[MapNet], windows: Columns, law: Law) -> float | None:
    """Return the AUC of people against pets on the kept windows of a law, to four digits.

    None if there are not both of them.
    """
    clear = (windows["share"] > _MIN_SHARE) & (windows["speed_mps"] > _MIN_MPS)
    use = law.of(windows)
    if law.kind == _SOURCE:
        # Those of its label, against all clips of the other one.
        label = np.bincount(windows["label"][use]).argmax()
        use = (use & (windows["label"] == label)) | (
            (windows["label"] == 1 - label) & (windows["individual"] >= 0)
        )
    rows = _rows(windows, use & clear & _is_kept(windows))
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
