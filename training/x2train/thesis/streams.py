"""What a bundle of the thesis' network does on streams: whole visits, judged as by the daemon.

An element begins with a body somewhere on its way, often outside the swath. A stream has the
module's noise and quantization, a room, the gate in front of the network, and window after window.
"""

from collections.abc import Mapping

import numpy as np

from radard.alarm.sensitivity import alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.judge.bundle import Bundle
from radard.judge.classifier import Classifier
from radard.judge.decision import Decision
from radard.pipeline import Pipeline
from x2radar.frame import StreamInfo
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import parse_scene
from x2train.judge.judging import dwells
from x2train.thesis.recipe import Tell

_VISIT_S = 6.0  # the quickest have left the swath by then
_SCENE = """
steps:
  - {{body: thesis_{body}, duration_s: {visit_s}}}
clutter:
  - {{range_m: 0.75, rcs_m2: 30000}}
  - {{range_m: 1.90, rcs_m2: 60000}}
  - {{range_m: 3.10, rcs_m2: 400000}}
"""


def stream_metrics(
    bundle: Bundle, rate_hz: float, bodies: tuple[str, ...], n: int, tell: Tell
) -> Mapping[str, float]:
    """Return, of `n` visits of each body, windows and visits with and without alarm."""
    classifier = Classifier(bundle)
    policy = alarm_policy(AlarmSection(), bundle.policy)
    metrics = {"streams of each body": float(n)}
    for body in bodies:
        quiet: list[bool] = []
        alarms = 0
        for seed in range(n):
            made = _decisions(classifier, rate_hz, body, seed)
            quiet += [not d.alarm for d in made if d.gate == "open"]
            hits = np.array([d.alarm for d in made], float)
            alarms += bool((np.convolve(hits, np.ones(policy.n)) >= policy.k - 0.5).any())
            tell(f"streams of {body}", seed + 1, n)
        # `radard explain` reads these.
        metrics[f"share without alarm, {body}"] = float(np.mean(quiet)) if quiet else 1.0
        metrics[f"share of visits with an alarm, {body}"] = alarms / n
    return metrics


def _decisions(classifier: Classifier, rate_hz: float, body: str, seed: int) -> list[Decision]:
    keys = {"rate": f"{rate_hz:g}", "kind": "rf"}
    settings = port_settings(Port("sim", body, keys))
    assert not callable(settings)  # noqa: S101 - only device=auto needs a module
    scene = parse_scene(_SCENE.format(body=body, visit_s=_VISIT_S), body, body)
    stream = EchoStream(scene, seed, settings)
    pipeline = Pipeline(
        StreamInfo(stream.axis, rate_hz, "x2raw"), Config(), classifier, judges_tracks=False
    )
    frames = (stream.next() for _ in range(round(_VISIT_S * rate_hz)))
    rows = (row for row in frames if row is not None)
    return [pipeline.decide(each) for each in dwells(pipeline, rows, stream.axis)]
