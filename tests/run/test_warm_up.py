"""What a pipeline prepares before its first dwell changes nothing that it decides."""

from dataclasses import replace

import pytest

from radard.config.config import Config
from radard.pipeline import Pipeline
from radard.run.components import make_classifier
from radard.stream.source import open_source


@pytest.mark.parametrize("model", ["none", "thesis"])
def test_warming_up_leaves_no_trace(model):
    config = Config()
    config = config.model_copy(update={"model": config.model.model_copy(update={"name": model})})
    source = open_source("sim:human?seed=1", speed="max")
    try:
        classifier = make_classifier(config)
        cold = Pipeline(source.stream, config, classifier)
        warm = Pipeline(source.stream, config, classifier)
        opened = []
        warm.warm_up()
        ring = cold.make_ring()
        for frame in source.frames():
            ring.push(frame)
            try:
                dwell = ring.next_item(0)
            except TimeoutError:
                continue
            expected, found = cold.decide(dwell), warm.decide(dwell)
            assert replace(found, t_mono_s=0.0) == replace(expected, t_mono_s=0.0)
            opened.append(found.gate == "open")
            if dwell.t_s > 6:
                break
        assert any(opened)
    finally:
        source.close()
