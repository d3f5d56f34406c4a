"""Catalogue, functions and cases belong together: every rule is bound, can pass, can fail, and has a limit."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from tests.each import each
from tests.mutation import AREAS, BOUNDARIES, MUTANTS, Boundary, Mutant, new_draft
from tests.validator.engine.rules.case import (
    INHERITED,
    NO_SUBJECT,
    OF_MORE_GROUPS,
    RECOMMENDED,
    UNWRITTEN,
    Base,
    judged,
    report_on,
)
from tests.validator.engine.rules.release import BUILT

import branchdrive
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.rule import CATALOGUE, RULES, Grain, RuleInfo, Scope, rules_of
from branchdrive.contract.rule import rule as bind
from branchdrive.engine.rules import RULE_MODULES, bind_rules
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE
from branchdrive.engine.validate import validate
from branchdrive.errors import BranchDriveError
from branchdrive.runtime.process import python_command

MODULES = {layer: bind_rules(layer) for layer in RULE_MODULES}

each_rule = each("rule", CATALOGUE.values(), ids=lambda rule: rule.id)


def test_rules_and_functions_correspond_one_to_one() -> None:
    assert RULES.keys() == CATALOGUE.keys()
    assert len(set(RULES.values())) == len(RULES)


@pytest.mark.parametrize("rule_id", ["BD-LAY-001", "BD-XXX-001"])
def test_a_rule_is_bound_once_and_must_be_in_the_catalogue(rule_id: str) -> None:
    with pytest.raises(BranchDriveError, match=rule_id):
        bind(rule_id)(lambda view: ())
    assert RULES.keys() == CATALOGUE.keys()


@each_rule
def test_kind_fits_the_scope(rule: RuleInfo) -> None:
    """Qualification judges attempts and groups, diagnostics anything; what decides judges everything else.

    Replays are declared to be exact or not, and drives to be commanded as their decisions say: both are claims.
    """
    if rule.kind == "qualification":
        assert rule.scope == rule.grain
        assert rule.stage is not None
    else:
        on_rows = rule.scope in ("dataset", "rows", "layers", "layer_rows")
        assert rule.kind == "diagnostic" or on_rows or rule.id.startswith(("BD-RPN", "BD-CTL-016"))
        assert rule.stage is None


@each_rule
def test_layer_fits_the_scope(rule: RuleInfo) -> None:
    """Rules on derived layers, and no others, are about a claimed layer and may need the raw one."""
    assert (rule.layer is not None) == rule.scope.startswith("layer")
    assert rule.layer is not None or not rule.needs_raw
    assert rule.layer is None or not rule.streams


def test_rules_need_raw_where_the_catalogue_says_so(tmp_path: Path) -> None:
    """Without its raw layer a release is judged by every other rule on derived layers, and by no more."""
    report = judged(new_draft("alone"), tmp_path)
    layers = set(BUILT)
    words = {tally.rule_id: tally.status for tally in report.tallies if tally.info.layer in layers}
    known = [rule_id for rule_id in rules_of("layers", "layer_rows") if CATALOGUE[rule_id].layer in layers]
    skipped = {rule_id for rule_id in known if CATALOGUE[rule_id].needs_raw} | (NO_SUBJECT & {*known})
    assert words == {rule_id: "skipped" if rule_id in skipped else "pass" for rule_id in known}
    assert report.verdict == "partial"


@each_rule
def test_grain_fits_the_scope(rule: RuleInfo) -> None:
    grains: dict[Scope, set[Grain]] = {
        "dataset": {"dataset", "file", "document", "rollout", "group"},
        "rows": {"row", "rollout"},
        "rollout": {"rollout"},
        "group": {"group"},
        "layer_rows": {"row"},
        "layers": {"dataset", "file", "document", "row", "group"},
    }
    assert rule.grain in grains[rule.scope]


@each_rule
def test_preconditions_come_first_and_can_exclude_a_subject(rule: RuleInfo) -> None:
    order = list(CATALOGUE)
    for other in rule.requires:
        assert order.index(other) < order.index(rule.id)
        assert CATALOGUE[other].scope.startswith("layer") == rule.scope.startswith("layer")


@each_rule
def test_rule_has_a_mutant(rule: RuleInfo) -> None:
    assert [mutant for mutant in MUTANTS if mutant.rule == rule.id]


def test_every_area_of_the_raw_layer_has_a_defect_that_is_counted_in_several_places() -> None:
    """A validator that reports one finding of a rule at most is then wrong in all of them."""
    raw = {rule.id[3:6] for rule in CATALOGUE.values() if rule.layer is None}
    assert raw - {mutant.rule[3:6] for mutant in MUTANTS if mutant.findings > 1} == {"ENC"}  # there is one encoding
    assert sum(mutant.findings > MAX_FINDINGS_PER_RULE for mutant in MUTANTS) >= 3


@each_rule
def test_rule_has_a_boundary_on_which_it_passes(rule: RuleInfo) -> None:
    assert [case for case in BOUNDARIES if rule.id in case.rules and case.status == "pass"]


def test_every_module_of_rules_is_imported() -> None:
    package = Path(str(branchdrive.__file__)).parent
    binding = {path for path in package.rglob("*.py") if re.search(r"^@rule\(", path.read_text("utf-8"), re.MULTILINE)}
    assert binding == {Path(str(module.__file__)) for modules in MODULES.values() for module in modules}


@each_rule
def test_the_module_of_a_rule_is_one_of_its_layer(rule: RuleInfo) -> None:
    assert RULES[rule.id].__module__ in {module.__name__ for module in MODULES[rule.layer]}


LOADED = """
import sys
import branchdrive.engine.reading
print(*sorted(name.split(".")[1] for name in sys.modules if name.startswith("branchdrive.") and ".rules" in name))
print(*{name.split(".")[1] for name in sys.modules if name.startswith("branchdrive.")})
import branchdrive.cli.text
print("rich.markdown" in sys.modules)
"""


def test_who_reads_a_raw_layer_loads_no_rules_of_others_nothing_of_their_rooms_and_no_markdown() -> None:
    done = subprocess.run(python_command("-c", LOADED), capture_output=True, text=True, check=True)
    rules, rooms, has_markdown = done.stdout.splitlines()
    assert has_markdown == "False"
    assert set(rules.split()) == {"engine", "files", "raw"}
    assert not {"canonical", "model", "leakage", "card"} & set(rooms.split())


def test_every_module_of_cases_is_an_area() -> None:
    folder = Path(__file__).parent / "cases"
    assert {path.stem for path in folder.glob("[a-z]*.py")} == {area.__name__.rsplit(".", 1)[1] for area in AREAS}


def _cases_of(rule: str) -> str:
    """What modules of cases of a rule begin with: the room, but for the raw layer, and the module in its `rules`."""
    room, *parts = RULES[rule].__module__.removeprefix("branchdrive.").split(".")
    modules = parts[parts.index("rules") + 1 :] if "rules" in parts else []
    return "_".join([*(() if room == "raw" else (room,)), *modules])


@each("case", [*MUTANTS, *BOUNDARIES], ids=lambda case: case.name)
def test_cases_stand_in_a_module_called_as_that_of_their_rule(case: Mutant | Boundary) -> None:
    """With what they have in common behind it, where one module is too small for all of them."""
    module = case.edit.__module__.rsplit(".", 1)[1]
    rules = (case.rule,) if isinstance(case, Mutant) else case.rules
    assert any(module == name or module.startswith(f"{name}_") for name in map(_cases_of, rules))


def test_mutants_stand_in_the_order_of_their_areas() -> None:
    """So the mutant that the page of a rule shows does not depend on which module of cases is imported first."""
    areas = [area.__name__ for area in AREAS]
    places = [areas.index(mutant.edit.__module__) for mutant in MUTANTS]
    assert places == sorted(places)


def test_mutants_say_where() -> None:
    unplaced = [f"{mutant.rule} {mutant.name}" for mutant in MUTANTS if not mutant.at]
    # The name of these files cannot be stated in a source file or depends on the system.
    assert unplaced == ["BD-LAY-005 name_reverses_the_line", "BD-LAY-005 name_is_not_unicode"]


@pytest.mark.parametrize("rule", [rule for rule in CATALOGUE.values() if rule.consequences], ids=lambda rule: rule.id)
def test_declared_consequences_are_real(rule: RuleInfo) -> None:
    """Each is broken by a defect of the rule, so that a declaration never outlives its reason.

    That no defect breaks others is shown where each is judged.
    """
    seen: set[str] = set()
    for mutant in (mutant for mutant in MUTANTS if mutant.rule == rule.id):
        seen |= {tally.rule_id for tally in report_on(mutant).tallies if tally.status == "fail"} - {rule.id}
        if mutant.is_release:
            seen -= INHERITED
        seen -= RECOMMENDED
        if seen >= set(rule.consequences):
            break
    assert seen == set(rule.consequences)


def test_consequences_are_few() -> None:
    assert sum(bool(rule.consequences) for rule in CATALOGUE.values()) <= len(CATALOGUE) / 15


MEDIA_RULES = {rule.id for rule in CATALOGUE.values() if set(rule.streams) & {"rgb_surround", "semantic_bev"}}
DRIVE_RULES = {rule_id for rule_id, rule in CATALOGUE.items() if "decisions" in rule.streams}
MAP_RULES = {rule_id for rule_id in CATALOGUE if rule_id.startswith("BD-MAP")}


OF_SEMANTIC_MAPS = {"BD-FRM-009", "BD-FRM-012", "BD-FRM-016", "BD-FRM-017"}
UNCLAIMED_OF_IMAGES = (OF_SEMANTIC_MAPS | {"BD-WIN-006"}, OF_SEMANTIC_MAPS | {"BD-FRM-004"})
"""Rules on streams of images that releases do not claim, and the dataset with six views does not."""

OF_RELEASE = INHERITED | {"BD-ACT-007", "BD-FRM-004", "BD-RSP-015"}
"""Rules that fail on the valid release, which has an image of every nominal alone, groups that drive almost alike, and
cones that vanish."""


def test_every_rule_passes_on_a_dataset_that_claims_everything(tmp_path: Path) -> None:
    """On the raw layer, where all is good, and on a release, where some attempts and groups are not."""
    bases: tuple[tuple[Base, frozenset[str]], ...] = (
        ("media", frozenset()), ("map", frozenset()), ("release", OF_RELEASE), ("benchmark", OF_RELEASE)
    )  # fmt: skip
    for base, failing in bases:
        folder = tmp_path / base
        folder.mkdir()
        report = judged(new_draft(base), folder)
        assert report.errors == ()
        layers = {"release": BUILT, "benchmark": LAYERS}.get(base, [])
        absent = MEDIA_RULES if base == "map" else MAP_RULES | UNCLAIMED_OF_IMAGES[base == "media"]
        claimed = {rule_id for rule_id, rule in CATALOGUE.items() if rule.layer is None or rule.layer in layers}
        claimed -= absent | DRIVE_RULES
        lacking = (NO_SUBJECT | UNWRITTEN) - (OF_MORE_GROUPS if layers else frozenset())
        words = {tally.rule_id: tally.status for tally in report.tallies}
        assert {rule_id for rule_id, word in words.items() if word != "not-claimed"} == claimed
        assert {rule_id for rule_id in claimed if words[rule_id] == "skipped"} == lacking & claimed
        claimed -= lacking
        assert {rule_id for rule_id in claimed if words[rule_id] != "pass"} == failing
        assert {rule_id for rule_id in claimed if words[rule_id] == "fail"} == failing
        assert all(0 < tally.examined <= tally.total for tally in report.tallies if tally.rule_id in claimed)
        assert (report.verdict, report.exit_code) == ("valid", 0)


def test_what_a_release_inherits_is_qualification() -> None:
    assert {CATALOGUE[rule_id].kind for rule_id in INHERITED} == {"qualification"}


def test_every_group_of_the_dataset_qualifies(tmp_path: Path) -> None:
    report = validate(new_draft().write(tmp_path / "dataset"), require_groups=3)
    assert report.funnel is not None
    assert set(report.funnel.groups.values()) == {3}
    assert report.exit_code == 0


def test_rules_on_streams_that_are_not_claimed_say_so(tmp_path: Path) -> None:
    report = validate(new_draft("bare").write(tmp_path / "dataset"))
    unclaimed = {rule.id for rule in CATALOGUE.values() if rule.streams or rule.layer is not None}
    status = {tally.rule_id: tally.status for tally in report.tallies}
    assert {rule_id for rule_id, word in status.items() if word == "not-claimed"} == unclaimed
    # Every mask is a mask of evidence.
    assert {rule_id for rule_id, word in status.items() if word == "skipped"} == {"BD-NUL-002"} | (
        NO_SUBJECT - unclaimed
    )
    assert (report.verdict, report.exit_code) == ("valid", 0)
