"""Table rules: Parquet files decode and have the declared columns. Source: spec/03-layout.md#tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from branchdrive.contract.mismatch import Check, Mismatch
from branchdrive.contract.rule import rule
from branchdrive.files.survey import Survey


@rule("BD-TAB-001")
def tables_decode(survey: Survey) -> Iterator[Check]:
    """Every page of every table decodes; a file that its digest already condemns is not blamed twice."""
    found = [
        Mismatch({"file": path}, "a table that decodes", reason)
        for shard in survey.shards
        for path, reason in shard.undecodable.items()
        if not survey.is_damaged(path)
    ]
    num_damaged = sum(survey.is_damaged(path) for shard in survey.shards for path in shard.undecodable)
    yield Check.of(sum(shard.num_tables for shard in survey.shards) - num_damaged, tuple(found))


def _columns(survey: Survey, shards: Sequence[Mapping[str, Sequence[Mismatch]]]) -> Check:
    """Mismatches of columns by file and shard; every decoded table was examined."""
    every = [
        found.within({"file": path}) for files in shards for path, mismatches in files.items() for found in mismatches
    ]
    return Check.of(sum(len(shard.rows) for shard in survey.shards), every)


@rule("BD-TAB-002")
def tables_have_declared_columns(survey: Survey) -> Iterator[Check]:
    """Names and types of the columns are those of columns.json."""
    yield _columns(survey, [shard.type_mismatches for shard in survey.shards])


@rule("BD-TAB-003")
def columns_carry_metadata(survey: Survey) -> Iterator[Check]:
    """Unit, frame, shape and track of every column are recorded as declared."""
    yield _columns(survey, [shard.metadata_mismatches for shard in survey.shards])


@rule("BD-TAB-004")
def shards_hold_claimed_tables(survey: Survey) -> Iterator[Check]:
    """Each shard holds every table of the claimed streams, and there is at least one shard.

    A table that the manifest lists and nobody finds is a missing file, not a missing claim.
    """
    if survey.descriptor is None or not (survey.descriptor.has_raw or survey.shards):
        yield Check.of(0, ())
        return
    listed = survey.manifest.files if survey.manifest else {}
    wanted = [
        f"{shard.folder}/{name}.parquet"
        for shard in survey.shards
        for name in survey.descriptor.tables
        if name not in shard.present
    ]
    found = [
        Mismatch({"file": path}, "a table of a claimed stream", "no such file") for path in wanted if path not in listed
    ]
    if not survey.shards:
        found.append(Mismatch({"file": "raw"}, "at least one shard", "none"))
    yield Check.of(max(1, len(survey.shards) * len(survey.descriptor.tables)), tuple(found))


@rule("BD-TAB-005")
def raw_layer_holds_an_attempt(survey: Survey) -> Iterator[Check]:
    """The rollouts tables of all shards have a row."""
    num_attempts = sum(shard.rows.get("rollouts", 0) for shard in survey.shards)
    is_empty = bool(survey.shards) and not num_attempts
    lacking = Mismatch({"table": "rollouts"}, "at least one attempt", "no row in any shard")
    yield Check.of(int(bool(survey.shards)), (lacking,) if is_empty else ())
