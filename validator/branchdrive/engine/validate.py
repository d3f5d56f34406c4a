"""The engine: survey the files, audit every shard, judge the whole, decide.

A map over shards of whole branch groups and a merge of small results: worker count, order of
files and sizes of row groups cannot change a verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import date
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from branchdrive.contract.layout import RAW_DIR
from branchdrive.contract.mismatch import Mismatch
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.contract.text import printable
from branchdrive.engine.examine import VIEW_RULES
from branchdrive.engine.extract import merge
from branchdrive.engine.finding import Finding
from branchdrive.engine.judge import judge
from branchdrive.engine.layers import ReleaseResult, ReleaseTask, audit_release
from branchdrive.engine.report import DatasetFacts, Report, RunOptions
from branchdrive.engine.shard import ShardResult, ShardTask, audit_shard
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import decide
from branchdrive.engine.waiver import Waiver, apply_waivers
from branchdrive.engine.worker import Died, Executor, Failed, in_process
from branchdrive.errors import UsageError
from branchdrive.files.survey import Survey, take_survey
from branchdrive.formats.manifest import Manifest
from branchdrive.layers.view import RawLayer
from branchdrive.raw.funnel import Funnel

__all__ = ["Progress", "audit_shards", "judge_files", "select_rules", "validate"]

_DECODING = "BD-LYR-002"
"""The rule that tables of derived layers decode within the limits."""

Progress = Callable[[int, int], None]
"""Called with the number of finished shards and the number of shards."""


def select_rules(patterns: Iterable[str]) -> frozenset[str]:
    """Rules that ids or id prefixes (``BD-CTL``, ``BD-CTL-004``) name.

    Raises:
        UsageError: A pattern names no rule.
    """
    chosen: set[str] = set()
    for pattern in patterns:
        named = {rule_id for rule_id in CATALOGUE if rule_id == pattern or rule_id.startswith(f"{pattern}-")}
        if not named:
            raise UsageError(
                f"no rule is called {pattern!r}; `branchdrive rules` lists ids, prefixes such as 'BD-CTL' work too"
            )
        chosen |= named
    return frozenset(chosen)


def validate(
    root: Path | str,
    *,
    raw: Path | str | None = None,
    select: Sequence[str] | None = None,
    ignore: Sequence[str] = (),
    hash_files: bool = True,
    waivers: Sequence[Waiver] = (),
    require_groups: int | None = None,
    executor: Executor = in_process,
    progress: Progress | None = None,
    today: date | None = None,
) -> Report:
    """Validate the dataset at `root`.

    Args:
        root: The dataset folder.
        raw: Folder of the dataset with the raw layer, for a detached release.
        select: Rule ids or prefixes to run; all by default.
        ignore: Rule ids or prefixes to leave out.
        hash_files: Whether to compare digests; without them the verdict is at best partial.
        waivers: Accepted failures.
        require_groups: Groups that must qualify for exit code 0.
        executor: How shards are run; `branchdrive.engine.worker.isolated` bounds memory.
        progress: Told after every shard.
        today: The date against which waivers expire; the current date by default.

    Raises:
        UsageError: There is no dataset at `root` or `raw`, or the options contradict each other.
    """
    selected = (select_rules(select) if select is not None else frozenset(CATALOGUE)) - select_rules(ignore)
    qualifying = {rule_id for rule_id, info in CATALOGUE.items() if info.kind in ("structure", "qualification")}
    is_whole = qualifying & set(VIEW_RULES) <= selected
    if require_groups is not None and not is_whole:
        raise UsageError(
            "`require_groups` needs the funnel, and the funnel needs every rule on rows; drop `select` and `ignore`"
        )
    # Without the rule on digests, a damaged table is the matter of the rule on decoding.
    survey = take_survey(Path(root), hash_files=hash_files and "BD-LAY-002" in selected)
    source = _raw_survey(survey, raw)
    extracts = _extracts(survey, selected)
    results, errors = audit_shards(source, selected, executor, progress, extracts=extracts)
    source = source.with_shards(tuple(results))
    survey = source if source.root == survey.root else replace(survey, shards=source.shards)
    release = _audit_derived(survey, source, results, selected, executor, errors)
    survey = survey.with_digests(release.digests, release.unreadable)
    tallies = _merge(survey, results, selected, release)
    outcomes = apply_waivers(tallies, waivers, today or date.today())
    funnel = Funnel()
    for result in results:
        funnel.add(result.funnel)
    is_read = not any(tally.unjudged for result in results for tally in result.tallies.values())
    is_judged = source.descriptor is not None and is_whole and is_read and bool(results or source.has_raw)
    rule_errors = [message for tally in tallies.values() for message in tally.errors]
    return Report(
        decide(tallies.values(), errors),
        _facts(survey, source),
        RunOptions(tuple(select) if select is not None else None, tuple(ignore), hash_files, require_groups),
        tuple(tallies.values()),
        funnel if is_judged else None,
        release.population,
        tuple(outcomes),
        tuple(errors + rule_errors),
        _own_version(),
    )


def _raw_survey(survey: Survey, raw: Path | str | None) -> Survey:
    """The survey whose shards are the raw layer: of `survey` itself, or of the dataset at `raw`."""
    if raw is None:
        return survey
    if survey.has_raw:
        raise UsageError(f"{str(survey.root)!r} holds its raw layer itself; leave out --raw")
    source = take_survey(Path(raw), hash_files=survey.is_hashed)
    if not source.shard_folders:
        raise UsageError(f"{str(source.root)!r} holds no raw layer; name the dataset that the release was built from")
    return source


def _extracts(survey: Survey, selected: frozenset[str]) -> bool:
    """Whether the derived layers need rows of the raw one."""
    claimed = survey.descriptor.derived_layers if survey.descriptor else ()
    wanted = [CATALOGUE[rule_id] for rule_id in rules_of("layers") if rule_id in selected]
    return any(info.needs_raw and info.layer in claimed for info in wanted)


def _audit_derived(
    survey: Survey,
    source: Survey,
    results: Sequence[ShardResult],
    selected: frozenset[str],
    executor: Executor,
    errors: list[str],
) -> ReleaseResult:
    """Audit of the derived layers, in a process of its own like that of a shard."""
    if survey.descriptor is None or not survey.descriptor.derived_layers:
        return ReleaseResult()
    task = ReleaseTask(
        survey.root,
        survey.release_files,
        tuple(entry.path for entry in survey.files),
        survey.descriptor,
        _raw_layer(source, results),
        selected & frozenset(rules_of("layers")),
        survey.is_hashed,
    )
    for _, outcome in executor(audit_release, [task]):
        if isinstance(outcome, ReleaseResult):
            return outcome
        if isinstance(outcome, Failed):
            errors.append(f"derived layers: {outcome.message}")
    unjudged = {rule_id: Tally(rule_id, unjudged="the derived layers could not be judged") for rule_id in task.selected}
    if not errors and _DECODING in unjudged:  # what dies twice within the memory limit is the files' affair
        killed_by = Mismatch({}, "tables that decode within the memory limit", "a process that died of them, twice")
        killed = unjudged[_DECODING] = Tally(_DECODING, examined=1, total=1, num_findings=1)
        killed.keep([Finding.of(_DECODING, killed_by)])
    return ReleaseResult(tallies=unjudged)


def _raw_layer(source: Survey, results: Sequence[ShardResult]) -> RawLayer:
    if not results:
        return RawLayer(None, "the raw layer is not at hand; name its dataset with --raw")
    digest = None
    if source.is_hashed:
        digest = Manifest.of(source.digests).layers.get(RAW_DIR)
    lacking = next((shard.no_extract for shard in results if shard.extract is None), None)
    if lacking is None and source.descriptor is None:
        lacking = "the descriptor beside the raw layer is unusable"
    if lacking is not None:
        return RawLayer(None, lacking, digest=digest, descriptor=source.descriptor)
    extract = merge([shard.extract for shard in results if shard.extract is not None])
    for shard in results:
        shard.extract = None  # its rows live on in the whole
    return RawLayer(extract, digest=digest, descriptor=source.descriptor)


def audit_shards(
    survey: Survey, selected: frozenset[str], executor: Executor, progress: Progress | None, *, extracts: bool
) -> tuple[list[ShardResult], list[str]]:
    """Results of all shards, in order of their folders, and failures of the tool."""
    tasks = [
        ShardTask(
            survey.root, folder, tuple(e.path for e in files), survey.descriptor, selected, survey.is_hashed, extracts
        )
        for folder, files in survey.shard_folders.items()
    ]
    results: dict[int, ShardResult] = {}
    errors: list[str] = []
    if progress:
        progress(0, len(tasks))
    for index, outcome in executor(audit_shard, tasks):
        if isinstance(outcome, Died):
            outcome = _post_mortem(tasks[index], executor, errors)
        elif isinstance(outcome, Failed):
            errors.append(f"{tasks[index].folder}: {outcome.message}")
            outcome = _unjudged(tasks[index])
        results[index] = outcome
        if progress:
            progress(len(results), len(tasks))
    return [results[index] for index in sorted(results)], errors


def _post_mortem(task: ShardTask, executor: Executor, errors: list[str]) -> ShardResult:
    """Find out whether a shard's bytes or a rule killed the worker: decode the files one by one, without rules."""
    result = _unjudged(task)
    for path in task.files:
        part = ShardTask(task.root, task.folder, (path,), None, frozenset(), task.is_hashed)
        for _, outcome in executor(audit_shard, [part]):
            if isinstance(outcome, Died):
                result.over_limit[path] = "killed the process that decoded it within the memory limit, twice"
            elif isinstance(outcome, Failed):
                errors.append(f"{path}: {outcome.message}")
            else:
                result.digests.update(outcome.digests)
                result.unreadable.update(outcome.unreadable)
                result.undecodable.update(outcome.undecodable)
                result.over_limit.update(outcome.over_limit)
                result.present += outcome.present
                result.num_tables += outcome.num_tables
    if not result.over_limit and not result.undecodable:
        errors.append(f"{task.folder}: the worker died twice although every file decodes on its own")
    return result


