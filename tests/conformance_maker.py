"""Makes conformance cases in a scratch folder: drafts on disk, recipes between them and bases, reports on them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
from tests.conformance_bases import BASES, draft_of
from tests.mutation import Draft
from tests.recipes.difference import manifest_edits, recipe_between, templated, tree
from tests.recipes.table_difference import equal_tables
from tests.validator.engine.rules.case import judged_folder
from tests.validator.engine.rules.release import ReleaseDraft, built

from branchdrive.contract.layout import LEAKAGE_FILE, MANIFEST_FILE
from branchdrive.engine.report import Report
from branchdrive.engine.waiver import load_waivers
from branchdrive.errors import UsageError
from branchdrive.leakage.verify import value_mismatches
from branchdrive_conformance.archive import BASES_FILE, base_files
from branchdrive_conformance.case import (
    MAX_LOCATIONS,
    Case,
    Expectation,
    Outcome,
)
from branchdrive_conformance.materialize import DATASET_DIR, RAW_DIR, WAIVERS_FILE, lay_out_base, materialize
from branchdrive_conformance.recipe import apply_recipe, sealed_digests
from branchdrive_conformance.table_operation import read_table

__all__ = ["Maker", "expectation", "same_files"]

_DELETION_BYTES = 60
"""Characters of an operation that deletes a file."""

_MAX_OWN_BYTES = 600
"""Recipes up to this size are told against the base that the draft is of."""


def expectation(report: Report, free: frozenset[str] = frozenset()) -> Expectation:
    """What a report says, as a case expects it."""
    assert not report.errors, report.errors
    rules = {}
    for tally in report.tallies:
        places = [dict(finding.location) for finding in tally.findings[:MAX_LOCATIONS]]
        status = tally.status
        rules[tally.rule_id] = (
            Outcome(status, tally.num_findings, tuple(places)) if status == "fail" else Outcome(status)
        )
    return Expectation(report.verdict, rules, free)


class Maker:
    """Makes cases in a scratch folder.

    Attributes:
        folder: Folder of the cases.
        scratch: A folder of this process alone.
    """

    def __init__(self, folder: Path, scratch: Path) -> None:
        _take_stored_audit(folder)
        self.folder, self.scratch = folder, scratch
        self._written: dict[str, Path] = {}
        self._stored: dict[str, Path] = {}

    def fresh(self, name: str) -> Path:
        """A folder that does not exist, in one that does."""
        place = self.scratch / name
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        return place / DATASET_DIR

    def written_base(self, base: str) -> Path:
        """The base as the draft writes it now."""
        if base not in self._written:
            root = draft_of(BASES[base][0]).write(self.fresh(f"base-{base}"))
            self._written[base] = root.with_name(RAW_DIR) if base == "release-raw" else root
        return self._written[base]

    def stored_base(self, base: str) -> Path:
        """The base as it is stored."""
        if base not in self._stored:
            self._stored[base] = self.fresh(f"stored-{base}")
            lay_out_base(self.folder, base, self._stored[base])
        return self._stored[base]

    def drafted(self, draft: Draft) -> tuple[Path, Path]:
        """The draft as it is sealed, and as it is in the end."""
        late, draft._sealed = draft._sealed, []
        sealed = draft.write(self.fresh("sealed"))
        draft._sealed = late
        return sealed, draft.write(self.fresh("draft")) if late else sealed

    def recipe(self, base: str, sealed: Path, final: Path, *, is_sealed: bool) -> list[Mapping[str, Any]]:
        """Operations that lead from a base to a dataset, as it is sealed and as it is in the end."""
        found = recipe_between(self.stored_base(base), sealed)
        found.append({"op": "seal"} if is_sealed else {"op": "delete", "path": MANIFEST_FILE})
        if final != sealed:
            found += recipe_between(sealed, final, takes_rows=False)
            if is_sealed and not (final / MANIFEST_FILE).exists():
                found.append({"op": "delete", "path": MANIFEST_FILE})
            elif is_sealed and (final / MANIFEST_FILE).read_bytes() != (sealed / MANIFEST_FILE).read_bytes():
                found.append({"op": "manifest", "edits": manifest_edits(sealed, final)})
        return found

    def nearest(self, base: str, changed: Path) -> str:
        """The base that differs least from a dataset; the one that its draft is of, if it differs little more."""
        found = {other: _distance(self.stored_base(other), changed) for other in BASES}
        near = min(found, key=lambda other: found[other])
        return near if 5 * found[near] < 4 * found[base] else base

    def _laid_out(self, name: str, base: str, recipe: Sequence[Mapping[str, Any]]) -> Path:
        root = self.fresh(name)
        lay_out_base(self.folder, base, root)
        apply_recipe(recipe, root)
        return root

    def rewritten(self, case: Case) -> Case:
        """A stored case with a recipe that is found again; its dataset, and so what is said of it, stays."""
        if _text_length(case) <= _MAX_OWN_BYTES:
            return case
        parts = {"dataset": (case.base, case.recipe), "dataset-raw": ("release-raw", case.raw or ())}
        made: dict[str, tuple[str, Any]] = {}
        for name, (base, recipe) in parts.items():
            if not recipe:
                continue
            is_sealed = {"op": "seal"} in recipe
            end: Mapping[str, Any] = {"op": "seal"} if is_sealed else {"op": "delete", "path": MANIFEST_FILE}
            stop = recipe.index(end)
            is_late = len(recipe) > stop + 1
            # A manifest follows from the files; where nothing follows it, none is made.
            sealed = self._laid_out("sealed", base, recipe[: stop + is_late])
            final = self._laid_out("draft", base, recipe) if is_late else sealed
            near = self.nearest(base, sealed) if name == "dataset" else base
            made[name] = near, self.recipe(near, sealed, final, is_sealed=is_sealed)
            new = made[name][1] if is_late else made[name][1][:-1]
            if not same_files(
                self._laid_out("check", made[name][0], new), final, but=() if is_late else (MANIFEST_FILE,)
            ):
                raise AssertionError("its recipe does not lead to its dataset")
        base, recipe = made["dataset"]
        raw = made["dataset-raw"][1] if "dataset-raw" in made else case.raw
        new = replace(case, base=base, recipe=recipe, raw=raw)
        return min((case, new), key=_text_length)

    def judged(self, case: Case) -> Report:
        """The validator's report on a case as it is laid out."""
        target = self.fresh("judged").parent
        target.rmdir()
        materialize(self.folder, case, target)
        options: dict[str, Any] = {"hash_files": case.options.get("hash", True)}
        if "waivers" in case.options:
            options["waivers"] = load_waivers(target / WAIVERS_FILE)
        return judged_folder(target / DATASET_DIR, raw=target / RAW_DIR if case.raw is not None else None, **options)

    def same(self, case: Case, draft: Draft) -> bool:
        """Whether a case makes the dataset of a draft: the same files with the same content."""
        target = self.fresh("stored").parent
        target.rmdir()
        try:
            materialize(self.folder, case, target)
        except UsageError:
            return False  # its recipe fits another state of the base
        _, final = self.drafted(draft)
        beside = draft.raw_root(final) if isinstance(draft, ReleaseDraft) else None
        if (beside is None) != (case.raw is None):
            return False
        pairs = [(target / DATASET_DIR, final), *([(target / RAW_DIR, beside)] if beside else [])]
        return all(same_files(one, other) for one, other in pairs)


