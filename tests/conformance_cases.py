"""`make cases`: the registered defects and limits as conformance cases, each a file of its own.

Drafts are written to disk, compared with their base dataset, and kept as a recipe with what the validator says of the
result. A case that still makes the same dataset is left as it is, so that files do not depend on the version of the
library that writes Parquet; ``--check`` changes nothing and names what differs, and ``--afresh`` finds the recipes of
stored cases again, without judging their datasets, which stay.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from rich.progress import track
from tests.conformance_bases import BASE_OF, BASES, CASES, case_name, file_name
from tests.conformance_maker import Maker, expectation, same_files
from tests.mutation import BOUNDARIES, MUTANTS, Boundary, Mutant, new_draft
from tests.recipes.archive import pack, pack_bases
from tests.recipes.difference import tree
from tests.validator.engine.rules.case import judged_folder
from tests.validator.engine.rules.release import ReleaseDraft

from branchdrive.contract.resources import load_resource
from branchdrive.contract.rule import CATALOGUE
from branchdrive.runtime.process import array_context
from branchdrive_conformance.archive import BASES_FILE, base_files
from branchdrive_conformance.case import (
    Case,
    Expectation,
    base_expectation,
    case_text,
    load_case,
    stated_rules,
)
from branchdrive_conformance.materialize import lay_out_base

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
        if is_kept and laid_out.is_dir() and same_files(laid_out, written):
            after[base] = before[base]
            deleted = json.loads(description.read_bytes())["delete"]
        else:
            beside = _contents(maker.written_base(parent)) if parent else {}
            mine = _contents(written)
            after[base] = {path: content for path, content in mine.items() if beside.get(path) != content}
            deleted = sorted(set(beside) - set(mine))
        expected[base] = expectation(judged_folder(written))
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
        made[case_name(case)] = partial(_registered, case=case, rules=rules, kind=kind)
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


def _sentence(case: Mutant | Boundary) -> str:
    return (case.edit.__doc__ or case.name.replace("_", " ")).strip().splitlines()[0].rstrip(".")


def _registered(maker: Maker, case: Mutant | Boundary, rules: tuple[str, ...], kind: Any) -> Case:
    draft = new_draft(case.base)
    case.edit(draft)
    name = f"{rules[0]}/{file_name(case.name)}"
    free = frozenset(CATALOGUE[rules[0]].consequences) if kind == "fail" else frozenset[str]()
    made = Case(
        name=name, kind=kind, rules=rules, what=_sentence(case), clauses=_clauses_of(rules), base=BASE_OF[case.base],
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
    expected = expectation(report, free)
    if isinstance(case, Mutant):
        outcome = expected.rules[case.rule]
        if (outcome.status, outcome.violations) != ("fail", case.findings):
            raise AssertionError(f"{case.findings} violations are declared, the validator finds {outcome}")
    else:
        found = {rule: expected.rules[rule].status for rule in rules}
        if set(found.values()) != {case.status}:
            raise AssertionError(f"{case.status} is declared, the validator finds {found}")
    return replace(made, expected=expected)


def _arm(maker: Maker, name: str, mutant: str, what: str, options: dict[str, Any]) -> Case:
    rule, _ = name.split("/")
    if mutant:
        (case,) = (case for case in MUTANTS if (case.rule, case.name) == (rule, mutant))
        made = _registered(maker, case, (rule,), "fail")
    else:
        made = _passing(maker, rule)
    made = replace(made, name=name, what=what, options=options)
    return replace(made, expected=expectation(maker.judged(made), made.expected.free))


def _passing(maker: Maker, rule: str) -> Case:
    """An unchanged base dataset on which the rule passes."""
    base = _passing_base(rule)
    if base is None:
        raise AssertionError("the rule passes on no base dataset")
    expected = base_expectation(maker.folder, base)
    return Case(f"{rule}/pass", "pass", (rule,), BASES[base][2], _clauses_of((rule,)), base, (), expected)


def _clauses_of(rules: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(clause for rule in rules for clause in _clauses().get(rule, ())))


def _made(folder: Path, names: Sequence[str], is_afresh: bool) -> list[tuple[str, bytes | str]]:
    """Cases as their files have them, or what is wrong with them."""
    with tempfile.TemporaryDirectory() as scratch:
        maker, drafts = Maker(folder, Path(scratch)), _drafts()
        made: list[tuple[str, bytes | str]] = []
        for name in names:
            path = folder / f"{name}.json"
            is_stored = is_afresh and path.is_file()
            try:
                case = maker.rewritten(load_case(folder, path)) if is_stored else drafts[name](maker)
            except AssertionError as error:
                made.append((name, str(error)))
                continue
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
    wrong: list[str] = []

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
    with array_context() as context, ProcessPoolExecutor(args.jobs, mp_context=context) as pool:
        for made in track(
            pool.map(partial(_made, folder, is_afresh=args.afresh), lots), "cases", total=len(lots), transient=True
        ):
            for name, content in made:
                if isinstance(content, bytes):
                    settle(folder / f"{name}.json", content)
                else:
                    wrong.append(f"{name}: {content}")
    for path in sorted(folder.glob(f"{args.select or 'BD-'}*/*.json")):
        if path.relative_to(folder).with_suffix("").as_posix() not in names:
            settle(path, None)
    verb = "out of date" if args.check else "written"
    sys.stdout.write(
        "".join(f"{verb}: {path}\n" for path in stale) + f"{len(names)} cases, {len(stale)} files {verb}\n"
    )
    if args.archive:
        sys.stdout.write(f"{args.archive}: {pack(folder, args.archive)}\n")
    sys.stdout.write("".join(f"wrong: {reason}\n" for reason in wrong))
    return int(bool(wrong) or (args.check and bool(stale)))


if __name__ == "__main__":
    raise SystemExit(main())
