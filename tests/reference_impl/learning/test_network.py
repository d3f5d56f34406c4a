"""Networks: their sizes, what their predictions depend on, and that nothing is computed twice."""

from __future__ import annotations

import pytest
import torch
from tests.reference_impl.learning.small_models import DECLARED, SMALL
from torch import Tensor, nn
from torch.nn import functional

from branchdrive_reference.learning.configuration import ModelConfig
from branchdrive_reference.learning.network import (
    MeanNetwork,
    Outcome,
    OutcomeNetwork,
    build_network,
    initialise,
    num_parameters,
)

GROUPS, CANDIDATES, FEATURES = 3, 13, 29


def made(config: ModelConfig, seed: int = 11) -> OutcomeNetwork:
    network = build_network(config, FEATURES)
    assert isinstance(network, OutcomeNetwork)
    initialise(network, seed=seed)
    return network.double()


def inputs(seed: int = 0) -> dict[str, Tensor]:
    rng = torch.Generator().manual_seed(seed)
    shapes = {"state": (GROUPS, 16, 21), "controls": (GROUPS, 80, 3), "actions": (CANDIDATES, FEATURES)}
    return {name: torch.randn(shape, generator=rng, dtype=torch.float64) for name, shape in shapes.items()}


def run(network: nn.Module, given: dict[str, Tensor]) -> Outcome:
    with torch.no_grad():
        outcome = network(given, num_groups=GROUPS, num_candidates=CANDIDATES)
    assert isinstance(outcome, Outcome)
    return outcome


@pytest.mark.parametrize(("name", "number"), [("M0", 0), ("M1", 202_424), ("M2", 399_800), ("M3", 553_784)])
def test_sizes_are_near_those_of_the_paper(name: str, number: int) -> None:
    assert num_parameters(build_network(DECLARED[name].model, FEATURES)) == number
    paper = {"M0": 0.0, "M1": 0.202e6, "M2": 0.398e6, "M3": 0.553e6}
    assert number == pytest.approx(paper[name], rel=0.005)


@pytest.mark.parametrize(
    ("name", "reads"), [("M1", ("actions",)), ("M2", ("state", "controls")), ("M3", ("state", "controls", "actions"))]
)
def test_every_input_that_is_read_matters_and_no_other(name: str, reads: tuple[str, ...]) -> None:
    network, given = made(SMALL[name].model), inputs()
    assert network.reads == reads
    before = run(network, {key: given[key] for key in reads})
    assert before.scalars.shape == (GROUPS, CANDIDATES, 6)
    assert before.trajectories.shape == (GROUPS, CANDIDATES, 10, 5)
    for key in reads:
        after = run(network, {**given, key: given[key] + 1})
        assert not torch.equal(after.scalars, before.scalars)
        assert not torch.equal(after.trajectories, before.trajectories)


def test_the_history_model_broadcasts_over_the_bank() -> None:
    outcome = run(made(SMALL["M2"].model), inputs())
    for values in outcome:
        assert torch.equal(values, values[:, :1].expand_as(values))
        assert not torch.equal(values[0], values[1])


def test_the_action_model_broadcasts_over_groups() -> None:
    outcome = run(made(SMALL["M1"].model), inputs())
    for values in outcome:
        assert torch.equal(values, values[:1].expand_as(values))
        assert not torch.equal(values[:, 0], values[:, 1])


@pytest.mark.parametrize("name", SMALL)
def test_candidates_and_groups_may_stand_in_any_order(name: str) -> None:
    network, given = made(SMALL[name].model), inputs()
    candidates, groups = torch.tensor([4, 0, 12, 1, 3, 2, 11, 5, 6, 8, 7, 10, 9]), torch.tensor([2, 0, 1])
    moved = {"actions": given["actions"][candidates], "state": given["state"][groups]}
    outcome = run(network, {**moved, "controls": given["controls"][groups]})
    for found, values in zip(outcome, run(network, given), strict=True):
        torch.testing.assert_close(found, values[groups][:, candidates], rtol=0, atol=1e-12)


def test_halves_of_the_fusion_are_one_layer_on_both_encodings() -> None:
    network, given = made(SMALL["M3"].model), inputs()
    assert network.bank is not None
    history = network.contexts["history"](given["state"], given["controls"])
    action, halves = network.bank(given["actions"]), network.decoder.halves
    both = torch.cat([history[:, None].expand(-1, CANDIDATES, -1), action[None].expand(GROUPS, -1, -1)], dim=2)
    total = functional.linear(both, torch.cat([halves["history"], halves["action"]], dim=1))
    for found, values in zip(run(network, given), network.decoder(total), strict=True):
        torch.testing.assert_close(found, values.detach(), rtol=0, atol=1e-12)


def test_a_history_and_a_bank_are_encoded_once() -> None:
    network, rows = made(SMALL["M3"].model), []
    assert network.bank is not None
    for encoder in (network.contexts["history"], network.bank):
        encoder.register_forward_hook(lambda _module, _inputs, encoding: rows.append(len(encoding)))
    run(network, inputs())
    assert rows == [GROUPS, CANDIDATES]


def test_the_last_observation_and_the_last_control_matter() -> None:
    network, given = made(SMALL["M2"].model), inputs()
    before = run(network, given).scalars
    for name in ("state", "controls"):
        for place in (0, -1):
            changed = given[name].clone()
            changed[:, place] += 1
            assert not torch.equal(run(network, {**given, name: changed}).scalars, before)


def test_weights_are_those_of_the_seed_whatever_torch_drew_before() -> None:
    config = SMALL["M3"].model
    torch.manual_seed(1)
    first, drawn = made(config).state_dict(), torch.rand(1)
    torch.manual_seed(1)
    assert torch.equal(torch.rand(1), drawn)
    torch.manual_seed(2)
    second, other = made(config).state_dict(), made(config, seed=23).state_dict()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(first["decoder.halves.action"], other["decoder.halves.action"])


def test_weights_are_drawn_within_their_fan_in() -> None:
    weights = made(DECLARED["M3"].model).state_dict()
    for name, fan_in in {"decoder.halves.history": 320 + 384, "decoder.mix.weight": 192, "decoder.bias": 704}.items():
        bound = fan_in**-0.5
        assert 0.95 * bound < float(weights[name].abs().max()) <= bound
    assert torch.equal(weights["decoder.norm.weight"], torch.ones(192, dtype=torch.float64))


def test_the_mean_is_over_what_is_available() -> None:
    network = MeanNetwork()
    scalars = torch.tensor([[[1.0, 9.0], [3.0, 9.0]], [[5.0, 9.0], [100.0, 9.0]]]).repeat(1, 1, 3)
    mask = torch.ones(2, 2, 6, dtype=torch.bool)
    mask[1, 1, ::2], mask[..., 5] = False, False
    trajectories = torch.arange(200.0).reshape(2, 2, 10, 5)
    network.fit(scalars, mask, trajectories)
    outcome = run(network, {})
    assert outcome.scalars.shape == (GROUPS, CANDIDATES, 6)
    assert outcome.scalars[2, 12].tolist() == [3.0, 9.0, 3.0, 9.0, 3.0, 0.0]
    torch.testing.assert_close(outcome.trajectories[1, 4], trajectories.double().mean((0, 1)), rtol=0, atol=1e-12)
