"""What a pipeline prepares before its first dwell changes nothing that it decides."""

from dataclasses import replace

import pytest

from radard.config.config import load_config
from radard.pipeline import Pipeline
from radard.run.listening import listen


@pytest.mark.parametrize("model", ["none", "thesis"])
def test_warming_up_leaves_no_trace(model):
    options = {"sensor": {"port": "sim:human?seed=1", "speed": "max"}, "model": {"name": model}}
    config = load_config(environ={}, options=options)
    with listen(config) as listening:
        cold = listening.pipeline
        warm = Pipeline(listening.source.stream, config, cold.classifier)
        warm.warm_up()
        pairs = [(cold.decide(dwell), warm.decide(dwell)) for dwell in listening.dwells(7.0)]
    assert any(found.gate == "open" for _, found in pairs)
    for expected, found in pairs:
        assert replace(found, t_mono_s=0.0) == replace(expected, t_mono_s=0.0)
