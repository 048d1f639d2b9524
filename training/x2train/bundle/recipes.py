"""How the shipped bundles are made: the commands, sets included, in their order."""

import shlex
from collections.abc import Mapping
from pathlib import Path

_MIN_PASSAGES = 12
_HELD_OUT = "'held out'"
_X4M03 = "--radar x4m03"
_LONG = "--longest 18"
_ANY_BODIES = (
    "--motion gait footfalls angles --skin points ellipsoids capsules surface points ellipsoids "
    "--plain 0.7"
)
_BODIES = f"--families all {_ANY_BODIES}"
_CLEAR = f"{_BODIES} --clear 0.7 --physical 0.4 --longest 7"
_ROOMS = f"{_BODIES} --clear 0.2 --physical 0.7 --longest 7"
_CHECK = f"{_BODIES} --clear 0.5 --physical 0.5"
_ODD = f"{_ANY_BODIES} --clear 0.5 --physical 0.7 {_LONG}"  # what alarms were wrong of
_X2_CLEAR = (
    "--families all --motion footfalls angles --skin points ellipsoids --radar x2 --clear 1 "
    "--plain 1 --longest 6"
)
"""What transfers best to recorded motion (docs/research/evaluation-tried.md)."""
MOTION = "MOTION"  # stands for the folder that `make --motion` names
_CLIPS = (
    f"--clips {MOTION} --skin points ellipsoids capsules surface points ellipsoids --clear 0.7 "
    "--plain 0.7 --physical 0.4"
)
_SETS: Mapping[str, tuple[int, str]] = {
    "x2clear": (26_000, f"{_X2_CLEAR} --seed 506"),
    "clear": (22_000, f"{_CLEAR} --seed 502"),
    "x2sizes": (8_000, f"{_X2_CLEAR} --physical 0.3 --seed 505"),
    "rooms": (12_000, f"{_ROOMS} --seed 504"),
    "x2more": (84_000, f"{_X2_CLEAR} --seed 606"),
    "more": (76_000, f"{_CLEAR} --seed 607"),
    "check": (1_500, f"{_CHECK} --longest 7 --seed 503"),
    "longall": (3_000, f"{_CHECK} {_LONG} --seed 508"),
    "longallcheck": (600, f"{_CHECK} {_LONG} --seed 509"),
    "clips": (30_000, f"{_CLIPS} --longest 7 --seed 711"),
    "clipslong": (2_000, f"{_CLIPS} {_LONG} --seed 712"),
    "clipvisits": (8_000, f"{_CLIPS} {_LONG} --seed 812"),
    "visits": (8_000, f"{_CHECK} {_LONG} --seed 808"),
    "heldvisits": (3_000, f"--families {_HELD_OUT} {_ODD} --seed 820"),
    "things": (1_500, f"--families things {_ODD} --seed 822"),
    "clipvisits2": (4_000, f"{_CLIPS} --physical 0.5 --slow 0.3 {_LONG} --seed 852"),
    "visits2": (5_000, f"{_BODIES} --clear 0.5 --physical 0.6 {_LONG} --seed 853"),
    "heldvisits2": (2_500, f"--families {_HELD_OUT} {_ODD} --seed 854"),
    "things2": (800, f"--families things {_ODD} --seed 855"),
    "clipscheck": (800, f"{_CLIPS} --longest 7 --seed 713"),
    "x2near": (6_000, f"{_X2_CLEAR} --physical 0.3 --seed 714"),
    "anyclear": (10_000, f"{_CLEAR} --seed 715"),
    "x4clips": (12_000, f"{_X4M03} {_CLIPS} --longest 7 --seed 741"),
    "x4clipscheck": (600, f"{_X4M03} {_CLIPS} --longest 7 --seed 743"),
    "x4anycheck": (800, f"{_X4M03} {_CHECK} --longest 7 --seed 744"),
    "x4any": (6_000, f"{_X4M03} {_CLEAR} --seed 745"),
    "x4rooms": (3_000, f"{_X4M03} {_ROOMS} --seed 746"),
    "x4clipvisits": (2_000, f"{_X4M03} {_CLIPS} {_LONG} --seed 747"),
    "x4visits": (2_000, f"{_X4M03} {_CHECK} {_LONG} --seed 748"),
    "x4heldvisits": (800, f"{_X4M03} --families {_HELD_OUT} {_ODD} --seed 749"),
    "x4things": (400, f"{_X4M03} --families things {_ODD} --seed 750"),
    "clipsslow": (10_000, f"{_CLIPS} --slow 1 --longest 7 --seed 731"),
    "clips2": (6_000, f"{_CLIPS} --longest 7 --seed 732"),
    "anyclear2": (6_000, f"{_CLEAR} --seed 733"),
    "anyrooms": (5_000, f"{_ROOMS} --seed 716"),
}
"""Passages, and whatever else `train-export dataset` is told, by the set's folder."""
_FOUR = "sets/x2clear sets/clear sets/x2sizes sets/rooms"
_ALL = f"--train {_FOUR} --validate sets/check"
_MILLION = f"--train {_FOUR} sets/x2more sets/more --validate sets/check"
"""1,000,966 windows, which need 12 GB of memory."""
_LONG_SETS = "--train sets/clear sets/rooms sets/longall --validate sets/check sets/longallcheck"
_X4_CHECKS = "--validate sets/x4clipscheck sets/x4anycheck"
_X4 = f"--train sets/x4clips sets/x4any sets/x4rooms {_X4_CHECKS}"
_MORE = (
    "--train sets/clipsslow sets/clips2 sets/anyclear2 sets/x4clips sets/x4any "
    "--validate sets/clipscheck sets/x4anycheck"
)
_X4_LONG = f"--train sets/x4clipvisits sets/x4visits sets/x4heldvisits sets/x4things {_X4_CHECKS}"
_CHECKS = "--validate sets/clipscheck sets/check"
_RECORDED = f"--train sets/clips sets/x2near sets/anyclear sets/anyrooms {_CHECKS}"
_RECORDED_LONG = f"--train sets/clipslong sets/longall sets/anyrooms {_CHECKS}"
_VISITS = "sets/clipvisits sets/visits sets/heldvisits sets/things"
_MORE_LONG = f"--train {_VISITS} {_CHECKS}"
_MOST_LONG = f"--train {_VISITS} {_VISITS.replace(' ', '2 ')}2 {_CHECKS}"
_PARTS = "models/parts"  # bundles that others are made from
_IN_PARTS = f"--out {_PARTS}"
_FOUR_PARTS = "recorded-few recorded-large recorded-accurate generated-accurate"
_GO_ON = f" --start {_PARTS}/recorded-visits.onnx"
_APART = f" --apart {_PARTS}/recorded-few.onnx {_PARTS}/generated-accurate.onnx"
_WAITS = " --leaning 0.6 --brief 2"
_SMALL_SHARE = 0.05  # of the passages, to try it: --half pays on whole sets alone


