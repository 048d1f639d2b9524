"""What installations know of windows: the input `installation`, with things missing.

Each passage is one installation: it knows its mount or not, its level or not, and the level to
2 dB; more of them know it where cross sections follow from sizes. Training hides more, batch by
batch, so that a network works without any of it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from radard.judge.installation import N_INSTALLATION, Mount, installation

ADULT_DB = -9.0
"""What a person who walks shows against a square metre on the axis: median of 850 windows of
physical sizes in view (set laws1), half of them between -12.4 and -4.9 dB."""
_KNOWN_Z = 0.2533  # six in ten installations know their mount, and their level
_FREE_KNOWN_Z = -1.7507
"""Of bodies whose cross section does not follow from their size 4 in 100 know the level: with 20,
half of the windows that knew it taught that strength says nothing, and it was hardly evidence
(docs/research/evaluation-tried.md)."""
LEVEL_ERROR_DB = 2.0  # sigma: what a walk test repeats to
_HIDDEN_SHARE = 0.15  # of windows, for each of height, tilt and strength, in training


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
            Mount(
                float(windows["height_m"][k]) if has_mount else None,
                float(windows["tilt_deg"][k]) if has_mount else None,
                level_db if has_level else None,
            ),
            echo_db if np.isfinite(echo_db) else None,
        )
    return made


def hidden_more(known: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Return a batch of inputs, shape (n, `N_INSTALLATION`), with more of them missing."""
    kept = torch.rand(len(known), 3, generator=rng, device=rng.device) >= _HIDDEN_SHARE
    pairs = kept.repeat_interleave(2, dim=1)
    always = torch.ones(len(known), 1, device=rng.device)
    return known * torch.cat([always, pairs], 1)
