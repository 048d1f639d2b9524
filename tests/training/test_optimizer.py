"""Steps of training: who steers which weights, and whether they go downhill."""

import pytest
import torch
from torch import nn

from x2train.nets.nets import MapNet
from x2train.nets.optimizer import MuonAdamW

pytestmark = pytest.mark.integration

RATES = {"rate": 1e-2, "matrix_rate": 2e-2, "weight_decay": 0.0, "matrix_decay": 0.0}


def net_of(last=True):
    torch.manual_seed(0)
    net = MapNet(24, 20, widths=(4, 6, 8, 8), hidden=8)
    return net.to(memory_format=torch.channels_last if last else torch.contiguous_format)


def loss_of(net):
    rng = torch.Generator().manual_seed(1)
    maps = torch.rand(16, 24, 12, generator=rng), torch.rand(16, 20, 12, generator=rng)
    return nn.functional.cross_entropy(net(*maps), torch.arange(16) % 3)


@pytest.mark.parametrize("last", [True, False])
def test_every_weight_moves_and_the_loss_falls(last):
    net = net_of(last)
    before = {name: p.detach().clone() for name, p in net.named_parameters()}
    optimizer = MuonAdamW(net, 30, **RATES)
    losses = []
    for _ in range(30):
        loss = loss_of(net)
        losses.append(loss.item())
        optimizer.step(loss)
    assert losses[-1] < 0.3 * losses[0]
    for name, p in net.named_parameters():
        assert not torch.equal(p, before[name]), name


def test_a_matrix_goes_the_same_way_whatever_the_order_of_its_memory():
    went = []
    for last in (True, False):
        net = net_of(last)
        before = net.range[2][0].weight.detach().clone()
        optimizer = MuonAdamW(net, 10, **RATES)
        optimizer.step(loss_of(net))
        went.append((net.range[2][0].weight.detach() - before).flatten())
    # Muon's iteration is in half precision.
    assert torch.cosine_similarity(*went, dim=0) > 0.99


def test_all_directions_of_a_matrix_learn_equally_fast():
    net = nn.Linear(64, 16, bias=False)
    before = net.weight.detach().clone()
    optimizer = MuonAdamW(net, 10, **RATES)
    x = torch.randn(200, 64, generator=torch.Generator().manual_seed(0)) * torch.logspace(
        -2, 0, 64
    )
    rate = optimizer.rates[-1]
    optimizer.step((net(x) ** 2).mean())
    went = torch.linalg.svdvals(net.weight.detach() - before) / rate
    assert went.max() / went.min() < 3
    assert 0.5 < went.median() < 1.5


def test_one_cycle_rises_and_ends_near_nothing():
    net = net_of()
    optimizer = MuonAdamW(net, 20, **RATES)
    rates = []
    for _ in range(20):
        rates.append(tuple(optimizer.rates))
        optimizer.step(loss_of(net))
    adam, muon = zip(*rates, strict=True)
    assert max(adam) == pytest.approx(RATES["rate"])
    assert max(muon) == pytest.approx(RATES["matrix_rate"])
    assert adam.index(max(adam)) == muon.index(max(muon)) in (3, 4)
    assert adam[-1] < 1e-3 * max(adam)
