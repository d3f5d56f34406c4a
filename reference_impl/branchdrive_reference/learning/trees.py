"""Gradient-boosted trees on summaries of histories and on the action: a model that learns no weights by descent.

Each scalar target has its own sum of regression trees, fitted by scikit-learn to the training rows in which it is
available. A row is one candidate of one group::

    x = [last, mean, min, max of every feature of every history, encoded action]      what is not available is -1000
    y = base + sum_i tree_i(x)

Objects at the branch are such a window too, the nearest one last, beside their number.
Trees are kept as tables of nodes, so that prediction takes no scikit-learn. Trajectories are the training mean: the
model is made for selections, which read scalars alone.

Source: Friedman 2001 (boosting), Ke et al. 2017 (histograms); the summaries are this project's choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.runtime.environment import extra
from branchdrive_reference.learning.configuration import TreesConfig
from branchdrive_reference.learning.objects_network import object_parts
from branchdrive_reference.learning.outcome import Outcome

__all__ = ["TreesNetwork", "need_scikit_learn", "tree_rows"]

HISTORIES = ("state", "controls", "expert", "surroundings")
MASK_OF = {"surroundings": "surroundings_mask"}
ABSENT = -1000.0
"""In place of a summary that is not available."""

_NUM_TARGETS = len(TARGETS)
_SEED = 0


class TreesNetwork(nn.Module):
    """Sums of trees, one for each target; nodes ``[6, trees, nodes]``, a leaf being its own child."""

    base: Tensor
    feature: Tensor
    threshold: Tensor
    left: Tensor
    right: Tensor
    value: Tensor
    trajectories: Tensor
    reads: tuple[str, ...] = ("actions",)

    def __init__(self, config: TreesConfig) -> None:
        super().__init__()
        self._config = config
        shape = (_NUM_TARGETS, config.iterations, 2 * config.leaves - 1)
        self.register_buffer("base", torch.zeros(_NUM_TARGETS, dtype=torch.float64))
        for name in ("threshold", "value"):
            self.register_buffer(name, torch.zeros(shape, dtype=torch.float64))
        for name in ("feature", "left", "right"):
            self.register_buffer(name, torch.zeros(shape, dtype=torch.int64))
        path = (FUTURE_OBSERVATIONS, len(TRAJECTORY))
        self.register_buffer("trajectories", torch.zeros(path, dtype=torch.float64))

    def fit(self, data: Mapping[str, Tensor]) -> None:
        """Fit to training groups; a target without an available value is 0.

        Args:
            data: Normalised inputs and outcomes of `BranchGroupDataset.tensors`.

        Raises:
            PlatformError: The extra is not installed.
        """
        need_scikit_learn()
        from sklearn.ensemble import HistGradientBoostingRegressor
        from threadpoolctl import threadpool_limits

        rows = tree_rows(data).numpy()
        for target in range(_NUM_TARGETS):
            there = data["mask"][..., target].reshape(-1).numpy()
            wanted = data["scalars"][..., target].reshape(-1).double().numpy()
            if not there.any():
                continue
            model = HistGradientBoostingRegressor(
                max_iter=self._config.iterations,
                max_leaf_nodes=self._config.leaves,
                learning_rate=self._config.learning_rate,
                min_samples_leaf=self._config.min_rows,
                early_stopping=False,
                random_state=_SEED,
            )
            with threadpool_limits(1):
                model.fit(rows[there], wanted[there])
            self.base[target] = float(np.ravel(model._baseline_prediction)[0])
            for number, (tree,) in enumerate(model._predictors):
                self._keep(target, number, tree.nodes)
        self.trajectories.copy_(data["trajectory"].double().mean((0, 1)))

    def _keep(self, target: int, number: int, nodes: NDArray[Any]) -> None:
        """Keep a tree of scikit-learn."""
        own, is_leaf = np.arange(len(nodes)), nodes["is_leaf"].astype(bool)
        columns = {
            "feature": np.where(is_leaf, 0, nodes["feature_idx"]),
            "threshold": np.where(is_leaf, 0.0, nodes["num_threshold"]),
            "left": np.where(is_leaf, own, nodes["left"]),
            "right": np.where(is_leaf, own, nodes["right"]),
            "value": np.where(is_leaf, nodes["value"], 0.0),
        }
        for name, values in columns.items():
            buffer = getattr(self, name)
            buffer[target, number, : len(nodes)] = torch.from_numpy(np.asarray(values)).to(buffer.dtype)

    def forward(self, inputs: Mapping[str, Tensor], *, num_groups: int, num_candidates: int) -> Outcome:
        """Predictions of every candidate of every group; see `OutcomeNetwork`."""
        rows = tree_rows(inputs)
        found = [self._target(rows, target) for target in range(_NUM_TARGETS)]
        scalars = torch.stack(found, dim=-1).reshape(num_groups, num_candidates, _NUM_TARGETS)
        return Outcome(scalars, self.trajectories.expand(num_groups, num_candidates, -1, -1))

    def _target(self, rows: Tensor, target: int) -> Tensor:
        """Predictions of one target ``[rows]``."""
        total = self.base[target].expand(len(rows)).clone()
        last = self.value.shape[2] - 1
        for feature, threshold, left, right, value in zip(
            *(getattr(self, name)[target] for name in ("feature", "threshold", "left", "right", "value")), strict=True
        ):
            place = torch.zeros(len(rows), dtype=torch.int64, device=rows.device)
            for _ in range(self._config.leaves):  # no leaf is deeper
                column = feature[place].clamp(0, rows.shape[1] - 1)
                is_left = rows.gather(1, column[:, None])[:, 0] <= threshold[place]
                onwards = torch.where(is_left, left[place], right[place]).clamp(0, last)
                if torch.equal(onwards, place):
                    break
                place = onwards
            total += value[place]
        return total


def need_scikit_learn() -> None:
    """Make sure that trees can be fitted; fitted ones predict without.

    Raises:
        PlatformError: The extra is not installed.
    """
    with extra("trees", of="boosted trees"):
        import sklearn.ensemble  # noqa: F401
        import threadpoolctl  # noqa: F401


def tree_rows(inputs: Mapping[str, Tensor]) -> Tensor:
    """What the trees read, float64 ``[groups * candidates, features]``, candidates of a group one after another."""
    parts = [] if "objects" not in inputs else [_objects(inputs["objects"], inputs["objects_mask"])]
    for name in HISTORIES:
        if name in inputs:
            values = inputs[name].float().double()
            there = inputs[MASK_OF[name]] if name in MASK_OF else torch.ones_like(values, dtype=torch.bool)
            parts.append(_summaries(values, there))
    contexts, actions = torch.cat(parts, dim=1), inputs["actions"].float().double()
    num_candidates = len(actions)
    return torch.cat([contexts.repeat_interleave(num_candidates, 0), actions.repeat(len(contexts), 1)], dim=1)


def _objects(objects: Tensor, mask: Tensor) -> Tensor:
    """Summaries of the objects at the branch, the nearest one last, and how many there are: ``[B, 4 * 14 + 1]``."""
    parts, there = object_parts(objects[:, -1].float().double()), mask[:, -1]
    far = torch.where(there, parts[..., -2], torch.inf)
    order = torch.argsort(far, dim=1, descending=True, stable=True)
    parts = parts.gather(1, order[..., None].expand_as(parts))
    there = there.gather(1, order)[..., None].expand_as(parts)
    return torch.cat([_summaries(parts, there), mask[:, -1].sum(1, keepdim=True).double()], dim=1)


def _summaries(values: Tensor, there: Tensor) -> Tensor:
    """Last, mean, least and greatest available value of windows ``[B, T, F]``: ``[B, 4 F]``."""
    num_rows = values.shape[1]
    place = torch.arange(num_rows, device=values.device)[None, :, None]
    last = torch.where(there, place, -1).amax(1)
    at_last = values.gather(1, last.clamp(min=0)[:, None])[:, 0]
    mean = torch.where(there, values, 0.0).sum(1) / there.sum(1).clamp(min=1)
    least, greatest = torch.where(there, values, torch.inf).amin(1), torch.where(there, values, -torch.inf).amax(1)
    return torch.cat([torch.where(last >= 0, one, ABSENT) for one in (at_last, mean, least, greatest)], dim=1)