def _unjudged(task: ShardTask) -> ShardResult:
    reason = f"{task.folder} could not be judged"
    tallies = {rule_id: Tally(rule_id, unjudged=reason) for rule_id in VIEW_RULES if rule_id in task.selected}
    return ShardResult(task.folder, tallies=tallies)


def _merge(
    survey: Survey, results: Sequence[ShardResult], selected: frozenset[str], release: ReleaseResult
) -> dict[str, Tally]:
    """One tally per rule of the catalogue over the whole dataset."""
    tallies: dict[str, Tally] = {}
    for rule_id in CATALOGUE:
        tally = tallies[rule_id] = Tally(rule_id)
        if rule_id not in selected:
            tally.unjudged = "deselected"
        elif tally.info.scope == "dataset":
            _judge_survey(survey, tally, tallies)
        elif tally.info.scope == "layers":
            if rule_id in release.tallies:
                tallies[rule_id] = release.tallies[rule_id]
            elif survey.descriptor is None:
                tally.unjudged = "the descriptor is unusable"
            else:
                tally.is_claimed = False
        else:
            for shard in results:
                tally.add(shard.tallies[rule_id])
            if survey.descriptor is None:
                tally.unjudged = "the descriptor is unusable"
    return tallies


def judge_files(survey: Survey) -> list[Tally]:
    """Tallies of the rules on files and documents alone."""
    tallies: dict[str, Tally] = {}
    for rule_id in rules_of("dataset"):
        tallies[rule_id] = Tally(rule_id)
        _judge_survey(survey, tallies[rule_id], tallies)
    return list(tallies.values())


