"""`decision.bodies`: judged apart, together or not followed, the same verdict."""

import numpy as np

from radard.config.config import load_config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from tests.radar_helpers import BASEBAND, frames_of
from x2radar.frame import StreamInfo


def two_bodies(n):
    """Frames of two bodies that go to and fro, 1.5 m apart."""
    t_s = np.arange(n) / 60
    rng = np.random.default_rng(1)
    frames = rng.standard_normal((n, BASEBAND.n_range, 2), np.float32).view(np.complex64)[..., 0]
    near_m, far_m = BASEBAND.range_m[[0, -1]]
    for share, turn in ((0.25, 1.0), (0.75, 1.3)):
        at_m = near_m + share * (far_m - near_m)
        range_m = at_m + 0.3 * np.sin(2 * np.pi * 0.4 * turn * t_s)
        bins = np.exp(-(((BASEBAND.range_m[None] - range_m[:, None]) / 0.05) ** 2))
        phase = np.exp(-4j * np.pi * BASEBAND.carrier_hz / 3e8 * range_m)
        frames = frames + 60 * bins * phase[:, None]
    return frames.astype(np.complex64)


def test_what_is_made_of_bodies_changes_no_verdict():
    stream = StreamInfo(BASEBAND, 60.0, "module")
    frames = two_bodies(480)
    classifier = Classifier(load_bundle("fast"))
    made = {}
    for bodies in ("apart", "together", "unfollowed"):
        config = load_config(environ={})
        decision = config.decision.model_copy(update={"bodies": bodies})
        pipeline = Pipeline(stream, config.model_copy(update={"decision": decision}), classifier)
        ring = pipeline.make_ring()
        made[bodies] = [
            pipeline.decide(item)
            for frame in frames_of(frames)
            for item in ring.items(frame)
            if isinstance(item, Dwell)
        ]
    apart, together, unfollowed = made.values()
    assert [d.fused for d in apart] == [d.fused for d in together]
    assert [d.fused for d in apart] == [d.fused for d in unfollowed]
    assert not any(d.tracks for d in unfollowed)
    several = [k for k, d in enumerate(apart) if len(d.tracks) > 1]
    assert several
    for k in several:
        assert all(track.window is not None for track in apart[k].tracks)
        assert [t.range_m for t in apart[k].tracks] == [t.range_m for t in together[k].tracks]
        assert all(track.window is None for track in together[k].tracks)
