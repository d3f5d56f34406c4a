"""The engine: survey the files, audit every shard, judge the whole, decide.

A map over shards of whole branch groups and a merge of small results: worker count, order of
files and sizes of row groups cannot change a verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from datetime import date
from pathlib import Path

from branchdrive.contract.columns import DECISIONS, STREAMS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.identity import claimed_files, content_identity, derived_content
from branchdrive.contract.layout import DESCRIPTOR_FILE, RAW_DIR
from branchdrive.contract.media import MediaMode
from branchdrive.contract.rule import CATALOGUE, RULES, rules_of
from branchdrive.contract.text import printable
from branchdrive.engine.cache import Cache, CacheUse, caching, is_url, open_kept
from branchdrive.engine.cause import find_causes
from branchdrive.engine.derived import judge_derived
from branchdrive.engine.examine import VIEW_RULES
from branchdrive.engine.group_causes import link_to_dataset
from branchdrive.engine.judge import judge
from branchdrive.engine.reading import Progress, read_dataset
from branchdrive.engine.report import DatasetFacts, Report, RunOptions
from branchdrive.engine.response_summary import ResponseSummary
from branchdrive.engine.shard import ShardResult
from branchdrive.engine.spool import Spool
from branchdrive.engine.tally import Tallies, Tally
from branchdrive.engine.verdict import decide
from branchdrive.engine.waiver import Waiver, apply_waivers
from branchdrive.errors import UsageError
from branchdrive.files.shard_facts import num_groups
from branchdrive.files.survey import NOT_READ, Survey, take_survey
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest
from branchdrive.formats.place import Place, open_store
from branchdrive.formats.private_folder import PrivateFolder
from branchdrive.formats.store import Store
from branchdrive.raw.content import raw_content
from branchdrive.raw.funnel import Funnel
from branchdrive.runtime.executor import Executor, in_process
from branchdrive.runtime.installation import own_version

__all__ = ["judge_files", "select_rules", "validate"]


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
    root: Place,
    *,
    raw: Place | None = None,
    select: Sequence[str] | None = None,
    ignore: Sequence[str] = (),
    hash_files: bool = True,
    media: MediaMode = "full",
    waivers: Sequence[Waiver] = (),
    require_groups: int | None = None,
    strict: bool = False,
    follow_links: bool = False,
    allow: Sequence[Path | str] = (),
    executor: Executor = in_process,
    dataset_memory_bytes: int | None = None,
    cache: Cache | None = None,
    progress: Progress | None = None,
    today: date | None = None,
) -> Report:
    """Validate the dataset at `root`.

    Args:
        root: The dataset folder; or a bucket, an archive, or a place that is open, see `open_store`.
        raw: The dataset with the raw layer, for a detached release.
        select: Rule ids or prefixes to run; all by default.
        ignore: Rule ids or prefixes to leave out.
        hash_files: Whether to compare digests; without them the verdict is at best partial.
        media: How many images are decoded; unless all are, the verdict on a dataset with media is at best partial.
        waivers: Accepted failures.
        require_groups: Groups that must qualify for exit code 0.
        strict: Whether exit code 0 takes that no diagnostic and no recommendation fails.
        follow_links: Whether links are followed: those that stay in their dataset, and those into `allow`.
        allow: Folders that links may lead into.
        executor: How shards are run; `branchdrive.runtime.executor.isolated` bounds memory.
        dataset_memory_bytes: Private memory of a process of it that judges the whole dataset; that of the
            specification by default. What takes more is not judged, and the verdict is at best partial.
        cache: Where results of earlier runs are, and where those of this one are kept.
        progress: Called after every shard.
        today: The date against which waivers expire, and which says what of the cache is judged again; the current
            date by default.

    Raises:
        UsageError: There is no dataset at `root` or `raw`, or the options contradict each other.
        DatasetError: An archive cannot be read.
        PlatformError: A store cannot be reached or refuses.
    """
    today = today or date.today()
    selected = (select_rules(select) if select is not None else frozenset(CATALOGUE)) - select_rules(ignore)
    qualifying = {rule_id for rule_id, info in CATALOGUE.items() if info.kind in ("structure", "qualification")}
    is_whole = qualifying & set(VIEW_RULES) <= selected
    if require_groups is not None and not is_whole:
        raise UsageError(
            "`require_groups` needs the funnel, and the funnel needs every rule on rows; drop `select` and `ignore`"
        )
    stores = [open_store(place, follow_links=follow_links, allow=allow) for place in (root, raw) if place is not None]
    folder = stores[0]
    use = None if cache is None else CacheUse()
    if cache is not None and use is not None:
        _check_cache(cache, stores, strict, hash_files and "BD-LAY-002" in selected)
        kept = open_kept(cache)
        executor = caching(executor, cache, kept, use, day=today.toordinal())
    # Without the rule on digests, the rule on decoding checks a damaged table.
    survey = take_survey(folder, hash_files=hash_files and "BD-LAY-002" in selected)
    source = survey if raw is None else _raw_survey(survey, stores[1])
    is_layered = survey.descriptor is not None and bool(survey.descriptor.derived_layers)
    with Spool.temporary() if is_layered else nullcontext() as spool:
        reading = read_dataset(source, selected, executor, progress, spool=spool, release=survey, media=media)
        derived = judge_derived(reading, selected, executor, dataset_memory_bytes)
    results, errors = reading.shards, reading.errors
    if cache is not None and use is not None:
        errors += use.differences
        if isinstance(kept, PrivateFolder):
            kept.prune(cache.max_bytes)
    read = reading.source if source is survey else survey
    whole = read.with_layers(reading.source.shards, derived.digests, derived.unreadable)
    tallies = _merge(whole, source.descriptor, results, selected, derived.tallies)
    link_to_dataset(tallies)
    outcomes = apply_waivers(tallies, waivers, today)
    funnel = Funnel()
    for result in results:
        funnel.add(result.funnel)
    is_read = not any(t.unjudged and t.rule_id in qualifying for result in results for t in result.tallies.others)
    is_read &= not source.excess
    is_judged = source.descriptor is not None and is_whole and is_read and bool(results or source.has_raw)
    rule_errors = [message for tally in tallies.values() for message in tally.errors]
    return Report(
        decide(tallies.values(), errors),
        _facts(whole, source, derived.content),
        RunOptions(
            tuple(select) if select is not None else None,
            tuple(ignore),
            hash_files,
            require_groups,
            strict,
            _shown(folder),
            media,
        ),
        tuple(tallies.values()),
        funnel if is_judged else None,
        ResponseSummary.of(results, source.descriptor.action_bank.keys) if is_judged and source.descriptor else None,
        derived.population,
        tuple(outcomes),
        tuple(errors + rule_errors),
        own_version(),
        use,
        find_causes(tallies, results),
    )


def _check_cache(cache: Cache, stores: Iterable[Store], strict: bool, is_hashed: bool) -> None:
    """Refuse a cache where it cannot serve."""
    if strict:
        raise UsageError("a strict validation takes nothing that an earlier run judged; drop `strict` or the cache")
    if not is_hashed:
        raise UsageError(
            "a cache goes by the digests of files; compare them, and leave BD-LAY-002 in, or drop the cache"
        )
    for store in stores:
        if cache.trust_versions and not store.has_versions:
            raise UsageError(f"only a bucket lists versions that can be trusted, and {str(store)!r} is none; drop that")
        if is_url(cache.path):
            is_inside = f"{str(cache.path).rstrip('/')}/".startswith(f"{str(store).rstrip('/')}/")
        else:
            is_inside = isinstance(store, Folder) and Path(cache.path).resolve().is_relative_to(store.root.resolve())
        if is_inside:
            raise UsageError(f"the cache {str(cache.path)!r} lies inside the dataset {str(store)!r}; move it out")


def _shown(store: Store) -> tuple[str, ...] | None:
    """Folders that links may lead into; ``None`` where none is followed."""
    links = store.links if isinstance(store, Folder) else None
    return None if links is None else tuple(printable(str(folder)) for folder in links)


def _raw_survey(survey: Survey, raw: Store) -> Survey:
    """The survey whose shards are the raw layer of the release `survey`: of the dataset at `raw`."""
    if survey.has_raw:
        raise UsageError(f"{str(survey.folder)!r} holds its raw layer itself; leave out --raw")
    source = take_survey(raw, hash_files=survey.is_hashed)
    if source.excess:
        raise UsageError(f"{str(source.folder)!r} exceeds the limits on files, and was not read; validate it by itself")
    if not source.shard_folders:
        raise UsageError(f"{str(source.folder)!r} holds no raw layer; name the dataset that the release was built from")
    return source


def _merge(
    survey: Survey,
    of_raw: Descriptor | None,
    results: Sequence[ShardResult],
    selected: frozenset[str],
    derived: Mapping[str, Tally],
) -> dict[str, Tally]:
    """One tally per rule of the catalogue over the whole dataset, whose shards `of_raw` describes."""
    tallies: dict[str, Tally] = {}
    of_shards = Tallies.total(shard.tallies for shard in results)
    described = of_raw if results else survey.descriptor
    left_out = next((shard.left_out for shard in results if shard.left_out), None)
    for rule_id in CATALOGUE:
        tally = tallies[rule_id] = Tally(rule_id)
        if rule_id not in selected:
            tally.unjudged = "deselected"
            tally.is_claimed = described is None or tally.info.is_about(described.streams)
        elif tally.info.scope == "dataset":
            _judge_survey(survey, tally, tallies)
            if tally.info.grain in ("rollout", "group"):
                tally.unjudged = tally.unjudged or left_out
        elif tally.info.scope in ("layers", "layer_rows"):
            if rule_id in derived:
                tallies[rule_id] = derived[rule_id]
            elif survey.descriptor is None:
                tally.unjudged = "the descriptor is unusable"
            elif survey.excess:
                tally.unjudged = NOT_READ
            else:
                tally.is_claimed = False
        else:
            if results:
                tally.add(of_shards[rule_id])
            if survey.descriptor is None:
                tally.unjudged = "the descriptor is unusable"
            elif survey.excess and not results:
                tally.unjudged = NOT_READ
            elif described is not None:
                tally.is_claimed = tally.info.is_about(described.streams)
    return tallies


def judge_files(survey: Survey) -> list[Tally]:
    """Tallies of the rules on files and documents alone."""
    tallies: dict[str, Tally] = {}
    for rule_id in rules_of("dataset"):
        tallies[rule_id] = Tally(rule_id)
        _judge_survey(survey, tallies[rule_id], tallies)
    return list(tallies.values())


def _judge_survey(survey: Survey, tally: Tally, tallies: dict[str, Tally]) -> None:
    if survey.descriptor is not None and not tally.info.is_about(survey.descriptor.streams):
        tally.is_claimed = False
        return
    failed = [other for other in tally.info.requires if other in tallies and tallies[other].status == "fail"]
    if failed:
        tally.unjudged = f"precondition {failed[0]} failed"
    elif tally.rule_id == "BD-LAY-002" and not survey.is_hashed:
        tally.unjudged = "digests were not computed"
    else:
        judge(tally, lambda: RULES[tally.rule_id](survey))


def _facts(survey: Survey, source: Survey, files: Mapping[str, str]) -> DatasetFacts:
    rows: dict[str, int] = {}
    for shard in survey.shards:
        for name, count in shard.rows.items():
            rows[name] = rows.get(name, 0) + count
    descriptor = survey.descriptor
    claimed = descriptor.layers if descriptor else ()
    content = derived_content(files, claimed_files(claimed, survey.paths))
    raw = raw_content(survey.shards) if survey.shards else None
    if raw is not None:
        content[RAW_DIR] = raw
    return DatasetFacts(
        path=printable(str(survey.folder)),
        raw_path=None if source.folder == survey.folder else printable(str(source.folder)),
        dataset_id=descriptor.dataset_id if descriptor else None,
        dataset_version=descriptor.dataset_version if descriptor else None,
        identity=Manifest.of(survey.digests).identity if survey.is_hashed and survey.is_read else None,
        descriptor_digest=survey.digests.get(DESCRIPTOR_FILE) if survey.is_hashed else None,
        tolerances=descriptor.tolerances.model_dump() if descriptor else {},
        replay_noise=descriptor.collection.replay_noise.kind if descriptor else None,
        unrecorded=list(descriptor.unrecorded) if descriptor else [],
        unclaimed_streams=[n for n in STREAMS if n not in (*descriptor.streams, DECISIONS)] if descriptor else [],
        num_missing_attempts=sum(shard.num_missing_attempts for shard in survey.shards),
        content_identity=content_identity(content, claimed),
        content=content,
        num_shards=len(survey.shards),
        num_files=len(survey.files),
        num_beside=survey.num_beside,
        num_bytes=sum(entry.size for entry in survey.files),
        num_groups=0 if descriptor and descriptor.is_of_drives else num_groups(survey.shards),
        num_rollouts=sum(len(shard.rollout_ids) for shard in survey.shards),
        rows=rows,
    )
