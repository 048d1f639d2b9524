"""Teachers: what they say of windows, and what a pupil makes of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from tests.training_helpers import TINY, as_float, toy
from x2train.nets.map_fit import INPUTS, MapTrained, fit_maps
from x2train.nets.teacher import taught_by, taught_error

pytestmark = pytest.mark.integration


def some(n=20, seed=0):
    rng = torch.Generator().manual_seed(seed)
    answers = 3 * torch.randn(n, 3, generator=rng)
    return answers, torch.randint(0, 3, (n,), generator=rng)


def shaped(bundle, n):
    """Windows of a bundle's own maps, as bytes."""
    rng = np.random.default_rng(0)
    return {i.feature: rng.integers(0, 256, (n, *i.shape), np.uint8) for i in bundle.inputs}


def test_a_teacher_says_what_the_daemon_would():
    bundle = load_bundle("fast")
    windows = shaped(bundle, 5)
    said, classifier = taught_by(bundle, windows), Classifier(bundle)
    assert said.dtype == np.float32
    for k, row in enumerate(said):
        inputs = {name: values[k].astype(np.float32) / 255 for name, values in windows.items()}
        p = classifier.classify(inputs)
        assert row == pytest.approx([p.human, p.pet, p.other], abs=1e-5)


def test_a_teacher_of_other_maps_or_classes_is_refused():
    bundle = load_bundle("fast")
    windows = shaped(bundle, 2)
    windows["range_time"] = windows["range_time"][:, 1:]
    with pytest.raises(UsageError, match=r"range_time of shape \(80, 40\), not \(79, 40\)"):
        taught_by(bundle, windows)
    del windows["range_time"]
    with pytest.raises(UsageError, match=r"range_time of shape \(80, 40\), not None"):
        taught_by(bundle, windows)
    with pytest.raises(UsageError, match="tells pet, human apart"):
        taught_by(load_bundle("thesis"), windows)


def test_without_a_share_labels_alone_count():
    answers, labels = some()
    weight = torch.tensor([1.0, 0.5, 2.0])
    alone = taught_error(answers, labels, torch.ones(20, 3) / 3, share=0.0, weight=weight)
    wanted = nn.CrossEntropyLoss(weight=weight)(answers, labels)
    assert alone.item() == pytest.approx(wanted.item(), rel=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_nothing_is_better_than_to_say_what_both_say(share):
    answers, labels = some()
    taught = answers.softmax(1)
    both = share * taught + (1 - share) * torch.eye(3)[labels]
    weight = torch.tensor([1.0, 0.5, 2.0])
    best = taught_error((both + 1e-9).log(), labels, taught, share=share, weight=weight)
    for seed in range(1, 6):
        other = taught_error(some(seed=seed)[0], labels, taught, share=share, weight=weight)
        assert other > best
    assert torch.equal(taught, answers.softmax(1))


def test_a_pupil_learns_what_its_teacher_says_against_the_labels():
    windows = toy(96)
    wrong = np.roll(np.eye(3, dtype=np.float32)[windows["label"]], 1, axis=1)
    settings = replace(TINY, teacher_share=1.0)
    *_, made = fit_maps(windows, toy(24, seed=1), settings, wrong)
    assert isinstance(made, MapTrained)
    made.net.eval()
    unseen = toy(48, seed=2)
    maps = [torch.from_numpy(as_float(unseen[name])) for name in INPUTS]
    with torch.no_grad():
        guess = made.net(*maps).argmax(1).numpy()
    assert (guess == (unseen["label"] + 1) % 3).mean() > 0.9
