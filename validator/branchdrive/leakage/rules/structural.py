"""Structural leakage rules: histories, images, categories and identities tell nothing of outcomes and partitions.

Source: paper, "Collection Integrity, Replay Fidelity, and Leakage"; spec/13-leakage.md#structural.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import PROFILES, fit_scale, utility
from branchdrive.layers.compare import place_in_table
from branchdrive.layers.view import ReleaseView
from branchdrive.leakage.outcome import MAX_OUTCOME_CORRELATION, num_alone, outcome_codes, revealed_outcomes
from branchdrive.leakage.streams import DIFFERENT, camera_columns, examined_cameras, num_different
from branchdrive.leakage.structural import (
    ALPHA,
    MAX_CORRELATION,
    TargetLeak,
    affine_targets,
    neighbours_p,
    ranked_targets,
)
from branchdrive.model.features import HISTORIES
from branchdrive.model.rules.inputs import FEATURES, model_arrays, packed
from branchdrive.tables.frame import Frame, concat, take

Array: TypeAlias = NDArray[np.float64]

_PROFILE = "balanced"
"""Profile whose utility is an outcome too."""

_MIN_OF_CONTROLS = 30
"""Groups below which past controls are not asked for outcomes: a controller that switches passes through many orders
of a few groups, and outcomes of a world with little variety follow one of them."""

_MIN_SHARED = 60
"""Groups from which most of them share their category with another one."""


@dataclass(frozen=True)
class History:
    """Variables of histories.

    Attributes:
        values: ``[groups, variables]``, minus infinity where there is none.
        columns: The column that each variable is a time of, with its table ``[variables]``.
        names: Name of each variable ``[variables]``.
    """

    values: Array
    columns: list[str]
    names: list[str]

    def of(self, *tables: str) -> History:
        """Variables of some tables alone."""
        chosen = [v for v, column in enumerate(self.columns) if column.partition(" ")[0] in tables]
        columns, names = [self.columns[v] for v in chosen], [self.names[v] for v in chosen]
        return History(self.values[:, chosen], columns, names)


@rule("BD-LKG-008")
def identifiers_do_not_tell_the_partition(view: ReleaseView) -> Iterator[Check]:
    """Neighbours in the order of group ids share a partition no more often than chance has it."""
    groups = view.frame("group_quality")
    homes = dict(zip(groups["group_id"].tolist(), np.ma.filled(groups["partition"], "").tolist(), strict=True))
    ordered = [homes[group] for group in sorted(homes) if homes[group]]
    p = neighbours_p(ordered) if len(ordered) > 1 else 1.0
    place: Location = {**place_in_table(view, "group_quality"), "column": "group_id"}
    mismatches = [Mismatch(place, f"p above {ALPHA:g} that order and partition are unrelated", f"p = {p:.2g}")]
    yield Check.of(int(len(ordered) > 1), mismatches if p <= ALPHA else [])


def _history(view: ReleaseView) -> History:
    """Recorded variables of all histories but the surroundings, each at each of its times."""
    arrays = view.cached(model_arrays)
    tables = {"state": arrays.state, "past_controls": arrays.controls, "expert": arrays.expert}
    values = np.concatenate([table.reshape(len(arrays.groups), -1) for table in tables.values()], axis=1)
    columns, names = [], []
    for table in tables:
        for offset in HISTORIES[table].offsets:
            at = [f"{table} {feature.name}" for feature in HISTORIES[table].features]
            columns += at
            names += [f"{column} at tick {offset}" for column in at]
    recorded = np.flatnonzero(np.isfinite(values).any(axis=0)).tolist()
    return History(values[:, recorded], [columns[v] for v in recorded], [names[v] for v in recorded])


def _targets(view: ReleaseView) -> Targets:
    """Scalar targets ``[groups, actions, targets]``, 0 where not available."""
    values, available = view.cached(model_arrays).scalars
    return Targets(np.where(available, values, 0.0), available)


def _outcomes(view: ReleaseView) -> Targets:
    """Scalar targets and, behind them, the utility of the balanced profile, 0 where not available."""
    targets = _targets(view)
    worth = utility(targets, fit_scale(targets), PROFILES[_PROFILE])[..., None]
    is_there = np.isfinite(worth)
    return Targets(
        np.concatenate([targets.values, np.where(is_there, worth, 0.0)], axis=2),
        np.concatenate([targets.available, is_there], axis=2),
    )


_OUTCOMES = (*(f"the target {target.name}" for target in TARGETS), f"the utility of the profile {_PROFILE}")
"""Names in the order of `_outcomes`."""


def _variable_check(place: Location, expected: str, names: Sequence[str], found: list[TargetLeak]) -> Check:
    mismatches = [
        Mismatch({**place, "column": names[t.variable]}, expected, f"{t.how} of {_OUTCOMES[t.target]}") for t in found
    ]
    return Check.of(len(names), mismatches)


@rule("BD-LKG-009", packed)
def no_history_variable_ranks_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history ranks a target by itself."""
    history = view.cached(_history).of("state", "past_controls")
    found = ranked_targets(history.values, *_targets(view))
    yield _variable_check({"file": FEATURES}, f"a correlation of at most {MAX_CORRELATION:g}", history.names, found)


@rule("BD-LKG-010", packed)
def no_history_variable_holds_a_target(view: ReleaseView) -> Iterator[Check]:
    """No variable of a sensor history is an affine function of a target of one action."""
    history = view.cached(_history).of("state", "past_controls")
    speeds = [v for v, column in enumerate(history.columns) if column == "state speed_mps"]
    found = affine_targets(history.values, *_targets(view), speeds=speeds)
    yield _variable_check({"file": FEATURES}, "no affine function of a target", history.names, found)


