"""`make cases`: the registered defects and limits as conformance cases, each a file of its own.

Drafts are written to disk, compared with their base dataset, and kept as a recipe with what the validator says of the
result. A case that still makes the same dataset is left as it is, so that files do not depend on the version of the
library that writes Parquet; ``--check`` changes nothing and names what differs.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import pyarrow as pa
from rich.progress import track
from tests.mutation import BOUNDARIES, MUTANTS, Boundary, Draft, Mutant, new_draft
from tests.validator.engine.rules.case import Base, judged_folder
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.layout import MANIFEST_FILE
from branchdrive.contract.resources import SPEC_VERSION, load_resource
from branchdrive.contract.rule import CATALOGUE
from branchdrive.engine.report import Report
from branchdrive.engine.waiver import load_waivers
from branchdrive.errors import UsageError
from branchdrive.runtime.process import spawn_context
from branchdrive_conformance.archive import pack
from branchdrive_conformance.case import (
    MAX_LOCATIONS,
    Case,
    Expectation,
    Outcome,
    base_expectation,
    case_text,
    load_case,
)
from branchdrive_conformance.difference import equal_tables, manifest_edits, recipe_between, templated, tree
from branchdrive_conformance.materialize import DATASET_DIR, RAW_DIR, WAIVERS_FILE, lay_out_base, materialize
from branchdrive_conformance.recipe import read_table, sealed_digests

ROOT = Path(__file__).resolve().parents[1]
CASES = ROOT / "conformance_tests" / "cases" / f"v{SPEC_VERSION}"

BASES: dict[str, tuple[Base, str | None, str]] = {
    "raw": ("full", None, "three groups with actors and risk evidence"),
    "raw-media": ("media", "raw", "the same with camera frames"),
    "raw-map": ("map", "raw", "the same with a map"),
    "raw-bare": ("bare", "raw", "the same without actors and risk evidence"),
    "release": ("release", None, "a release in place: raw layer with media, all derived layers, an audit of leakage"),
    "release-raw": ("detached", "release", "the raw dataset beside a detached release"),
    "release-detached": ("alone", "release", "a release without its raw layer"),
    "release-benchmark": ("benchmark", "release", "a release in place with a benchmark"),
}
"""Base datasets: the draft that each is written from, the base that its files are stored against, and what it is."""

_BASE_OF: dict[Base, str] = {
    "full": "raw", "media": "raw-media", "map": "raw-map", "bare": "raw-bare", "release": "release",
    "detached": "release-detached", "alone": "release-detached", "benchmark": "release-benchmark",
}  # fmt: skip

_MAX_RECIPE_BYTES = 300_000
_LOT_CASES = 30

_ARMS: tuple[tuple[str, str, str, str, dict[str, Any]], ...] = (
    (
        "BD-VAL-002", "throttle_in_percent", "waived", "a failure that somebody accepted",
        {"waivers": {"waivers": [{
            "rule": "BD-VAL-002", "location": "*", "reason": "accepted to show what a waiver does",
            "expires": "2199-12-31", "max_count": 100,
        }]}},
    ),
    (
        "BD-LAY-002", "", "digests_not_compared", "a dataset whose digests are not compared is valid in part",
        {"hash": False},
    ),
)  # fmt: skip
"""Cases with options: rule, its mutant (none: the unchanged base), name, what is special, options."""


@cache
def _clauses() -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {}
    for clause, judged in load_resource("clauses.json")["clauses"].items():
        for rule in judged.get("rules", ()):
            found.setdefault(rule, []).append(clause)
    return {rule: tuple(clauses) for rule, clauses in found.items()}


def _expectation(report: Report, free: frozenset[str] = frozenset()) -> Expectation:
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
        self.folder, self.scratch = folder, scratch
        self._written: dict[str, Path] = {}

    def fresh(self, name: str) -> Path:
        """A folder that does not exist, in one that does."""
        place = self.scratch / name
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        return place / DATASET_DIR

    def written_base(self, base: str) -> Path:
        """The base as the draft writes it now."""
        if base not in self._written:
            root = new_draft(BASES[base][0]).write(self.fresh(f"base-{base}"))
            self._written[base] = root.with_name(RAW_DIR) if base == "release-raw" else root
        return self._written[base]

    def drafted(self, draft: Draft) -> tuple[Path, Path]:
        """The draft as it is sealed, and as it is in the end."""
        late, draft._sealed = draft._sealed, []
        sealed = draft.write(self.fresh("sealed"))
        draft._sealed = late
        return sealed, draft.write(self.fresh("draft")) if late else sealed

    def recipe(self, base: str, draft: Draft) -> list[Mapping[str, Any]]:
        """Operations that lead from a base to a draft."""
        sealed, final = self.drafted(draft)
        found = recipe_between(self.written_base(base), sealed)
        found.append({"op": "seal"} if draft.is_sealed else {"op": "delete", "path": MANIFEST_FILE})
        if final != sealed:
            found += recipe_between(sealed, final)
            if draft.is_sealed and not (final / MANIFEST_FILE).exists():
                found.append({"op": "delete", "path": MANIFEST_FILE})
            elif draft.is_sealed and (final / MANIFEST_FILE).read_bytes() != (sealed / MANIFEST_FILE).read_bytes():
                found.append({"op": "manifest", "edits": manifest_edits(sealed, final)})
        return found

    def judged(self, case: Case) -> Report:
        """The validator's report on a case as it is laid out."""
        target = self.fresh("judged").parent
        target.rmdir()
        materialize(self.folder, case, target, is_linked=True)
        options: dict[str, Any] = {"hash_files": case.options.get("hash", True)}
        if "waivers" in case.options:
            options["waivers"] = load_waivers(target / WAIVERS_FILE)
        return judged_folder(target / DATASET_DIR, raw=target / RAW_DIR if case.raw is not None else None, **options)

    def same(self, case: Case, draft: Draft) -> bool:
        """Whether a case makes the dataset of a draft: the same files with the same content."""
        target = self.fresh("stored").parent
        target.rmdir()
        try:
            materialize(self.folder, case, target, is_linked=True)
        except UsageError:
            return False  # its recipe fits another state of the base
        _, final = self.drafted(draft)
        beside = draft.raw_root(final) if isinstance(draft, ReleaseDraft) else None
        if (beside is None) != (case.raw is None):
            return False
        pairs = [(target / DATASET_DIR, final), *([(target / RAW_DIR, beside)] if beside else [])]
        return all(_same_files(one, other) for one, other in pairs)


