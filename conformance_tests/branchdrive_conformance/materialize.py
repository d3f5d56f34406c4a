"""Cases as plain datasets: base datasets are stored as files, of which a case changes some."""

from __future__ import annotations

import json
from pathlib import Path

from branchdrive.errors import UsageError
from branchdrive_conformance.archive import base_files
from branchdrive_conformance.case import Case, case_text
from branchdrive_conformance.recipe import apply_recipe

__all__ = ["CASE_FILE", "DATASET_DIR", "RAW_DIR", "WAIVERS_FILE", "lay_out_base", "materialize"]

CASE_FILE, DATASET_DIR, RAW_DIR, WAIVERS_FILE = "case.json", "dataset", "dataset-raw", "waivers.json"


def lay_out_base(folder: Path, base: str, root: Path) -> None:
    """Write the base dataset into the new folder `root`.

    One with a `parent` stands for the files of that base, without those that it deletes, and its own in their place.

    Args:
        folder: Folder of the cases.
        base: Name of the base.
        root: The new folder.

    Raises:
        UsageError: There is no such base.
    """
    for path, content in _files_of(folder, base).items():
        target = root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _files_of(folder: Path, base: str) -> dict[str, bytes]:
    description = folder / "bases" / f"{base}.json"
    if not description.is_file():
        raise UsageError(f"{folder} has no base dataset {base!r}")
    document = json.loads(description.read_bytes())
    inherited = _files_of(folder, document["parent"]) if document["parent"] is not None else {}
    kept = {path: content for path, content in inherited.items() if path not in document["delete"]}
    return {**kept, **base_files(folder).get(base, {})}


def materialize(folder: Path, case: Case, target: Path) -> None:
    """Write a case into the new folder `target`.

    It holds ``dataset``, ``case.json`` with all that is expected, and ``dataset-raw`` or ``waivers.json`` where the
    case has them.

    Raises:
        UsageError: The case does not fit its base.
    """
    target.mkdir(parents=True)
    parts = {DATASET_DIR: (case.base, case.recipe)}
    if case.raw is not None:
        parts[RAW_DIR] = ("release-raw", case.raw)
    for name, (base, recipe) in parts.items():
        lay_out_base(folder, base, target / name)
        try:
            apply_recipe(recipe, target / name)
        except (ValueError, KeyError, OSError) as error:
            raise UsageError(f"case {case.name} does not fit its base {base}: {error}") from error
    (target / CASE_FILE).write_text(case_text(case.to_json()), encoding="utf-8")
    if "waivers" in case.options:
        (target / WAIVERS_FILE).write_text(json.dumps(case.options["waivers"], indent=2) + "\n", encoding="utf-8")
