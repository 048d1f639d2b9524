"""Small sets and networks that several tests of the training share."""

import hashlib
import json
from dataclasses import asdict, replace
from functools import cache

import numpy as np

from radard.judge.bundle import CLASSES, Bundle, EvidenceSettings, ModelInput, load_bundle
from radard.judge.features import feature_shape
from radard.judge.installation import INSTALLATION, N_INSTALLATION
from x2train.bundle.export import GIVEN, exported, with_given, with_head
from x2train.bundle.writing import write_bundle
from x2train.commands.dataset import FEATURES
from x2train.commands.fit import stream_of
from x2train.nets.bundle_answers import outputs_of
from x2train.nets.map_fit import INPUTS as NAMES
from x2train.nets.map_fit import MAPS, fit_maps
from x2train.nets.nets import MapFitSettings
from x2train.nets.temporal_head import Given, HeadSettings, fit_head
from x2train.sets.shards import ShardSet

_SIZE = {"widths": (4, 6, 6, 6), "long_widths": (4, 6, 6, 6), "hidden": 8}
TINY = MapFitSettings(epochs=20, batch=16, learning_rate=1e-2, **_SIZE)
INPUTS = tuple(ModelInput(name, feature_shape(name, FEATURES), name) for name in NAMES)


def as_float(values):
    """Return maps as networks take them; what is no map stays."""
    return (values / 255 if values.dtype == np.uint8 else values).astype(np.float32)


def write_set(folder, columns, **about):
    """Write windows as a set of one shard; returns the folder."""
    about = {"kind": "windows", "use": "all", "settings": asdict(FEATURES), **about}
    ShardSet(folder, about).write("shard-00000", columns)
    return folder


def one_line(capsys):
    """Return the one line that was said on stderr, all progress left out."""
    err = capsys.readouterr().err.splitlines()
    (line,) = [line for line in err if not line.startswith("passages:")]
    return line


def toy(n=96, seed=0):
    """Return windows of three classes that a glance tells apart, four to a passage."""
    rng = np.random.default_rng(seed)
    label = np.arange(n) // 4 % 3
    shapes = {name: feature_shape(name, FEATURES) for name in MAPS}
    maps = {name: rng.integers(0, 60, (n, *shape), np.uint8) for name, shape in shapes.items()}
    for k, at in enumerate(label):
        maps["velocity_time"][k, 10 + 30 * at : 24 + 30 * at] = 220
        maps["range_time"][k, 30:34] = 200
    known = rng.random((n, N_INSTALLATION), np.float32)
    count = np.arange(n)
    made = {**maps, INSTALLATION: known, "label": label.astype(np.int64), "passage": count // 4}
    made |= {"t_s": 3.0 + count % 4, "is_physical": np.ones(n, bool)}
    made |= {k: np.ones(n) for k in ("share", "speed_mps", "aspect", "height_m", "tilt_deg")}
    return made | {k: np.full(n, 60.0) for k in ("frame_rate_hz", "echo_db", "level_db")}


def trained(settings=TINY, *, n=96):
    """Return a network that knows the toy windows, and its epochs."""
    *epochs, made = fit_maps(toy(n), toy(48, seed=1), settings)
    return made, epochs


@cache
def tiny():
    """Return `trained()` once for all tests: none may change it."""
    return trained()


@cache
def _exported(net):
    return exported(net, INPUTS, toy(48, seed=1))[0]


def write_tiny(folder, network, *, name="tiny", evidence=None, metrics=None):
    """Write a bundle of toy windows."""
    own = {"name": name, "policy": "fused", "evidence": asdict(evidence or EvidenceSettings())}
    same = {"inputs": INPUTS, "features": FEATURES, "stream": stream_of([]), "classes": CLASSES}
    onnx, temperature = _exported(network.net), network.temperature
    bundle = Bundle(onnx=onnx, temperature=temperature, pet_limit=0.8, **own, **same)
    training = {"recipe": "a toy.", "command": "train-export fit"}
    known = {"training": training, "metrics": metrics or {}, "gate": {}, "notes": "some notes"}
    write_bundle(folder, bundle, **known)


def given(bundle, columns):
    """Return what the last layer of a bundle's network is given of toy windows."""
    maps = {name: columns[name] for name in NAMES}
    answers = outputs_of(with_given(bundle.onnx), maps, tap=GIVEN)
    log_p = np.log(answers.p(bundle.temperature)).astype(np.float32)
    return Given(answers.tapped, log_p, columns["label"], np.arange(len(log_p)) % 4 == 0)


def head_for(bundle, **settings):
    """Return a temporal head of toy windows."""
    size = {"n_projected": 6, "n_hidden": 5, "n_said": 8, "epochs": 20, "batch": 4, **settings}
    seen = given(bundle, toy(96)), given(bundle, toy(48, seed=1))
    *_, made = fit_head(*seen, HeadSettings(**size))
    return made


def give_head(path, *, temperature=1.0):
    """Give the bundle of a file a temporal head that is as unsure as its temperature says."""
    bundle = load_bundle(str(path))
    made = replace(head_for(bundle), temperature=temperature)
    onnx = with_head(bundle.onnx, made, bundle.temperature)
    path.write_bytes(onnx)
    sidecar = json.loads(path.with_suffix(".json").read_text())
    sidecar |= {"onnx_sha256": hashlib.sha256(onnx).hexdigest(), "hidden": made.net.n_hidden}
    path.with_suffix(".json").write_text(json.dumps(sidecar))
