"""Windows that `train-export tradeoff` judges by: the same dwells at several decimations."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.features import MAP_FEATURES, FeatureSettings
from radard.judge.installation import INSTALLATION, installation
from x2train.judge.judging import JudgeSpec
from x2train.sets.families import LABELS
from x2train.sets.passages import Passage
from x2train.sets.sites import ONE_RADAR
from x2train.sets.windows import windows_of

RADAR = "thesis"
"""An X2 with all its bins."""
_HUMAN, _PET = LABELS.index("human"), LABELS.index("pet")

Maps = Mapping[str, NDArray[Any]]
_Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class JudgedWindows:
    """Windows in which a person or a pet is in view."""

    is_human: NDArray[np.bool_]
    passage: NDArray[np.int64]  # (n,): of which passage, counted from 0 without gaps
    # (n, rows, cells): by settings and decimation; bytes, 255 for 1
    maps: Mapping[tuple[FeatureSettings, int], Maps]


def judged_windows(
    n_passages: int,
    seed: int,
    kinds: Sequence[FeatureSettings],
    decimations: Sequence[int],
) -> Iterator[int | JudgedWindows]:
    """Play passages of people and pets once, and make their windows every way.

    Passage k is that of `train-export evaluate --radar thesis` with this seed; those of things and
    of empty rooms are passed over. Yields passages done, then the windows: dwells with an open
    gate at every decimation. Raises UsageError if nobody is in view.
    """
    spec = JudgeSpec(model="", seed=seed, n_passages=n_passages, radar=RADAR)
    ways = [(kind, d) for kind in kinds for d in decimations]
    made: list[list[_Columns]] = []
    for number in range(n_passages):
        if _has_people_or_pets(spec, number):
            found = _every_way(spec.played(number), ways, number)
            if found is not None:
                made.append(found)
        yield number + 1
    if not made:
        msg = f"--passages {n_passages}: too few, nobody is in view"
        raise UsageError(msg)
    labels = [each[0]["label"] for each in made]
    passage = np.repeat(np.arange(len(made)), [len(each) for each in labels])
    maps: dict[tuple[FeatureSettings, int], dict[str, NDArray[Any]]] = {
        way: {name: np.concatenate([each[k][name] for each in made]) for name in MAP_FEATURES}
        for k, way in enumerate(ways)
    }
    label = np.concatenate(labels)
    # At the rate of `RADAR`, of which nothing else is known.
    nothing = np.tile(installation(ONE_RADAR[RADAR].frame_rate_hz), (len(label), 1))
    for each in maps.values():
        each[INSTALLATION] = nothing
    yield JudgedWindows(label == _HUMAN, passage, maps)


def _has_people_or_pets(spec: JudgeSpec, number: int) -> bool:
    cast = spec.suite(number).cast
    return bool(cast) and (cast[0] if isinstance(cast[0], str) else cast[0].label) != "other"


def _every_way(
    passage: Passage, ways: Sequence[tuple[FeatureSettings, int]], number: int
) -> list[_Columns] | None:
    """Return the windows of a passage, the same dwells in all; None if there are none."""
    made = [windows_of(_decimated(passage, d), kind, number) for kind, d in ways]
    if any(each is None for each in made):
        return None
    columns = [each for each in made if each is not None]
    common = set.intersection(*(set(each["t_s"].tolist()) for each in columns))
    kept: list[_Columns] = []
    for each in columns:
        is_kept = np.isin(each["t_s"], list(common)) & np.isin(each["label"], (_HUMAN, _PET))
        kept.append({key: values[is_kept] for key, values in each.items()})
    return kept if len(kept[0]["t_s"]) else None


def _decimated(passage: Passage, decimation: int) -> Passage:
    """Return what the daemon's ring would keep: every so many bins behind the matched filter."""
    radar = passage.site.radar
    frames = np.ascontiguousarray(passage.frames[:, ::decimation])
    bin_m = decimation * radar.bin_length_m
    far_m = radar.near_m + (frames.shape[1] - 1) * bin_m
    coarse = replace(radar, bin_length_m=bin_m, far_m=far_m)
    return replace(passage, site=replace(passage.site, radar=coarse), frames=frames)