def _judge_survey(survey: Survey, tally: Tally, tallies: dict[str, Tally]) -> None:
    streams = tally.info.streams
    if streams and survey.descriptor is not None and not set(streams) & set(survey.descriptor.streams):
        tally.is_claimed = False
        return
    failed = [other for other in tally.info.requires if other in tallies and tallies[other].status == "fail"]
    if failed:
        tally.unjudged = f"precondition {failed[0]} failed"
    elif tally.rule_id == "BD-LAY-002" and not survey.is_hashed:
        tally.unjudged = "digests are off"
    else:
        judge(tally, lambda: RULES[tally.rule_id](survey))


def _facts(survey: Survey, source: Survey) -> DatasetFacts:
    rows: dict[str, int] = {}
    for shard in survey.shards:
        for name, count in shard.rows.items():
            rows[name] = rows.get(name, 0) + count
    descriptor = survey.descriptor
    return DatasetFacts(
        path=printable(str(survey.root)),
        raw_path=None if source is survey or source.root == survey.root else printable(str(source.root)),
        dataset_id=descriptor.dataset_id if descriptor else None,
        dataset_version=descriptor.dataset_version if descriptor else None,
        identity=Manifest.of(survey.digests).identity if survey.is_hashed and survey.is_read else None,
        num_shards=len(survey.shards),
        num_files=len(survey.files),
        num_bytes=sum(entry.size for entry in survey.files),
        num_groups=len({group_id for shard in survey.shards for group_id in shard.group_ids}),
        num_rollouts=sum(len(shard.rollout_ids) for shard in survey.shards),
        rows=rows,
    )


@cache
def _own_version() -> str:
    try:
        return version("branchdrive")
    except PackageNotFoundError:
        return "unknown"
