"""Judging: a bundle in the daemon's own pipeline, passage after passage.

No shortcut of training's is taken: clutter map, gate, tracks, features, onnxruntime and the
policy are those that run in `radard`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.classifier import Classifier, load_bundle
from radard.config import Config
from radard.decision import Decision
from radard.pipeline import Pipeline
from radard.ring import Dwell
from x2radar.frame import StreamInfo
from x2train.passages import Passage as Played
from x2train.passages import play
from x2train.report import Passage
from x2train.sites import draw_site
from x2train.suites import Suite, suite_of
from x2train.windows import dwell_ends

_IN_VIEW_DB = 10.0
_LEAST_S = 0.5
"""Somebody counts as having come in who is so far over the noise of a bin for so long: at
the edge of the beam or of the swath there is nothing to see."""
_NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeSpec:
    """What a bundle is judged on; passage k is the same for every bundle.

    Attributes
    ----------
    model : str
        Name or path of the bundle.
    seed : int
        Passage k draws from ``[seed, k]``.
    n_passages : int
        Of the whole run; the suites share them.
    policy : str
        'window' or 'fused'; empty for the bundle's own.
    """

    model: str
    seed: int
    n_passages: int
    policy: str = ""

    def __call__(self, number: int) -> Mapping[str, NDArray[Any]]:
        """Return the columns of passage `number`, see `Passage.columns`."""
        suite = suite_of(number, self.n_passages)
        played = self.played(number)
        return judged(played, suite, self.model, self.policy, build=str(number)).columns()

    def played(self, number: int) -> Played:
        """Simulate passage `number`."""
        rng = np.random.default_rng([self.seed, number])
        suite = suite_of(number, self.n_passages)
        cast = suite.families(rng)
        site = draw_site(rng, suite.drawn_radar(rng), suite.rooms)
        return play(rng, site, cast, duration_s=suite.duration_s, lead_s=(2.6, 4.0))


@lru_cache(maxsize=4)
def _classifier(model: str) -> Classifier:
    return Classifier(load_bundle(model))


def decisions(played: Played, model: str, policy: str = "") -> list[Decision]:
    """Return what radard decides on a passage, by a bundle's name or path."""
    radar = played.site.radar
    axis, rate_hz = radar.axis(), radar.frame_rate_hz
    config = Config()
    if policy:
        section = config.decision.model_copy(update={"policy": policy})
        config = config.model_copy(update={"decision": section})
    pipeline = Pipeline(StreamInfo(axis, rate_hz, radar.name), config, _classifier(model))
    n = pipeline.shape.n_slow
    valid = np.ones(n, bool)
    made = []
    for end in dwell_ends(pipeline.shape, len(played.frames)):
        frames = played.frames[end - n : end]
        dwell = Dwell(frames, valid, axis, rate_hz, end / rate_hz, end_frame=end)
        made.append(pipeline.decide(dwell))
    return made


def judged(played: Played, suite: Suite, model: str, policy: str = "", build: str = "") -> Passage:
    """Return a passage with its truth and all decisions on it."""
    made = decisions(played, model, policy)
    rate_hz = played.site.radar.frame_rate_hz
    truth, label = played.truth, played.cast[0].label if played.cast else "empty"
    facts: dict[str, float] = {}
    if played.cast:
        seen = truth.snr_db[:, 0] > _IN_VIEW_DB
        if seen.sum() >= _LEAST_S * rate_hz:
            first, last = np.flatnonzero(seen)[[0, -1]]
            speed = truth.speed_mps[seen, 0]
            share = np.abs(truth.velocity_mps[seen, 0]) / np.maximum(speed, 0.05)
            facts = {
                "enters_s": float(first / rate_hz),
                "leaves_s": float(last / rate_hz),
                "speed_mps": float(speed.mean()),
                "range_m": float(truth.range_m[seen, 0].mean()),
                "aspect_deg": float(np.degrees(np.arccos(np.clip(share.mean(), 0, 1)))),
                "snr_db": float(truth.snr_db[seen, 0].mean()),
            }
    readings = [d.reading for d in made]
    power_db = np.array([r.power_db if r else _NAN for r in readings])
    range_m = np.array([r.range_m if r and r.is_open else _NAN for r in readings])
    fused = np.array([d.fused.pet + d.fused.other if d.fused else _NAN for d in made])
    windows = [(w.human, w.pet, w.other) if (w := d.window) else (_NAN,) * 3 for d in made]
    p = np.array(windows).reshape(-1, 3)
    return Passage(
        family=" with ".join(f.name for f in played.cast) or "empty room",
        label=label,
        split=suite.split,
        suite=suite.name,
        build=build,
        duration_s=len(played.frames) / rate_hz,
        t_s=np.array([d.t_s for d in made]),
        is_open=np.array([d.gate == "open" for d in made], bool),
        is_pending=np.array([d.label == "pending" for d in made], bool),
        is_alarm=np.array([d.alarm for d in made], bool),
        p_human=p[:, 0],
        p_pet=p[:, 1],
        p_other=p[:, 2],
        fused_quiet=fused,
        power_db=power_db,
        target_range_m=range_m,
        compensated_db=power_db + 40 * np.log10(range_m),
        **facts,
    )