def _same_files(one: Path, other: Path) -> bool:
    """Whether two folders hold the same: tables by their cells, manifests by what they say of the files beside them."""
    if tree(one) != tree(other):
        return False
    return all(_same_content(one, other, path) for path, (kind, _) in tree(one).items() if kind == "file")


def _same_content(one: Path, other: Path, path: str) -> bool:
    first, second = ((root / path).read_bytes() for root in (one, other))
    if first == second:
        return True
    if path == MANIFEST_FILE:
        try:
            return templated(one, sealed_digests(one)) == templated(other, sealed_digests(other))
        except UnicodeDecodeError:
            return False
    if not path.endswith(".parquet"):
        return False
    try:
        return equal_tables(read_table(first), read_table(second))
    except (OSError, pa.ArrowException):
        return False


# Bases


def _make_bases(maker: Maker) -> Iterator[tuple[Path, bytes | None]]:
    """Files of the base datasets that are to be written, each with its content, or ``None`` to be deleted."""
    for base, (_, parent, what) in BASES.items():
        folder, description = maker.folder / "bases" / base, maker.folder / "bases" / f"{base}.json"
        written = maker.written_base(base)
        laid_out = maker.fresh("laid-out")
        if description.is_file():
            lay_out_base(maker.folder, base, laid_out, is_linked=True)
        if not laid_out.is_dir() or not _same_files(laid_out, written):
            beside = maker.written_base(parent) if parent else None
            names = {path for path, (kind, _) in tree(written).items() if kind == "file"}
            of_parent = {path for path, (kind, _) in tree(beside).items() if kind == "file"} if beside else set()
            own = {
                path
                for path in names
                if beside is None
                or path not in of_parent
                or (beside / path).read_bytes() != (written / path).read_bytes()
            }
            if folder.is_dir():
                stored = {path for path, (kind, _) in tree(folder).items() if kind == "file"}
                yield from ((folder / path, None) for path in sorted(stored - own))
            yield from ((folder / path, (written / path).read_bytes()) for path in sorted(own))
            deleted = sorted(of_parent - names)
        else:
            deleted = json.loads(description.read_bytes())["delete"]
        report = judged_folder(written)
        rules = {rule: outcome.to_json() for rule, outcome in _expectation(report).rules.items()}
        document = {"parent": parent, "what": what, "delete": deleted, "verdict": report.verdict, "rules": rules}
        yield description, case_text(document).encode()


