"""Group rules: the bank is complete and its candidates share their context.

Source: paper, "Two-Pass Collection" and "Collection Integrity, Replay Fidelity, and Leakage";
spec/04-policies.md#bank, spec/05-raw-streams.md#group.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from branchdrive.contract.columns import TABLES
from branchdrive.contract.mismatch import Check, Location, Mask, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.raw.canonical_choice import Selection
from branchdrive.raw.motion.candidates import Contrary, drives_contrary, steers_contrary
from branchdrive.raw.motion.response import group_digests, responses
from branchdrive.raw.shard_view import ShardView
from branchdrive.tables.view import TableView


def _with_others(selection: Selection) -> Mask:
    """Groups with a chosen nominal, and with a chosen attempt that can be compared with it ``[groups]``."""
    others = (selection.chosen >= 0) & (selection.chosen != selection.nominal[:, None])
    return np.asarray((selection.nominal >= 0) & others.any(axis=1))


@rule("BD-BNK-001")
def bank_is_complete(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
    """A complete attempt of every policy, the nominal included."""
    missing = selection.chosen < 0
    keys = np.array(view.descriptor.action_bank.keys)

    has_branch = np.isin(np.arange(len(view.group_ids)), view.group[view.branched])

    def describe(g: int) -> Mismatch:
        lacking = f"no complete attempt of {', '.join(keys[missing[g]])}" if has_branch[g] else "no branch"
        return Mismatch({}, f"all {len(keys)} policies", lacking, count=int(missing[g].sum()))

    yield Check.of_subjects(subjects, subjects & missing.any(axis=1), describe)


@rule("BD-BNK-002")
def one_nominal_serves_the_bank(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
    """Every chosen intervention was executed against the group's chosen nominal."""
    subjects = subjects & _with_others(selection)
    used = np.where(selection.chosen >= 0, view.nominal[selection.chosen], selection.nominal[:, None])
    foreign = used != selection.nominal[:, None]
    keys = np.array(view.descriptor.action_bank.keys)

    def describe(g: int) -> Mismatch:
        return Mismatch(
            {},
            f"nominal {quote(view.rollout_ids[selection.nominal[g]])} throughout",
            f"another nominal under {', '.join(keys[foreign[g]])}",
            count=int(foreign[g].sum()),
        )

    yield Check.of_subjects(subjects, subjects & foreign.any(axis=1), describe)


def _column_codes(table: TableView, column: str) -> NDArray[np.int64]:
    values = table[column]
    if TABLES["rollouts"][column].type == "string":
        codes, texts = table.categories(column)
        first = {text: texts.index(text) for text in set(texts)}
        return np.array([*(first[text] for text in texts), -1], np.int64)[codes]
    if values.dtype == object:
        seen: dict[bytes, int] = {}
        cells, rows = np.unique(table.cells(column), return_index=True)
        code_of = np.zeros(cells.max(initial=-1) + 1, np.int64)
        code_of[cells] = [seen.setdefault((values[row] + 0.0).tobytes(), len(seen)) for row in rows]
        return code_of[table.cells(column)]
    return np.unique(values, return_inverse=True)[1].astype(np.int64)


def _code_cache(_view: ShardView) -> dict[str, NDArray[np.int64]]:
    return {}


def _codes(view: ShardView, column: str) -> NDArray[np.int64]:
    """Equal codes for equal values of a rollouts column; null is a value of its own, zeros have no sign."""
    codes = view.cached(_code_cache)
    if column not in codes:
        codes[column] = np.where(view.rollouts.valid(column), _column_codes(view.rollouts, column), -1)
    return codes[column]


def _unlike(view: ShardView, column: str, nominal: int, other: int) -> tuple[str, str]:
    """Two values that differ, in words; of polylines, their first vertices that do, or their numbers."""
    values, valid = view.rollouts[column], view.rollouts.valid(column)
    if values.dtype != object or not (valid[nominal] and valid[other]) or isinstance(values[nominal], str):
        wanted, found = (quote(values[i]) if valid[i] else "null" for i in (nominal, other))
        return wanted, found
    ours, theirs = values[nominal], values[other]
    if len(ours) != len(theirs):
        return f"{len(ours)} vertices", f"{len(theirs)} vertices"
    vertex = int(np.argmax(ours != theirs))
    return f"{quote(ours[vertex])} at vertex {vertex}", f"{quote(theirs[vertex])} at vertex {vertex}"


