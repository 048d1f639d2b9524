"""Text files that begin with a byte-order mark, as some editors save them."""

import codecs
import json

import numpy as np
import pytest

from radard.config.config import load_config
from radard.detect.calibration import Calibration, load_calibration
from radard.judge.bundle import load_bundle, sidecar_path
from radard.web.labels import FORMAT, read_labels
from tests.bodies.test_recorded import BVH
from x2radar.sim.scene.scene import load_scene

LABEL = {"format": FORMAT, "format_version": 1, "event": 26 * "0", "label": "pet", "kind": "fault"}
NUMBERS = {"frame_rate_hz": 60.0, "bin_length_m": 0.03, "range_offset_m": 0.6}
CALIBRATION = Calibration(**NUMBERS, floor=np.full(1, 1e-6), threshold_db=np.full(1, 9.0))


def finetune_labels(path):
    from x2train.finetune.labels import labelled_clips

    return labelled_clips(path)


def labelled(path):
    from x2train.judge.labelled import read_list

    return read_list(path)


def motions(path):
    from x2train.motion.formats import read_motions

    return [motion.position.tolist() for motion in read_motions(path)]


def bundle(path):
    whole = sidecar_path("fast")
    path.with_suffix(".onnx").write_bytes(whole.with_suffix(".onnx").read_bytes())
    return load_bundle(str(path))


READERS = {
    "scene.yaml": (lambda p: load_scene(str(p)).steps, "steps: [{duration_s: 3}]\n"),
    "radard.yaml": (load_config, "alarm: {latch_s: 3}\n"),
    "labels.jsonl": (read_labels, json.dumps(LABEL) + "\n"),
    "own.jsonl": (finetune_labels, json.dumps(LABEL) + "\n"),
    "list.csv": (labelled, "file,start,end,label\na.h5,1,2,pet\n"),
    "list.yaml": (labelled, "- {file: a.h5, label: pet}\n"),
    "walk.bvh": (motions, BVH),
    "room.json": (lambda p: load_calibration(p).text(), CALIBRATION.text()),
    "fast.json": (bundle, sidecar_path("fast").read_text(encoding="utf-8")),
}


@pytest.mark.parametrize("name", READERS)
def test_a_mark_changes_nothing(name, tmp_path):
    read, text = READERS[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    plain = read(path)
    assert plain
    path.write_bytes(codecs.BOM_UTF8 + text.encode())
    assert read(path) == plain
