"""Model rules: inputs and targets of the frozen population recompute.

Source: paper, "Model Inputs and Targets" and "Release Structure"; spec/12-model.md.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping

import numpy as np

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import DeclaredEncoding
from branchdrive.contract.encoding import ENCODING_NAME
from branchdrive.contract.layer import LAYERS, table_path
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.contract.timing import FUTURE_OBSERVATIONS
from branchdrive.driving.feature import SENSOR_PROFILE
from branchdrive.driving.target import TARGETS, TRAJECTORY
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import (
    columns_agree,
    differs,
    document_check,
    format_cell,
    frames_agree,
    place,
    rows_agree,
    rows_are,
    text_mismatches,
)
from branchdrive.layers.view import ReleaseView
from branchdrive.model.arrays import ModelArrays, joined_arrays, pack_arrays
from branchdrive.model.features import HISTORIES, feature_mismatches, target_mask
from branchdrive.model.normalisation_document import normalisation_mismatches
from branchdrive.model.objects import OBJECTS
from branchdrive.model.rows import action_rows, context_rows
from branchdrive.quality.partition import assignment_of
from branchdrive.quality.rules.split import SPLIT
from branchdrive.tables.frame import Frame, align, num_rows, take, with_homes

FEATURES = "model/features.json"
NORMALISATION = "model/normalisation.json"
ENDINGS = "endings"


def _contexts(view: ReleaseView) -> Frame:
    return context_rows(view.frame("group_quality"), view.frame("records"))


def context_groups(view: ReleaseView) -> list[str]:
    """Groups of the contexts, in stored order."""
    groups: list[str] = view.frame("contexts")["group_id"].tolist()
    return groups


@rule("BD-MOD-001")
def contexts_are_the_frozen_population(view: ReleaseView) -> Iterator[Check]:
    """One context for every core-valid group that is no near duplicate, and no other."""
    expected, found = _contexts(view), view.frame("contexts")
    pairs = align(expected, found, ("group_id",))
    yield from rows_are(view, "contexts", expected, found, pairs)


@rule("BD-MOD-002")
def contexts_repeat_the_other_layers(view: ReleaseView) -> Iterator[Check]:
    """Partition, scenario, town, cluster, nominal and validity of a context."""
    expected, found = _contexts(view), view.frame("contexts")
    pairs = align(expected, found, ("group_id",))
    columns = [column.name for column in LAYER_TABLES["contexts"].columns if column.name != "group_id"]
    yield from frames_agree(view, "contexts", columns, expected, found, pairs.expected, pairs.found)


@rule("BD-MOD-021")
def rows_name_the_partition_of_their_group(view: ReleaseView) -> Iterator[Check]:
    """The partition of every row is the one that the split gives its group; that of contexts is BD-MOD-002's."""
    homes = _assignment(view)
    for name, table in LAYERS["model"].tables.items():
        if table.partitions and name != "contexts" and (view.has(name) or not table.optional):
            frame = view.frame(name)
            expected = with_homes({"group_id": frame["group_id"], "row": np.arange(num_rows(frame))}, homes)
            left, right = np.arange(num_rows(expected)), np.ma.getdata(expected["row"])
            yield from frames_agree(view, name, ("partition",), expected, frame, left, right)


def _cross(axes: Mapping[str, list[object]]) -> Frame:
    """Every combination of the labels of several key columns."""
    sizes = [len(labels) for labels in axes.values()]
    places = np.unravel_index(np.arange(int(np.prod(sizes))), sizes) if all(sizes) else [np.zeros(0, int)] * len(sizes)
    columns = {}
    for (name, labels), at in zip(axes.items(), places, strict=True):
        kind = object if labels and isinstance(labels[0], str) else np.int64
        columns[name] = np.array(labels, kind)[at] if labels else np.zeros(0, kind)
    return columns


def _complete(view: ReleaseView, table: str, axes: Mapping[str, list[object]]) -> Iterator[Check]:
    expected, found = with_homes(_cross(axes), view.homes), view.frame(table)
    pairs = align(expected, found, LAYER_TABLES[table].key)
    yield from rows_are(view, table, expected, found, pairs)


