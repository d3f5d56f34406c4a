"""Rule on codes: nothing that precedes a branch stands for the action that turns out best.

Source: spec/13-leakage.md#codes.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.driving.target import TARGETS
from branchdrive.driving.utility import PROFILES, fit_scale, utility
from branchdrive.layers.view import ReleaseView
from branchdrive.leakage.cells import (
    Readings,
    readings_of_history,
    readings_of_numbers,
    readings_of_pair,
    readings_of_texts,
)
from branchdrive.leakage.code import Answers, Order, TooFewError, best_answers, codes
from branchdrive.leakage.replays import DIMENSIONS
from branchdrive.leakage.rules.structural import image_numbers, image_sizes, nominal_facts
from branchdrive.model.features import HISTORIES
from branchdrive.model.rules.inputs import FEATURES, model_arrays, packed
from branchdrive.tables.frame import take

_SAFEST = "min_separation_m"
"""Target whose largest value is asked for too."""

_TEXTS = ("group_id", "nominal_rollout_id", "scenario_type", "town")
_LABELS = ("scenario_type", "town", "environment")
_COUNTS = ("seed", "attempt", "repetition", "branch_tick", "branch_frame")


class _Column(NamedTuple):
    """A column that is examined: where it is, its readings, and an order that it gives."""

    place: Location
    readings: Readings
    order: Order | None = None


def _asked(view: ReleaseView) -> list[Answers]:
    """The best action by every profile, and the one that keeps the largest separation."""
    arrays = view.cached(model_arrays)
    values, available = arrays.scalars
    clusters = _contexts(view)["route_cluster"].tolist()
    scale = fit_scale(arrays.scalars)
    separation = [target.name for target in TARGETS].index(_SAFEST)
    asked = {
        f"the best action by the profile {name}": utility(arrays.scalars, scale, profile)
        for name, profile in PROFILES.items()
    }
    asked[f"the action with the largest {_SAFEST}"] = np.where(
        available[..., separation], values[..., separation], np.nan
    )
    return [best_answers(name, worth, clusters) for name, worth in asked.items()]


def _contexts(view: ReleaseView) -> dict[str, NDArray[np.generic]]:
    """Contexts in the order of the arrays."""
    contexts = view.frame("contexts")
    return take(contexts, np.argsort(contexts["group_id"], kind="stable"))


def _histories(view: ReleaseView) -> Iterator[_Column]:
    """Columns of all histories, and the flags of each table together."""
    arrays = view.cached(model_arrays)
    num_actions = len(arrays.candidates)
    tables = {"state": arrays.state, "past_controls": arrays.controls, "expert": arrays.expert}
    if arrays.surroundings is not None:
        tables["surroundings"] = arrays.surroundings.values
    for table, values in tables.items():
        times = [f"at tick {offset}" for offset in HISTORIES[table].offsets]
        columns = {f.name: values[..., place] for place, f in enumerate(HISTORIES[table].features)}
        flags = [column for column in columns.values() if np.isin(column, (0.0, 1.0)).all() and np.ptp(column) > 0]
        if len(flags) > 1:
            columns["flags together"] = np.tensordot(np.exp2(np.arange(len(flags))), np.array(flags), 1)
        for name, column in columns.items():
            yield _Column(
                {"file": FEATURES, "column": f"{table} {name}"}, readings_of_history(column, times, num_actions)
            )


def _images(view: ReleaseView) -> Iterator[_Column]:
    """Sizes of the stored images of nominals and, where raw is available, what their pixels show."""
    parts = [image_sizes(view)]
    if view.raw.rows is not None and view.cached(nominal_facts)["has_images"].all():
        parts.append(image_numbers(view))
    num_actions = len(view.cached(model_arrays).candidates)
    for images in parts:
        own = np.array(images.columns)
        for name in dict.fromkeys(images.columns):
            at = np.flatnonzero(own == name)
            times = [images.names[v].removeprefix(f"{name} ") for v in at.tolist()]
            readings = readings_of_history(images.values[:, at], times, num_actions)
            yield _Column({"table": "media_index", "column": name}, readings)


def _labels(view: ReleaseView) -> Iterator[_Column]:
    """Texts of a group, pairs of what it is called, and numbers of its nominal."""
    num_actions = len(view.cached(model_arrays).candidates)
    contexts, has_raw = _contexts(view), view.raw.rows is not None
    texts = {("contexts", name): contexts[name].tolist() for name in _TEXTS}
    if has_raw:
        texts["rollouts", "environment"] = view.cached(nominal_facts)["environment"].tolist()
    for (table, name), values in texts.items():
        order = (
            Order("its order", np.argsort(np.asarray(values, np.str_), kind="stable")) if name == "group_id" else None
        )
        yield _Column({"table": table, "column": name}, readings_of_texts(values, num_actions), order)
    named = {name: values for (_, name), values in texts.items() if name in _LABELS}
    for first, second in combinations(named, 2):
        place: Location = {"table": "contexts", "column": f"{first} and {second}"}
        yield _Column(place, readings_of_pair(named[first], named[second]))
    records = view.frame("records")
    row_of = {rollout: row for row, rollout in enumerate(records["rollout_id"].tolist())}
    rows = [row_of.get(rollout) for rollout in contexts["nominal_rollout_id"].tolist()]
    if None in rows:
        raise PreconditionError("the nominal of a context is in no record")
    of_nominals = take(records, np.array(rows, np.intp))
    for name in _COUNTS:
        numbers = [str(number) for number in np.ma.filled(of_nominals[name], -1).tolist()]
        yield _Column({"table": "records", "column": name}, readings_of_texts(numbers, num_actions))
    if has_raw:
        for name, sizes in zip(DIMENSIONS, view.cached(nominal_facts)["dimensions"].T, strict=True):
            yield _Column(
                {"table": "rollouts", "column": name},
                readings_of_numbers(sizes[:, None], ["of the nominal"], num_actions),
            )


@rule("BD-LKG-017", packed)
def nothing_is_a_code_of_the_best_action(view: ReleaseView) -> Iterator[Check]:
    """No value, pattern, repetition, label or identity has, wherever it stands again, the same best action."""
    places: list[Location] = []

    def examined() -> Iterator[tuple[Readings, Order | None]]:
        for columns in (_histories(view), _images(view), _labels(view)):
            for column in columns:
                places.append(column.place)
                yield column.readings, column.order

    try:
        found = codes(examined(), _asked(view))
    except TooFewError as reason:
        raise PreconditionError(str(reason)) from None
    mismatches = [
        Mismatch(places[code.column], "groups that show the same and differ in it", code.how) for code in found
    ]
    yield Check.of(len(places), mismatches)