def _shared(columns: Sequence[str]) -> Callable[[ShardView, Selection, Mask], Iterator[Check]]:
    def check(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
        subjects = subjects & _with_others(selection)
        own = selection.nominal[:, None]
        chosen = np.where(selection.chosen >= 0, selection.chosen, own)
        codes = np.stack([_codes(view, column) for column in columns])
        differs = codes[:, chosen] != codes[:, own]  # [columns, groups, policies]

        def describe(g: int) -> Mismatch:
            column_index, policy_index = np.argwhere(differs[:, g])[0]
            column, other = columns[column_index], chosen[g, policy_index]
            wanted, found = _unlike(view, column, int(selection.nominal[g]), int(other))
            place: Location = {
                "table": "rollouts",
                "column": column,
                "rollout_id": view.rollout_ids[other],
            }
            return Mismatch(place, f"{wanted} as in the nominal", found, int(differs[:, g].any(axis=0).sum()))

        yield Check.of_subjects(subjects, subjects & differs.any(axis=(0, 2)), describe)

    check.__doc__ = f"Chosen attempts agree with their nominal in {', '.join(columns)}."
    return check


_ROUTE = ("route_id", "route_x_m", "route_y_m")
_TOWN = ("town",)
_SEED = ("seed", "repetition")
_BRANCH = (
    "branch_tick",
    "branch_frame",
    "trigger_definition",
    "trigger_tick",
    "trigger_signal",
    "trigger_value",
    "trigger_threshold",
    "trigger_confidence",
)
_SCENARIO = ("scenario_type", "environment", "ego_length_m", "ego_width_m", "ego_height_m")

same_route = rule("BD-GRP-001")(_shared(_ROUTE))
same_town = rule("BD-GRP-002")(_shared(_TOWN))
same_seed = rule("BD-GRP-003")(_shared(_SEED))
same_branch = rule("BD-GRP-004")(_shared(_BRANCH))
same_scenario = rule("BD-GRP-005")(_shared(_SCENARIO))
same_variant = rule("BD-GRP-007")(_shared(("protocol_variant",)))
same_versions = rule("BD-GRP-008")(_shared(("simulator_version", "collector_version")))


@rule("BD-GRP-009")
def steering_and_braking_have_an_effect(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
    """No candidates of a moving vehicle that steer or brake otherwise, the nominal among them, have one future."""
    _, every = responses(view, selection, np.zeros(view.num_rollouts, bool))
    bank = view.descriptor.action_bank
    largest_last = sorted(every.copies(bank.nominal_index), key=lambda copy: (len(copy[1]), sorted(copy[1])))
    keys, shared = bank.keys, dict(largest_last)
    digests = view.cached(group_digests)
    found = [shared.get(group, ()) for group in digests.tolist()]
    subjects = subjects & np.isin(digests, every.group[every.moves])

    def describe(g: int) -> Mismatch:
        names = ", ".join(keys[policy] for policy in sorted(found[g]))
        place: Location = {"table": "observations"}
        return Mismatch(place, "a future of its own for each", f"one, to the millimetre, under {names}", len(found[g]))

    yield Check.of_subjects(subjects, subjects & np.array([len(policies) > 0 for policies in found], bool), describe)


def _ordered(
    view: ShardView, subjects: Mask, found: Contrary, text: Callable[[str, str, float], tuple[str, str]]
) -> Check:
    """Check of groups in which no two candidates end contrary to a command; the finding names the widest pair."""
    keys = view.descriptor.action_bank.keys
    widest = dict(zip(found.group[order := np.argsort(found.away_m, kind="stable")].tolist(), order, strict=True))
    num_pairs = np.bincount(found.group, minlength=len(view.group_ids))

    def describe(g: int) -> Mismatch:
        pair = widest[g]
        more, less = (keys[view.policy[attempt[pair]]] for attempt in (found.more, found.less))
        return Mismatch({"table": "observations"}, *text(more, less, float(found.away_m[pair])), int(num_pairs[g]))

    return Check.of_subjects(subjects & found.compared, subjects & (num_pairs > 0), describe)


@rule("BD-GRP-010")
def steering_moves_to_its_side(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
    """No candidate comes to the left of another before a contact where it alone steers to the right of it."""

    def text(more: str, less: str, away_m: float) -> tuple[str, str]:
        return (
            f"{more} to the right of {less}, where its recorded applied_steer points to the right of it",
            f"{away_m:.2f} m to the left of it; the sign of steering or the world may be mirrored",
        )

    yield _ordered(view, subjects, steers_contrary(view, selection), text)


@rule("BD-GRP-011")
def driving_moves_on(view: ShardView, selection: Selection, subjects: Mask) -> Iterator[Check]:
    """No candidate comes less far before a contact than another that steers much alike and drives less."""

    def text(more: str, less: str, away_m: float) -> tuple[str, str]:
        return (
            f"{more} as far as {less} or further, which has no more throttle less brake at any tick",
            f"{away_m:.2f} m less far, from the speed at the branch",
        )

    yield _ordered(view, subjects, drives_contrary(view, selection), text)


@rule("BD-GRP-006")
def replays_share_their_context(view: ShardView, subjects: Mask) -> Iterator[Check]:
    """A nominal replay agrees with its nominal in everything that candidates share."""
    subjects = subjects & view.role("nominal_replay") & (view.nominal >= 0)
    columns = (*_ROUTE, *_TOWN, *_SEED, *_BRANCH, *_SCENARIO)
    codes = np.stack([_codes(view, column) for column in columns])
    differs = codes != codes[:, view.nominal]  # [columns, rollouts]

    def describe(i: int) -> Mismatch:
        column = columns[int(np.argmax(differs[:, i]))]
        wanted, found = _unlike(view, column, int(view.nominal[i]), i)
        return Mismatch({"table": "rollouts", "column": column}, f"{wanted} as in the nominal", found)

    yield Check.of_subjects(subjects, subjects & differs.any(axis=0), describe)