@rule("BD-MOD-003")
def histories_are_complete(view: ReleaseView) -> Iterator[Check]:
    """Observations at -75 .. 0 and controls at -80 .. -1 of every context, and no row beside them.

    Where no evidence is claimed, there are no surroundings at all.
    """
    for table, history in HISTORIES.items():
        is_there = table != "surroundings" or "actor_risk_evidence" in view.descriptor.streams
        groups = context_groups(view) if is_there else []
        yield from _complete(view, table, {"group_id": [*groups], "offset_ticks": [*history.offsets]})


@rule("BD-MOD-004")
def candidates_are_complete(view: ReleaseView) -> Iterator[Check]:
    """Every action of the bank, and every step of its trajectory, for every context."""
    axes: dict[str, list[object]] = {
        "group_id": [*context_groups(view)],
        "action_key": [*view.descriptor.action_bank.keys],
    }
    for table in ("candidates", "scalars", *([ENDINGS] if view.has(ENDINGS) else [])):
        yield from _complete(view, table, axes)
    yield from _complete(view, "trajectories", {**axes, "step": [*range(1, FUTURE_OBSERVATIONS + 1)]})


def _values(table: str) -> list[str]:
    return [column.name for column in LAYER_TABLES[table].value_columns]


_RECORDED = tuple(f.name for f in SENSOR_PROFILE.state if f.columns == (f.name,) or not f.normalised)
"""State variables without arithmetic: recorded columns, and which command was recorded."""


@rule("BD-MOD-005")
def state_recomputes(view: ReleaseView) -> Iterator[Check]:
    """The 21 variables, from observations of the nominal at ``t_b - 80 .. t_b``; recorded ones to the bit."""
    yield from columns_agree(view, "state", _values("state"), exact=_RECORDED)


@rule("BD-MOD-006")
def past_controls_recompute(view: ReleaseView) -> Iterator[Check]:
    """Controls that reached the vehicle at ``t_b - 80 .. t_b - 1``, to the bit."""
    yield from columns_agree(view, "past_controls", _values("past_controls"), exact=_values("past_controls"))


@rule("BD-MOD-007")
def expert_recomputes(view: ReleaseView) -> Iterator[Check]:
    """What the privileged expert computed before the branch, to the bit."""
    yield from columns_agree(view, "expert", _values("expert"), exact=_values("expert"))


@rule("BD-MOD-008")
def surroundings_recompute(view: ReleaseView) -> Iterator[Check]:
    """Privileged evidence before the branch, to the bit."""
    yield from columns_agree(view, "surroundings", _values("surroundings"), exact=_values("surroundings"))


@rule("BD-MOD-009")
def actions_are_the_bank(view: ReleaseView) -> Iterator[Check]:
    """Keys, order, families and the bit-exact encoding of the bank; one of the dataset's own has its digest."""
    declared = view.descriptor.action_encoding
    is_own = declared is not None and declared.name != ENCODING_NAME
    recomputes = declared is not None and not is_own
    expected, found = action_rows(view.descriptor.action_bank, encoded=recomputes), view.frame("actions")
    pairs = align(expected, found, ("action_key",))
    yield from rows_are(view, "actions", expected, found, pairs)
    columns = ("position", "family", "encoded")[: 2 if is_own else 3]
    yield from frames_agree(view, "actions", columns, expected, found, pairs.expected, pairs.found)
    if declared is not None and is_own:
        yield _own_encoding(declared, take(found, pairs.found[np.argsort(pairs.expected)]))
        return
    wrong = [
        int(row)
        for at, row in zip(pairs.expected, pairs.found, strict=True)
        if vector_bytes(expected["encoding"][at]) != vector_bytes(found["encoding"][row])
    ]
    yield Check.of(
        len(pairs.found),
        [
            Mismatch(place(view, "actions", found, row, "encoding"), "the vector of its policy", "another vector")
            for row in wrong
        ],
    )


