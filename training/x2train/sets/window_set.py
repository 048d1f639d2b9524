"""Window sets on disk, read back, with what installations know of their windows.

Each passage is one installation, the input of that name: it knows its mount or not, its level or
not, and the level to 2 dB; more of them know it where cross sections follow from sizes.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle
from radard.judge.features import FeatureSettings
from radard.judge.installation import INSTALLATION, N_INSTALLATION, installation
from x2train.sets.shards import read_all

Columns = Mapping[str, NDArray[Any]]
ADULT_DB = -9.0
"""What a person who walks shows against a square metre on the axis: median of 850 windows of
physical sizes in view (set laws1), half of them between -12.4 and -4.9 dB."""
_KNOWN_Z = 0.2533  # six in ten installations know their mount, and their level
_FREE_KNOWN_Z = -1.7507
"""Of bodies whose cross section does not follow from their size 4 in 100 know the level: with 20,
half of the windows that knew it taught that strength says nothing, and it was hardly evidence
(docs/research/evaluation-tried.md)."""
LEVEL_ERROR_DB = 2.0  # sigma: what a walk test repeats to
_MIN_SHARE, _MIN_MPS = 0.6, 0.1  # of a dwell in view, and towards or away
_KEPT_PASSAGES = 5  # of so many passages one keeps all its windows


def load_windows(
    *folders: Path, choose: Callable[[Columns], Columns] | None = None
) -> tuple[Columns, list[Mapping[str, Any]]]:
    """Return the columns of one or more sets, and what each was made from.

    `choose` returns the windows of a set that are wanted (all), so that no others stay in memory.

    Raises RecordingError if a set is missing, unreadable or damaged, UsageError if it holds no
    windows, or windows made with other features than the first's.
    """
    made: list[dict[str, NDArray[Any]]] = []
    abouts: list[Mapping[str, Any]] = []
    for folder in folders:
        about, columns = read_all(folder)
        if about.get("kind") != "windows":
            raise UsageError(f"{folder}: holds no windows but '{about.get('kind')}'")
        if abouts and about.get("settings") != abouts[0].get("settings"):
            msg = f"{folder}: its maps were made with other settings than those of {folders[0]}"
            raise UsageError(msg)
        if not columns:
            raise UsageError(f"{folder}: holds no window")
        abouts.append(about)
        known = {INSTALLATION: known_of(columns), **columns}
        made.append(dict(choose(known) if choose else known))
    keys = list(made[0])
    # A million windows take 10 GB: no column stays twice.
    return {key: np.concatenate([each.pop(key) for each in made]) for key in keys}, abouts


def worth_learning(columns: Columns) -> Columns:
    """Return the windows in which people and pets show enough to tell them apart, and some more.

    Who is in view for most of the dwell and comes nearer or goes away does. Of the other windows a
    fifth stays, so that a network has seen entries and people who stand. Without them it learns
    better (docs/training.md).
    """
    radial_mps = columns["speed_mps"] * columns["aspect"]
    shows = (columns["share"] >= _MIN_SHARE) & (radial_mps >= _MIN_MPS)
    is_kept = columns["passage"] % _KEPT_PASSAGES == 0
    rows = np.flatnonzero(shows | is_kept | (columns["label"] == CLASSES.index("other")))
    return {name: values[rows] for name, values in columns.items()}


def inputs_of(bundle: Bundle, columns: Columns) -> Columns:
    """Return what a bundle's network is given of windows, by the name of its input."""
    return {each.name: columns[each.feature] for each in bundle.inputs}


def check_made_for(
    bundle: Bundle, columns: Columns, about: Mapping[str, Any], folder: Path
) -> None:
    """Raise UsageError if a bundle of three classes cannot take a set's maps as they are."""
    missing = [i.feature for i in bundle.inputs if i.feature not in columns]
    if missing:
        raise UsageError(f"{folder}: holds no {missing[0]}, which model '{bundle.name}' takes")
    if bundle.classes != CLASSES:
        msg = f"model '{bundle.name}' tells {', '.join(bundle.classes)} apart; three are needed"
        raise UsageError(msg)
    if FeatureSettings.from_mapping(about["settings"]) != bundle.features:
        raise UsageError(
            f"{folder}: its maps are not those that model '{bundle.name}' takes; make the set "
            f"with train-export dataset --like {bundle.name}"
        )


def known_of(windows: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
    """Return the input `installation` of windows, float32, drawn by the passage's number."""
    n = len(windows["label"])
    passage = np.asarray(windows["passage"], np.int64)
    # One table, row by row: a passage draws the same in any company.
    drawn = np.random.default_rng(0).standard_normal((int(passage.max(initial=0)) + 1, 3))
    is_known = drawn[:, :2] < _KNOWN_Z
    knows_free = drawn[:, 1] < _FREE_KNOWN_Z
    is_physical = np.asarray(windows["is_physical"], bool).tolist()
    error_db = LEVEL_ERROR_DB * drawn[:, 2]
    made = np.zeros((n, N_INSTALLATION), np.float32)
    for k, at in enumerate(passage.tolist()):
        has_mount, has_level = is_known[at].tolist()
        has_level = has_level if is_physical[k] else bool(knows_free[at])
        level_db = float(windows["level_db"][k]) + ADULT_DB + float(error_db[at])
        echo_db = float(windows["echo_db"][k])
        made[k] = installation(
            float(windows["frame_rate_hz"][k]),
            float(windows["height_m"][k]) if has_mount else None,
            float(windows["tilt_deg"][k]) if has_mount else None,
            echo_db - level_db if has_level and np.isfinite(echo_db) else None,
        )
    return made