def _outcome_check(
    view: ReleaseView, place: Location, examined: History, max_correlation: float = MAX_OUTCOME_CORRELATION
) -> Check:
    """Whether variables tell an outcome that does not follow from the state."""
    motion = view.cached(_history).of("state")
    targets = view.cached(_outcomes)
    found = revealed_outcomes(
        examined.values,
        examined.columns,
        *targets,
        motion=(motion.values, motion.columns),
        max_correlation=max_correlation,
    )
    expected = f"a correlation of at most {max_correlation:g}, of a place at most {MAX_CORRELATION:g}"
    return _variable_check(place, expected, examined.names, found)


@rule("BD-LKG-013", packed)
def no_history_variable_tells_an_outcome(view: ReleaseView) -> Iterator[Check]:
    """No state, past control or value of the expert ranks an outcome of one action, or of all actions of a group."""
    history = view.cached(_history)
    if len(history.values) < _MIN_OF_CONTROLS:
        history = history.of("state", "expert")
    yield _outcome_check(view, {"file": FEATURES}, history)


@rule("BD-LKG-014", packed)
def no_repetition_tells_an_outcome(view: ReleaseView) -> Iterator[Check]:
    """How many different values a column of a history has ranks no outcome."""
    history = view.cached(_history)
    columns = list(dict.fromkeys(history.columns))
    own = np.array(history.columns)
    counts = [num_different(history.values[:, own == column]) for column in columns]
    names = [f"{column} {DIFFERENT}" for column in columns]
    yield _outcome_check(view, {"file": FEATURES}, History(np.stack(counts, axis=1), names, names), MAX_CORRELATION)


def nominal_facts(view: ReleaseView) -> Frame:
    """What raw says about images and environments of the nominals of the contexts, in the order of their groups.

    Raises:
        PreconditionError: A context has no such row.
    """
    _, groups = view.raw_rows, view.cached(model_arrays).groups
    names = ("group_id", "nominal_images", "has_images", "environment", "dimensions")
    facts = concat([{name: replays[name] for name in names} for replays in view.raw_shards("replays")])
    row_of = {group: row for row, group in enumerate(facts["group_id"].tolist())}
    if not row_of.keys() >= {*groups}:
        raise PreconditionError("a context is no integrity-complete group of the raw layer")
    return take(facts, np.array([row_of[group] for group in groups], np.intp))


@rule("BD-LKG-015", packed)
def no_image_of_a_nominal_tells_an_outcome(view: ReleaseView) -> Iterator[Check]:
    """No size of an image in the history of a nominal ranks an outcome, and nothing that its pixels show.

    What pixels show is examined where the raw layer is available.
    """
    place: Location = {"table": "media_index"}
    yield _outcome_check(view, place, image_sizes(view))
    if view.raw.rows is None:
        return
    if not view.cached(nominal_facts)["has_images"].all():
        raise PreconditionError("not all images were decoded")
    yield _outcome_check(view, place, image_numbers(view))


def image_numbers(view: ReleaseView) -> History:
    """What the pixels of the images of nominals show, all of which were decoded."""
    columns = camera_columns(examined_cameras(view.descriptor))
    names = [c.name if c.offset_ticks is None else f"{c.name} at tick {c.offset_ticks}" for c in columns]
    numbers = view.cached(nominal_facts)["nominal_images"].astype(np.float64)
    return History(np.where(np.isnan(numbers), -np.inf, numbers), [c.name for c in columns], names)


def image_sizes(view: ReleaseView) -> History:
    """Sizes of the stored images of nominals."""
    groups, index = view.cached(model_arrays).groups, view.frame("media_index")
    row_of = {group: row for row, group in enumerate(groups)}
    axis = list(zip(index["camera"].tolist(), index["offset_ticks"].tolist(), strict=True))
    cells = sorted(set(axis))
    column_of = {cell: column for column, cell in enumerate(cells)}
    values = np.full((len(groups), len(cells)), -np.inf)
    rows = [row_of.get(group, -1) for group in index["group_id"].tolist()]
    values[rows, [column_of[cell] for cell in axis]] = index["size_bytes"]
    columns = [f"{camera} size_bytes" for camera, _ in cells]
    return History(values, columns, [f"{camera} size_bytes at tick {offset}" for camera, offset in cells])


def _category_check(view: ReleaseView, place: Location, categories: list[str]) -> Check:
    """Whether a category ``[groups]`` stands for an action, or for the group."""
    found = [
        Mismatch(place, "values that share no answer", f"{how} of {_OUTCOMES[target]}")
        for target, how in outcome_codes(categories, *view.cached(_outcomes))
    ]
    alone = num_alone(categories)
    if len(categories) >= _MIN_SHARED and 2 * alone > len(categories):
        found.append(Mismatch(place, "values that most groups share", f"{alone} of {len(categories)} groups alone"))
    return Check.of(len(categories), found[:1])


@rule("BD-LKG-016", packed)
def categories_are_no_code(view: ReleaseView) -> Iterator[Check]:
    """Scenario types, towns and, where raw is available, environments stand for no action and for no single group."""
    contexts = view.frame("contexts")
    order = np.argsort(contexts["group_id"], kind="stable")
    for column in ("scenario_type", "town"):
        yield _category_check(view, {"table": "contexts", "column": column}, contexts[column][order].tolist())
    if view.raw.rows is not None:
        place: Location = {"table": "rollouts", "column": "environment"}
        yield _category_check(view, place, view.cached(nominal_facts)["environment"].tolist())