def _own_encoding(declared: DeclaredEncoding, actions: Frame) -> Check:
    """An encoding of the dataset's own is left out whole, or its matrix has the declared width and digest.

    Args:
        declared: What the descriptor says of it.
        actions: Rows of `actions` in the order of the bank.

    Raises:
        PreconditionError: It is left out.
    """
    where: Location = {"file": table_path("actions"), "table": "actions", "column": "encoding"}
    there = np.flatnonzero(~np.ma.getmaskarray(actions["encoding"]))
    if not len(there):
        raise PreconditionError(f"the release leaves out the encoding {quote(declared.name)} that it declares")
    vectors = [np.asarray(actions["encoding"][row], np.float64) for row in there.tolist()]
    shape, widths = f"{len(actions['encoding'])} vectors of {declared.width} numbers", {len(v) for v in vectors}
    if len(vectors) < len(actions["encoding"]) or widths != {declared.width}:
        found = f"{len(vectors)} vectors of {' or '.join(map(str, sorted(widths)))} numbers"
        return Check.of(1, [Mismatch(where, shape, found)])
    matrix = np.stack(vectors).astype("<f4")
    digest = hashlib.sha256(matrix.tobytes()).hexdigest()
    if digest != declared.sha256:
        return Check.of(1, [Mismatch(where, f"a matrix of digest {declared.sha256}", digest)])
    inexact = differs(np.stack(vectors).ravel(), matrix.astype(np.float64).ravel(), exact=True).any()
    return Check.of(1, [Mismatch(where, "float32 numbers", "numbers of more digits")] if inexact else [])


def vector_bytes(cell: object) -> bytes | None:
    """Bytes of an encoding, ``None`` where it is null."""
    return None if cell is np.ma.masked or cell is None else np.asarray(cell, np.float64).tobytes()


@rule("BD-MOD-010")
def candidates_are_the_records(view: ReleaseView) -> Iterator[Check]:
    """The executed rollout of a candidate is the one that its canonical record names."""
    candidates, records = view.frame("candidates"), view.frame("records")
    pairs = align(records, candidates, LAYER_TABLES["records"].key)
    yield Check.of(
        0,
        [
            Mismatch(place(view, "candidates", candidates, int(row)), "a canonical record", "none")
            for row in pairs.extra
        ],
    )
    expected = {"rollout_id": np.ma.filled(records["rollout_id"], "none")}
    yield from frames_agree(view, "candidates", ("rollout_id",), expected, candidates, pairs.expected, pairs.found)


@rule("BD-MOD-011")
def branch_poses_recompute(view: ReleaseView) -> Iterator[Check]:
    """Where a candidate's own branch pose lies in the frame of the nominal's."""
    yield from columns_agree(view, "candidates", ("offset_x_m", "offset_y_m", "offset_yaw_rad"))


_SMALLEST = ("min_ttc_s", "min_separation_m")
"""Targets without arithmetic: one of the recorded numbers."""

_MASKS = tuple(target_mask(target.name) for target in TARGETS)


@rule("BD-MOD-012")
def scalar_targets_recompute(view: ReleaseView) -> Iterator[Check]:
    """The six scalar targets, wherever raw and release agree that they are available."""
    expected, found, pairs = view.expected("scalars"), view.frame("scalars"), view.aligned("scalars")
    left, right = take(expected, pairs.expected), dict(take(found, pairs.found))
    for target in TARGETS:
        both = left[target_mask(target.name)] & right[target_mask(target.name)]
        values = np.where(both, np.ma.getdata(right[target.name]), np.ma.getdata(left[target.name]))
        right[target.name] = np.ma.masked_array(values, np.ma.getmaskarray(left[target.name]))
    names = [target.name for target in TARGETS]
    differing = np.stack([differs(left[name], right[name], exact=name in _SMALLEST) for name in names], axis=1)
    bad = np.flatnonzero(differing.any(axis=1))

    def mismatch(row: int) -> Mismatch:
        name = names[int(np.argmax(differing[row]))]
        return Mismatch(
            place(view, "scalars", right, row, name), format_cell(left[name][row]), format_cell(right[name][row])
        )

    yield Check(len(differing), bad, mismatch)


@rule("BD-MOD-013")
def target_masks_recompute(view: ReleaseView) -> Iterator[Check]:
    """A target is available exactly where the raw layer gives it."""
    yield from columns_agree(view, "scalars", _MASKS)


@rule("BD-MOD-014")
def trajectories_recompute(view: ReleaseView) -> Iterator[Check]:
    """Ten steps in the frame of the rollout's own branch pose; recorded speeds to the bit."""
    yield from columns_agree(view, "trajectories", TRAJECTORY, exact=("speed_mps",))


