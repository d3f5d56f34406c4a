"""The optimiser comes to the bits of torch's."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from branchdrive_reference.learning.adam import AdamW

RATES = (1e-3, 3e-3, 0.0, 1e-2)
"""Of every step."""


def loss_of(network: nn.Module, rows: torch.Tensor) -> torch.Tensor:
    loss: torch.Tensor = network(rows).square().mean()
    return loss


def new_network() -> nn.Module:
    torch.manual_seed(7)
    return nn.Sequential(nn.Linear(5, 9), nn.Tanh(), nn.Linear(9, 2))


@pytest.mark.parametrize("fused", [True, False])
def test_it_comes_to_the_bits_of_torch(fused: bool) -> None:
    ours, theirs = new_network(), new_network()
    optimizer = AdamW(ours.parameters(), weight_decay=0.02, fused=fused)
    expected = torch.optim.AdamW(theirs.parameters(), weight_decay=0.02, fused=fused)
    for rate in RATES:
        rows = torch.randn(4, 5)
        optimizer.descend(loss_of(ours, rows), rate)
        expected.param_groups[0]["lr"] = rate
        expected.zero_grad()
        loss_of(theirs, rows).backward()
        expected.step()
    for place, (one, other) in enumerate(zip(ours.parameters(), theirs.parameters(), strict=True)):
        assert torch.equal(one, other)
        assert not torch.equal(one, list(new_network().parameters())[place])
        state = expected.state[other]
        assert all(torch.equal(moments[place], state[name]) for name, moments in optimizer.moments.items())


def test_without_decay_it_is_plain_adam() -> None:
    ours, theirs, rows = new_network(), new_network(), torch.ones(4, 5)
    optimizer, expected = AdamW(ours.parameters()), torch.optim.Adam(theirs.parameters(), lr=1e-3)
    for _ in range(3):
        optimizer.descend(loss_of(ours, rows), 1e-3)
        expected.zero_grad()
        loss_of(theirs, rows).backward()
        expected.step()
    assert all(torch.equal(*pair) for pair in zip(ours.parameters(), theirs.parameters(), strict=True))