def _take_stored_audit(folder: Path) -> None:
    """Let drafts have the audit of leakage that is stored, if that of this processor agrees with it.

    Digests of all that names a release follow from its last bits.
    """
    if (folder / BASES_FILE).is_file() and (content := base_files(folder)["release"].get(LEAKAGE_FILE)):
        stored, documents = json.loads(content), built().documents
        if not any(value_mismatches("", stored, documents[LEAKAGE_FILE])):
            documents[LEAKAGE_FILE] = stored


def _text_length(case: Case) -> int:
    return len(json.dumps([case.recipe, case.raw]))


def _distance(base: Path, changed: Path) -> int:
    """Bytes of the files in which a dataset differs from a base; those that are deleted count little."""
    total = 0
    for path in {*tree(base), *tree(changed)} - {MANIFEST_FILE}:
        one, other = base / path, changed / path
        if not (one.is_file() and other.is_file()):
            total += other.stat().st_size if other.is_file() else _DELETION_BYTES
        elif one.stat().st_size != other.stat().st_size or one.read_bytes() != other.read_bytes():
            total += other.stat().st_size
    return total


def same_files(one: Path, other: Path, *, but: Collection[str] = ()) -> bool:
    """Whether two folders hold the same.

    Tables are compared by their cells, manifests by what they say of the files beside them, and figures of an audit of
    leakage within the tolerance of its rules, since the last bits of what is fitted depend on the processor.
    """
    first, second = ({path: entry for path, entry in tree(root).items() if path not in but} for root in (one, other))
    return first == second and all(
        _same_content(one, other, path) for path, (kind, _) in first.items() if kind == "file"
    )


def _same_content(one: Path, other: Path, path: str) -> bool:
    first, second = ((root / path).read_bytes() for root in (one, other))
    if first == second:
        return True
    if path == MANIFEST_FILE:
        try:
            return templated(one, sealed_digests(one)) == templated(other, sealed_digests(other))
        except UnicodeDecodeError:
            return False
    if path == LEAKAGE_FILE:
        return not any(value_mismatches("", json.loads(first), json.loads(second)))
    if not path.endswith(".parquet"):
        return False
    try:
        return equal_tables(read_table(first), read_table(second))
    except (OSError, pa.ArrowException):
        return False