# Cases


def _drafts() -> dict[str, Callable[[Maker], Case]]:
    """All cases by name, each with what makes it."""
    made: dict[str, Callable[[Maker], Case]] = {}
    for case in (*MUTANTS, *BOUNDARIES):
        rules = (case.rule,) if isinstance(case, Mutant) else case.rules
        kind = "fail" if isinstance(case, Mutant) else "boundary"
        made[f"{rules[0]}/{_file_name(case.name)}"] = partial(_registered, case=case, rules=rules, kind=kind)
    for rule, mutant, name, what, options in _ARMS:
        made[f"{rule}/{name}"] = partial(_arm, name=f"{rule}/{name}", mutant=mutant, what=what, options=options)
    for rule in CATALOGUE:
        if _passing_base(rule) is not None:
            made[f"{rule}/pass"] = partial(_passing, rule=rule)
    return made


def _passing_base(rule: str) -> str | None:
    """The first base on which the rule has something to examine and passes."""
    expected = ((base, base_expectation(CASES, base)) for base in BASES)
    return next((base for base, found in expected if found.rules[rule].status == "pass"), None)


def case_names() -> list[str]:
    """Names of all cases."""
    return list(_drafts())


def _file_name(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _sentence(case: Mutant | Boundary) -> str:
    return (case.edit.__doc__ or case.name.replace("_", " ")).strip().splitlines()[0].rstrip(".")


def _registered(maker: Maker, case: Mutant | Boundary, rules: tuple[str, ...], kind: Any) -> Case:
    draft = new_draft(case.base)
    case.edit(draft)
    name = f"{rules[0]}/{_file_name(case.name)}"
    free = frozenset(CATALOGUE[rules[0]].consequences) if kind == "fail" else frozenset[str]()
    made = Case(
        name=name, kind=kind, rules=rules, what=_sentence(case), clauses=_clauses_of(rules), base=_BASE_OF[case.base],
        recipe=(), raw=None, expected=Expectation("", {}),
    )  # fmt: skip
    stored = maker.folder / f"{name}.json"
    old = load_case(maker.folder, stored) if stored.is_file() else None
    if old is not None and maker.same(old, draft):
        made = replace(made, base=old.base, recipe=old.recipe, raw=old.raw)
    else:
        recipe = maker.recipe(made.base, draft)
        if len(json.dumps(recipe)) > _MAX_RECIPE_BYTES and made.base != "release":
            made = replace(made, base="release")
            recipe = maker.recipe("release", draft)
        made = replace(made, recipe=recipe)
        if isinstance(draft, ReleaseDraft) and draft.raw is not None:
            made = replace(made, raw=maker.recipe("release-raw", draft.raw))
    report = maker.judged(made)
    expected = _expectation(report, free)
    if isinstance(case, Mutant):
        outcome = expected.rules[case.rule]
        if (outcome.status, outcome.violations) != ("fail", case.findings):
            raise AssertionError(f"{name}: {case.findings} violations are declared, the validator finds {outcome}")
    else:
        found = {rule: expected.rules[rule].status for rule in rules}
        if set(found.values()) != {case.status}:
            raise AssertionError(f"{name}: {case.status} is declared, the validator finds {found}")
    return replace(made, expected=expected)


def _arm(maker: Maker, name: str, mutant: str, what: str, options: dict[str, Any]) -> Case:
    rule, _ = name.split("/")
    if mutant:
        (case,) = (case for case in MUTANTS if (case.rule, case.name) == (rule, mutant))
        made = _registered(maker, case, (rule,), "fail")
    else:
        made = _passing(maker, rule)
    made = replace(made, name=name, what=what, options=options)
    return replace(made, expected=_expectation(maker.judged(made), made.expected.free))


def _passing(maker: Maker, rule: str) -> Case:
    """An unchanged base dataset on which the rule passes."""
    base = _passing_base(rule)
    if base is None:
        raise AssertionError(f"{rule} passes on no base dataset")
    expected = base_expectation(maker.folder, base)
    return Case(f"{rule}/pass", "pass", (rule,), BASES[base][2], _clauses_of((rule,)), base, (), expected)


def _clauses_of(rules: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(clause for rule in rules for clause in _clauses().get(rule, ())))


def _made(folder: Path, names: Sequence[str]) -> list[tuple[str, bytes]]:
    """Cases as their files have them."""
    with tempfile.TemporaryDirectory() as scratch:
        maker, drafts, made = Maker(folder, Path(scratch)), _drafts(), []
        for name in names:
            case = drafts[name](maker)
            made.append((name, case_text(case.to_json(base_expectation(folder, case.base))).encode()))
    return made


def _write(path: Path, content: bytes | None) -> None:
    if content is None:
        path.unlink()
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def main(argv: Sequence[str] | None = None) -> int:
    """Make the cases, or say which are not up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 where something is out of date")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--select", default="", help="only cases whose rule starts with this")
    parser.add_argument("--archive", type=Path, help="write all cases and base datasets into this .tar.gz file as well")
    args = parser.parse_args(argv)
    folder = CASES
    stale: list[str] = []

    def settle(path: Path, content: bytes | None) -> None:
        if (path.read_bytes() if path.is_file() else None) != content:
            stale.append(str(path.relative_to(folder)))
            if not args.check:
                _write(path, content)

    with tempfile.TemporaryDirectory() as scratch:
        for path, content in _make_bases(Maker(folder, Path(scratch))):
            settle(path, content)
    base_expectation.cache_clear()
    names = [name for name in case_names() if name.startswith(args.select)]
    lots = [names[start : start + _LOT_CASES] for start in range(0, len(names), _LOT_CASES)]
    with ProcessPoolExecutor(args.jobs, mp_context=spawn_context(for_arrays=True)) as pool:
        for made in track(pool.map(partial(_made, folder), lots), "cases", total=len(lots), transient=True):
            for name, content in made:
                settle(folder / f"{name}.json", content)
    for path in sorted(folder.glob(f"{args.select or 'BD-'}*/*.json")):
        if path.relative_to(folder).with_suffix("").as_posix() not in names:
            settle(path, None)
    verb = "out of date" if args.check else "written"
    sys.stdout.write(
        "".join(f"{verb}: {path}\n" for path in stale) + f"{len(names)} cases, {len(stale)} files {verb}\n"
    )
    if args.archive:
        sys.stdout.write(f"{args.archive}: {pack(folder, args.archive)}\n")
    return int(args.check and bool(stale))


if __name__ == "__main__":
    raise SystemExit(main())