@rule("BD-MOD-022")
def endings_recompute(view: ReleaseView) -> Iterator[Check]:
    """What was recorded of whole drives, masks included, to the bit; a release may do without."""
    if view.has(ENDINGS):
        yield from columns_agree(view, ENDINGS, _values(ENDINGS), exact=_values(ENDINGS))


@rule("BD-MOD-023")
def objects_recompute(view: ReleaseView) -> Iterator[Check]:
    """What sensors tell of actors up to the branch, every object and no other, to the bit; a release may do without."""
    if view.has(OBJECTS):
        yield from rows_agree(view, OBJECTS)
        yield from columns_agree(view, OBJECTS, _values(OBJECTS), exact=_values(OBJECTS))


@rule("BD-MOD-015")
def displacement_is_the_last_step(view: ReleaseView) -> Iterator[Check]:
    """The displacement of a candidate is x of its last step."""
    scalars, steps = view.frame("scalars"), view.frame("trajectories")
    last = take(steps, steps["step"] == FUTURE_OBSERVATIONS)
    pairs = align(last, scalars, LAYER_TABLES["scalars"].key)
    there = scalars["displacement_available"][pairs.found]
    left, right = pairs.expected[there], pairs.found[there]
    wrong = differs(last["x_m"][left], np.ma.getdata(scalars["displacement_m"])[right])

    def mismatch(i: int) -> Mismatch:
        where = place(view, "scalars", scalars, int(right[i]), "displacement_m")
        return Mismatch(where, format_cell(last["x_m"][left[i]]), format_cell(scalars["displacement_m"][right[i]]))

    yield Check(len(wrong), np.flatnonzero(wrong), mismatch)


@rule("BD-MOD-016")
def media_indices_recompute(view: ReleaseView) -> Iterator[Check]:
    """Images of the nominal rollout before its branch."""
    expected, found, pairs = view.expected("media_index"), view.frame("media_index"), view.aligned("media_index")
    yield from rows_are(view, "media_index", expected, found, pairs)
    yield from columns_agree(view, "media_index", _values("media_index"))


@rule("BD-MOD-017")
def features_are_specified(view: ReleaseView) -> Iterator[Check]:
    """Features with their tracks, candidate order, contracts and arrays."""
    yield document_check(FEATURES, 1, feature_mismatches(view.document(FEATURES), view.descriptor))


def packed(view: ReleaseView) -> ModelArrays:
    """Arrays of the stored rows, groups in sorted order: what a part gives for `model_arrays`.

    Raises:
        PreconditionError: A table is missing or incomplete.
    """
    tables = ("state", "past_controls", "expert", "surroundings", "actions", "scalars", "trajectories")
    try:
        return pack_arrays(
            {name: view.frame(name) for name in tables}, sorted(context_groups(view)), view.descriptor.action_bank.keys
        )
    except (DatasetError, ValueError) as error:
        raise PreconditionError(f"the model layer is incomplete: {error}") from error


def model_arrays(view: ReleaseView) -> ModelArrays:
    """Arrays of the stored model layer, groups in sorted order.

    Raises:
        PreconditionError: A table is missing or incomplete.
    """
    return view.merged(packed, joined_arrays)


def _assignment(view: ReleaseView) -> dict[str, str]:
    return assignment_of(view.frame("group_quality"))


@rule("BD-MOD-018", packed)
def normalisation_recomputes(view: ReleaseView) -> Iterator[Check]:
    """Scalings of histories and targets over the training groups of the frozen population alone."""
    document = view.document(NORMALISATION)
    mismatches = normalisation_mismatches(document, view.cached(model_arrays), _assignment(view))
    entries = sum(len(value) for value in document.values() if isinstance(value, list))
    judged = (found for found in mismatches if found.location["pointer"] != "/split_digest")
    yield document_check(NORMALISATION, entries, judged)


@rule("BD-MOD-019")
def normalisation_carries_the_split(view: ReleaseView) -> Iterator[Check]:
    """The split digest of the normalisation is that of the split."""
    digest, found = view.document(SPLIT)["digest"], view.document(NORMALISATION)["split_digest"]
    yield document_check(NORMALISATION, 1, text_mismatches("/split_digest", digest, found))