def _generated(size: str, fit: str, sets: str = _ALL) -> str:
    """Return how a network learns from the generators' bodies, to go on from."""
    name = f"generated-{size}"
    return f"train-export fit {sets} --name {name} --size {size} {fit} --seed 0 --half {_IN_PARTS}"


def _recorded(name: str, size: str, epochs: int, start: str = "") -> str:
    """Return how a network learns from recorded bodies, from one that knows generated ones on."""
    start = start and f" --start {_PARTS}/generated-{start}.onnx"
    return (
        f"train-export fit {_RECORDED} --name recorded-{name} --size {size} --epochs {epochs} "
        f"--seed 0 --half --batch 512{start} {_IN_PARTS}"
    )


def _visits(
    name: str, parts: str, lean: str, sets: str = _RECORDED_LONG, size: str | None = None
) -> str:
    """Return how a head learns to judge visits (docs/research/evaluation-tried.md)."""
    models = " ".join(f"{_PARTS}/{part}.onnx" for part in parts.split())
    return (
        f"train-export temporal --model {models} {sets} --size {size or name} --name {name}"
        f"{lean} --epochs 6 --seed 0"
    )


_ON_VISITS = f"{_visits('recorded-visits', _FOUR_PARTS, '', _MORE_LONG, 'accurate')} {_IN_PARTS}"


