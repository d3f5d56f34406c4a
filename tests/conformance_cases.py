"""`make cases`: the registered defects and limits as conformance cases, each a file of its own.

Drafts are written to disk, compared with their base dataset, and kept as a recipe with what the validator says of the
result. A case that still makes the same dataset is left as it is, so that files do not depend on the version of the
library that writes Parquet; ``--check`` changes nothing and names what differs, and ``--afresh`` finds the recipes of
stored cases again, without judging their datasets, which stay.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

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
from branchdrive.process import spawn_context
from branchdrive_conformance.archive import BASES_FILE, base_files, pack, pack_bases
from branchdrive_conformance.case import (
    MAX_LOCATIONS,
    Case,
    Expectation,
    Outcome,
    base_expectation,
    case_text,
    load_case,
    stated_rules,
)
from branchdrive_conformance.difference import manifest_edits, recipe_between, templated, tree
from branchdrive_conformance.materialize import DATASET_DIR, RAW_DIR, WAIVERS_FILE, lay_out_base, materialize
from branchdrive_conformance.recipe import apply_recipe, sealed_digests
from branchdrive_conformance.table_difference import equal_tables
from branchdrive_conformance.table_operation import read_table

ROOT = Path(__file__).resolve().parents[1]
CASES = ROOT / "conformance_tests" / "cases" / f"v{SPEC_VERSION}"

BASES: dict[str, tuple[str, str | None, str]] = {
    "raw": ("full", None, "three groups with actors and risk evidence"),
    "raw-media": ("media", "raw", "the same with camera frames"),
    "raw-map": ("map", "raw", "the same with a map"),
    "raw-bare": ("bare", "raw", "the same without actors and risk evidence"),
    "raw-exact": ("BD-RPN-001/exact_replays", "raw", "the same with replays that are exact, as is declared"),
    "raw-exact-media": (
        "BD-RPN-006/images_of_exact_replays",
        "raw-media",
        "the same with camera frames and with exact replays",
    ),
    "raw-prompt": (
        "BD-RSP-014/images_that_show_the_first_response",
        "raw-media",
        "the same with exact replays and with camera frames that show what the policy does",
    ),
    "raw-driven": (
        "BD-RSP-016/vehicle_that_drives",
        "raw-bare",
        "groups whose ego vehicle moves as the declared one does",
    ),
    "raw-replayed": ("BD-RPN-001/nothing_is_declared", "raw", "three groups of replays that are not exact"),
    "raw-window": ("BD-WIN-002/branch_without_a_predecessor", "raw", "three groups, one that branches too early"),
    "raw-policies": ("BD-CTL-010/window_beyond_the_end_of_the_nominal", "raw", "one group of other policies"),
    "raw-near": ("BD-ACT-006/rows_up_to_thirty_metres", "raw", "three groups with actors up to a distance"),
    "raw-axle": ("BD-RSP-007/pose_of_the_front_axle", "raw-driven", "groups with the pose of another point"),
    "raw-crab": ("BD-RSP-007/actors_that_crab_a_little", "raw", "three groups with actors that turn aside"),
    "raw-early": ("BD-TIC-003/earliest_branch", "raw", "three groups, one with the earliest branch there is"),
    "raw-place": ("BD-RSP-015/group_in_another_place", "raw", "three groups, one that repeats another elsewhere"),
    "release": ("release", None, "a release in place: raw layer with media, all derived layers, an audit of leakage"),
    "release-raw": ("detached", "release", "the raw dataset beside a detached release"),
    "release-detached": ("alone", "release", "a release without its raw layer"),
    "release-noisy": ("BD-FID-008/noisy_group_called_valid", "release", "a release with a group that is not valid"),
    "release-ineligible": (
        "BD-QUA-006/group_with_two_seeds_called_eligible",
        "release",
        "a release with a group that is not eligible",
    ),
    "release-repeated": (
        "BD-SPL-007/group_that_repeats_another_within_its_partition",
        "release",
        "a release of another split",
    ),
    "release-near": ("BD-SPL-007/near_duplicate_let_through", "release", "a release with a near duplicate"),
    "release-benchmark": ("benchmark", "release", "a release in place with a benchmark"),
    "release-baselines": (
        "BD-BMK-012/results_with_baselines",
        "release-benchmark",
        "a release with a benchmark that has baselines",
    ),
    "release-outcomes": (
        "BD-BMK-001/outcomes_of_selections_are_declared",
        "release-benchmark",
        "a release with a benchmark that declares outcomes of selections",
    ),
}
"""Base datasets: the draft or registered limit that each is written from, the base that its files are stored against,
and what it is."""

_BASE_OF: dict[Base, str] = {
    "full": "raw", "media": "raw-media", "map": "raw-map", "bare": "raw-bare", "release": "release",
    "detached": "release-detached", "alone": "release-detached", "benchmark": "release-benchmark",
}  # fmt: skip

_MAX_OWN_BYTES = 600
"""Recipes up to this size are told against the base that the draft is of."""

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
            root = _draft_of(BASES[base][0]).write(self.fresh(f"base-{base}"))
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
            if not _same_files(
                self._laid_out("check", made[name][0], new), final, but=() if is_late else (MANIFEST_FILE,)
            ):
                raise AssertionError(f"{case.name}: its recipe does not lead to its dataset")
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
        return all(_same_files(one, other) for one, other in pairs)


def _text_length(case: Case) -> int:
    return len(json.dumps([case.recipe, case.raw]))


def _distance(base: Path, changed: Path) -> int:
    """Bytes of the files in which two datasets differ."""
    total = 0
    for path in {*tree(base), *tree(changed)} - {MANIFEST_FILE}:
        one, other = base / path, changed / path
        if not (one.is_file() and other.is_file()):
            total += sum(place.stat().st_size for place in (one, other) if place.is_file())
        elif one.stat().st_size != other.stat().st_size or one.read_bytes() != other.read_bytes():
            total += other.stat().st_size
    return total


def _draft_of(source: str) -> Draft:
    """A new draft of a kind, or of a registered limit."""
    if not source.startswith("BD-"):
        return new_draft(cast(Base, source))
    (case,) = (case for case in (*MUTANTS, *BOUNDARIES) if _case_name(case) == source)
    draft = new_draft(case.base)
    case.edit(draft)
    return draft


def _case_name(case: Mutant | Boundary) -> str:
    return f"{case.rule if isinstance(case, Mutant) else case.rules[0]}/{_file_name(case.name)}"


def _same_files(one: Path, other: Path, *, but: Collection[str] = ()) -> bool:
    """Whether two folders hold the same: tables by their cells, manifests by what they say of the files beside them."""
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
    if not path.endswith(".parquet"):
        return False
    try:
        return equal_tables(read_table(first), read_table(second))
    except (OSError, pa.ArrowException):
        return False


# Bases


def _make_bases(maker: Maker) -> Iterator[tuple[Path, bytes]]:
    """Files of the base datasets, each with its content."""
    archive = maker.folder / BASES_FILE
    before = base_files(maker.folder) if archive.is_file() else {}
    after: dict[str, dict[str, bytes]] = {}
    expected: dict[str, Expectation] = {}
    for base, (_, parent, what) in BASES.items():
        description = maker.folder / "bases" / f"{base}.json"
        written, laid_out = maker.written_base(base), maker.fresh("laid-out")
        if base in before and description.is_file():
            lay_out_base(maker.folder, base, laid_out)
        is_kept = parent is None or after[parent] is before.get(parent)
        if is_kept and laid_out.is_dir() and _same_files(laid_out, written):
            after[base] = before[base]
            deleted = json.loads(description.read_bytes())["delete"]
        else:
            beside = _contents(maker.written_base(parent)) if parent else {}
            mine = _contents(written)
            after[base] = {path: content for path, content in mine.items() if beside.get(path) != content}
            deleted = sorted(set(beside) - set(mine))
        expected[base] = _expectation(judged_folder(written))
        rules = stated_rules(expected[base].rules, expected[parent].rules if parent else None)
        document = {
            "parent": parent, "what": what, "delete": deleted, "verdict": expected[base].verdict, "rules": rules,
        }  # fmt: skip
        yield description, case_text(document).encode()
    yield archive, archive.read_bytes() if after == before else pack_bases(after)


def _contents(root: Path) -> dict[str, bytes]:
    return {path: (root / path).read_bytes() for path, (kind, _) in tree(root).items() if kind == "file"}


# Cases


def _drafts() -> dict[str, Callable[[Maker], Case]]:
    """All cases by name, each with what makes it."""
    made: dict[str, Callable[[Maker], Case]] = {}
    for case in (*MUTANTS, *BOUNDARIES):
        rules = (case.rule,) if isinstance(case, Mutant) else case.rules
        kind = "fail" if isinstance(case, Mutant) else "boundary"
        made[_case_name(case)] = partial(_registered, case=case, rules=rules, kind=kind)
    for rule, mutant, name, what, options in _ARMS:
        made[f"{rule}/{name}"] = partial(_arm, name=f"{rule}/{name}", mutant=mutant, what=what, options=options)
    for rule in CATALOGUE:
        if _passing_base(rule) is not None:
            made[f"{rule}/pass"] = partial(_passing, rule=rule)
    return made


def _passing_base(rule: str) -> str | None:
    """The first base of a kind of drafts on which the rule has something to examine and passes."""
    bases = [base for base, (source, _, _) in BASES.items() if not source.startswith("BD-")]
    return next((base for base in bases if base_expectation(CASES, base).rules[rule].status == "pass"), None)


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
        sealed, final = maker.drafted(draft)
        base = maker.nearest(made.base, sealed)
        made = replace(made, base=base, recipe=maker.recipe(base, sealed, final, is_sealed=draft.is_sealed))
        if isinstance(draft, ReleaseDraft) and (raw := draft.raw) is not None:
            beside = maker.recipe("release-raw", *maker.drafted(raw), is_sealed=raw.is_sealed)
            made = replace(made, raw=beside)
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


def _made(folder: Path, names: Sequence[str], is_afresh: bool) -> list[tuple[str, bytes]]:
    """Cases as their files have them."""
    with tempfile.TemporaryDirectory() as scratch:
        maker, drafts, made = Maker(folder, Path(scratch)), _drafts(), []
        for name in names:
            path = folder / f"{name}.json"
            is_stored = is_afresh and path.is_file()
            case = maker.rewritten(load_case(folder, path)) if is_stored else drafts[name](maker)
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
    parser.add_argument("--afresh", action="store_true", help="find recipes of stored cases again; datasets stay")
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
    base_files.cache_clear()
    names = [name for name in case_names() if name.startswith(args.select)]
    lots = [names[start : start + _LOT_CASES] for start in range(0, len(names), _LOT_CASES)]
    with ProcessPoolExecutor(args.jobs, mp_context=spawn_context(for_arrays=True)) as pool:
        for made in track(
            pool.map(partial(_made, folder, is_afresh=args.afresh), lots), "cases", total=len(lots), transient=True
        ):
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
