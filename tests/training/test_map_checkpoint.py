"""A training that was interrupted goes on, and ends with the very same network."""

from dataclasses import replace

import pytest
import torch

from tests.training_helpers import TINY, toy
from x2train.nets import map_checkpoint
from x2train.nets.epoch import Epoch
from x2train.nets.map_fit import fit_maps

pytestmark = pytest.mark.integration

SETTINGS = replace(TINY, epochs=3, dropout=0.2)


class Stopped(Exception):
    """The machine was switched off."""


def fitted(path, settings=SETTINGS, n=96):
    *epochs, made = fit_maps(toy(n), toy(24, seed=1), settings, checkpoint=path)
    return [e for e in epochs if isinstance(e, Epoch)], made


@pytest.fixture
def often(monkeypatch):
    """Checkpoints after every step; `often(n)` switches the machine off after so many."""
    monkeypatch.setattr(map_checkpoint, "_EVERY_S", 0.0)
    monkeypatch.setattr(map_checkpoint.Checkpoints.__init__, "__defaults__", (0.0,))

    def stop_after(n):
        write, count = map_checkpoint.write_whole, [0]

        def counted(path, data):
            write(path, data)
            count[0] += 1
            if count[0] == n:
                raise Stopped

        monkeypatch.setattr(map_checkpoint, "write_whole", counted)

    return stop_after


@pytest.mark.parametrize("n", [1, 6, 17])
def test_an_interrupted_training_ends_with_the_same_network(tmp_path, often, n):
    path = tmp_path / "net.checkpoint"
    whole_epochs, whole = fitted(None)
    often(n)
    with pytest.raises(Stopped):
        fitted(path)
    assert path.exists()
    epochs, made = fitted(path)
    for key, value in whole.net.state_dict().items():
        assert torch.equal(made.net.state_dict()[key], value), key
    assert made.temperature == whole.temperature
    assert epochs[-1] == whole_epochs[-1]
    assert len(epochs) <= len(whole_epochs)
    assert not path.exists()


def test_a_checkpoint_of_another_run_is_not_taken(tmp_path, often):
    path = tmp_path / "net.checkpoint"
    often(8)
    with pytest.raises(Stopped):
        fitted(path)
    other = replace(SETTINGS, seed=5)
    _, alone = fitted(None, other)
    _, made = fitted(path, other)
    for key, value in alone.net.state_dict().items():
        assert torch.equal(made.net.state_dict()[key], value)


@pytest.mark.parametrize("data", [b"", b"rubbish", b"PK\x03\x04" + bytes(100)])
def test_a_damaged_checkpoint_is_begun_afresh(tmp_path, data):
    path = tmp_path / "net.checkpoint"
    path.write_bytes(data)
    epochs, _ = fitted(path)
    assert len(epochs) == SETTINGS.epochs


def test_nothing_that_runs_code_is_read(tmp_path):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "ran"), "w"))

    path = tmp_path / "net.checkpoint"
    torch.save({"print": Evil()}, path)
    fitted(path)
    assert not (tmp_path / "ran").exists()