def _on_recordings(size: str, epochs: int, lean: str) -> tuple[str, ...]:
    return (
        _generated(size, f"--epochs {epochs}"),
        _recorded(size, size, 14, size),
        _visits(size, f"recorded-{size}", lean),
    )


RECIPES: Mapping[str, tuple[str, ...]] = {
    "accurate": (
        _generated("accurate", "--epochs 4", _MILLION),
        _recorded("few", "accurate", 4, "accurate"),
        _recorded("large", "large", 4),
        _recorded("accurate", "accurate", 14, "accurate"),
        _ON_VISITS,
        _visits("accurate", _FOUR_PARTS, f" --prior 0.15{_WAITS}", _MOST_LONG) + _GO_ON + _APART,
    ),
    "balanced": _on_recordings("balanced", 8, " --prior 0.4 --brief 2"),
    "fast": _on_recordings("fast", 6, " --prior 0.4 --brief 2"),
    "generated": (
        f"train-export fit {_MILLION} --name generated --size accurate --epochs 4 --seed 0 --half",
        f"train-export temporal --model models/generated.onnx {_LONG_SETS} "
        "--size accurate --prior 0.3 --leaning 0.6 --brief 2 --epochs 6 --seed 0",
    ),
    "x4m03": (
        _generated("accurate", "--epochs 4", _MILLION),
        _recorded("accurate", "accurate", 14, "accurate"),
        f"train-export fit {_X4} --name x4recorded --size accurate --epochs 4 --seed 0 "
        f"--half --start {_PARTS}/recorded-accurate.onnx {_IN_PARTS}",
        _recorded("few", "accurate", 4, "accurate"),
        _recorded("large", "large", 4),
        f"train-export fit {_MORE} --name recorded-larger --size large --epochs 2 "
        f"--seed 0 --half --start {_PARTS}/recorded-large.onnx --stream any {_IN_PARTS}",
        _ON_VISITS,
        _visits(
            "x4m03",
            "x4recorded recorded-few recorded-larger recorded-accurate generated-accurate",
            f" --prior 0.4{_WAITS}",
            _X4_LONG,
            "accurate",
        )
        + _GO_ON,
    ),
    "thesis": (
        "train-export thesis --pretrain 12,3 --output-epochs 9 --epochs 200 "
        "--bundle models/thesis",
    ),
}
"""Commands of `train-export` behind the sets, as the card has them, by name of the bundle."""


def recipe_of(command: str) -> str | None:
    """Return the name of the recipe that runs a card's command; None if none does."""
    return {" && ".join(commands): name for name, commands in RECIPES.items()}.get(command)


def arguments(
    name: str,
    *,
    share: float = 1.0,
    workers: int = 1,
    models: Path = Path("models"),
    motion: Path | None = None,
) -> list[list[str]]:
    """Return the arguments of every command of a recipe; a `share` below 1 is a trial."""
    folder = "sets" if share == 1 else f"sets-{share:g}"
    made: dict[str, list[str]] = {}
    for command in RECIPES[name]:
        words = []
        for word in shlex.split(command)[1:]:
            top, _, rest = word.partition("/")
            if top == "sets":
                words.append(f"{folder}/{rest}")
                passages, more = _SETS[rest]
                step = ["dataset", "--out", words[-1], *shlex.split(more)]
                step += ["--passages", str(max(_MIN_PASSAGES, round(share * passages)))]
                step += ["--workers", str(workers)]
                made[rest] = [str(motion or MOTION) if w == MOTION else w for w in step]
            else:
                words.append(str(models / rest) if top == "models" and rest else word)
        if share < _SMALL_SHARE:
            words = [word for word in words if word != "--half"]
        if words[0] == "thesis":
            words += ["--workers", str(workers), "--share", f"{share:g}"]
        elif models != Path("models") and "--out" not in words:
            words += ["--out", str(models)]
        made[command] = words
    return list(made.values())
