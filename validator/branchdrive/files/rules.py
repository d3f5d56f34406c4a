"""Rules on files: layout and limits, the descriptor, and tables before their values are looked at.

Source: spec/03-layout.md, spec/09-security.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from branchdrive.contract.columns import TABLES
from branchdrive.contract.companion import IGNORE_FILE
from branchdrive.contract.encoding import ENCODING_NAME, encoding_digest
from branchdrive.contract.layer import LAYERS
from branchdrive.contract.layout import (
    CARD_FILE,
    DESCRIPTOR_FILE,
    LICENCE_FILE,
    MANIFEST_FILE,
    RAW_DIR,
    STAGING_DIR,
    folded,
    shard_index,
    unsafe_reason,
)  # fmt: skip
from branchdrive.contract.machine_trace import trace_mismatches
from branchdrive.contract.mismatch import Check, Location, Mismatch, PreconditionError
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError
from branchdrive.files.survey import NOT_READ, Survey
from branchdrive.formats.manifest import SAFE_PATH, Manifest
from branchdrive.formats.store import Entry

TABLE_FILES = {table.file_name for table in TABLES.values()}

_DESCRIPTOR: Location = {"file": DESCRIPTOR_FILE}


def _require_whole(survey: Survey) -> None:
    """For rules on what is not there.

    Raises:
        PreconditionError: The files were not read, and maybe not even listed to the end.
    """
    if survey.excess:
        raise PreconditionError(NOT_READ)


@rule("BD-LAY-001")
def manifest_is_well_formed(survey: Survey) -> Iterator[Check]:
    """`MANIFEST.sha256` is there and its text parses."""
    found = [mismatch for mismatch in survey.manifest_mismatches if mismatch.expected != SAFE_PATH]
    if survey.manifest is None and not found:
        is_begun = any(entry.path == STAGING_DIR for entry in survey.entries)
        state = "was interrupted or goes on, as its working area says" if is_begun else "never finished"
        expected = "MANIFEST.sha256, written last"
        found.append(Mismatch({"file": MANIFEST_FILE}, expected, f"no manifest: writing {state}"))
    yield Check.of(1, tuple(found))


@rule("BD-LAY-002")
def digests_match(survey: Survey) -> Iterator[Check]:
    """SHA-256 of every listed file that is there equals the manifest's."""
    listed = survey.manifest.files if survey.manifest else {}
    read = {path: digest for path, digest in survey.digests.items() if path in listed}
    found = [
        Mismatch({"file": path}, f"sha256 {listed[path]}", f"sha256 {digest}")
        for path, digest in sorted(read.items())
        if digest != listed[path]
    ]
    found += [
        Mismatch({"file": path}, f"sha256 {listed[path]}", reason)
        for path, reason in sorted(survey.unreadable.items())
        if path in listed
    ]
    yield Check.of(len(read), tuple(found))


@rule("BD-LAY-003")
def listed_files_exist(survey: Survey) -> Iterator[Check]:
    """Every path of the manifest is there, and is not a folder; links and devices are BD-LAY-006's."""
    _require_whole(survey)
    listed = survey.manifest.files if survey.manifest else {}
    there = {entry.path for entry in survey.entries if entry.kind != "folder"}
    missing = [path for path in listed if path not in there]
    found = [Mismatch({"file": path}, "a file that the manifest lists", "no such file") for path in missing]
    yield Check.of(len(listed), tuple(found))


@rule("BD-LAY-004")
def existing_files_are_listed(survey: Survey) -> Iterator[Check]:
    """Every regular file but the manifest is listed; a writer's working area counts as one file."""
    _require_whole(survey)
    if not survey.folder.lists_all:
        raise PreconditionError("a web server lists nothing: files that the manifest does not name are not seen")
    listed = survey.manifest.files if survey.manifest else {}
    files = [e.path for e in survey.files if e.path != MANIFEST_FILE and not e.path.startswith(f"{STAGING_DIR}/")]
    found = [
        Mismatch({"file": path}, "a file that the manifest lists", "not listed") for path in files if path not in listed
    ]
    if any(entry.path == STAGING_DIR for entry in survey.entries):
        found.append(
            Mismatch(
                {"file": STAGING_DIR},
                "a finished dataset",
                "the working area of a command that did not finish, or of a benchmark that waits for `evaluate`; "
                "go on with it, or delete the folder",
            )
        )
    yield Check.of(len(files), tuple(found))


@rule("BD-LAY-005")
def paths_are_safe(survey: Survey) -> Iterator[Check]:
    """No path leaves the root or is not plain, and no two are one where case and form of letters do not count."""
    found = [mismatch for mismatch in survey.manifest_mismatches if mismatch.expected == SAFE_PATH]
    for entry in survey.entries:
        reason = unsafe_reason(entry.path)
        if reason is not None and "longer" not in reason and "deeper" not in reason:
            found.append(Mismatch({"file": entry.path}, SAFE_PATH, f"{quote(entry.path)} {reason}"))
    known: dict[str, str] = {}
    for path in sorted(entry.path for entry in survey.entries):
        other = known.setdefault(folded(path), path)
        if other != path:
            text = f"{quote(path)}, which is {quote(other)} where case or form of letters do not count"
            found.append(Mismatch({"file": path}, "a path that is one file on every system", text))
    listed = len(survey.manifest.files) if survey.manifest else 0
    yield Check.of(listed + len(survey.entries), tuple(found))


@rule("BD-LAY-006")
def only_files_and_folders(survey: Survey) -> Iterator[Check]:
    """No links, devices, sockets or pipes, and no folder that cannot be listed."""
    kinds = {
        "link": "a symbolic link",
        "stray_link": "a symbolic link to nothing that it may lead to",
        "known_folder": "a folder that another path leads to as well",
        "file_and_folder": "a file and a folder under one name",
        "special": "a special file",
        "unreadable": "nothing that can be read",
    }
    wrong = (entry for entry in survey.entries if entry.kind in kinds)
    found = [Mismatch({"file": entry.path}, "a regular file or folder", kinds[entry.kind]) for entry in wrong]
    yield Check.of(len(survey.entries), tuple(found))


@rule("BD-LAY-010")
def ignore_file_is_bounded(survey: Survey) -> Iterator[Check]:
    """The ignore file, where there is one, is bounded text of patterns of names."""
    wanted, error = "patterns of names, one a line, within the limits", survey.ignore_error
    found = () if error is None else (Mismatch({"file": IGNORE_FILE}, wanted, error),)
    yield Check.of(int(survey.has_ignore_file), found)


@rule("BD-LAY-007")
def limits_hold(survey: Survey) -> Iterator[Check]:
    """File count, path length, depth, stored and decoded sizes stay under `limits.json`."""
    found = [*survey.excess]
    for entry in survey.entries:
        reason = unsafe_reason(entry.path)
        if reason is not None and ("longer" in reason or "deeper" in reason):
            found.append(Mismatch({"file": entry.path}, "a path within the limits", reason))
    for shard in survey.shards:
        found += [
            Mismatch({"file": path}, f"a {'table' if path.endswith('.parquet') else 'file'} within the limits", reason)
            for path, reason in shard.over_limit.items()
        ]
    yield Check.of(len(survey.entries), tuple(found))


@rule("BD-LAY-008")
def derived_digests_recompute(survey: Survey) -> Iterator[Check]:
    """Layer digests and identity follow from the manifest's file lines."""
    if survey.manifest is None:
        yield Check.of(0, ())
        return
    derived = Manifest.of(survey.manifest.files)
    found = []
    for layer in sorted({*derived.layers, *survey.manifest.layers}):
        wanted, listed = (
            derived.layers.get(layer, "no such layer"),
            survey.manifest.layers.get(layer, "not stated"),
        )
        if wanted != listed:
            found.append(Mismatch({"file": MANIFEST_FILE, "pointer": f"layer {layer}"}, wanted, listed))
    if derived.identity != survey.manifest.identity:
        found.append(
            Mismatch({"file": MANIFEST_FILE, "pointer": "dataset"}, derived.identity, survey.manifest.identity)
        )
    yield Check.of(len(derived.layers) + 1, tuple(found))


def _has_place(entry: Entry) -> bool:
    match entry.path.split("/"):
        case [name]:
            if entry.kind == "file":
                return name in (DESCRIPTOR_FILE, MANIFEST_FILE, CARD_FILE, LICENCE_FILE)
            return name in (RAW_DIR, STAGING_DIR, *LAYERS)
        case [folder, *_] if folder == STAGING_DIR:
            return True
        case [folder, shard] if folder == RAW_DIR:
            return entry.kind != "file" and shard_index(shard) is not None
        case [folder, shard, *rest] if folder == RAW_DIR and shard_index(shard) is not None:
            return len(rest) == 1 and entry.kind == "file"
        case [folder, _] if folder in LAYERS:
            if entry.kind != "file":
                return LAYERS[folder].holds_folder(entry.path)
            return LAYERS[folder].admits(entry.path) or LAYERS[folder].admits_free(entry.path)
        case [folder, _, _] if folder in LAYERS:
            return entry.kind == "file" and LAYERS[folder].admits_free(entry.path)
        case _:
            return False


def _is_working_file(name: str) -> bool:
    """Whether a writer left it: a table under more than its name, or a suffix of what is not complete."""
    return name.startswith(tuple(TABLE_FILES)) or name.endswith((".tmp", ".part", ".partial"))


_NO_PLACE = ("none", "none, though the manifest lists it")


@rule("BD-LAY-009")
def files_have_a_place(survey: Survey) -> Iterator[Check]:
    """The root holds descriptor, manifest and claimed layers; shards hold tables of claimed streams and media.

    Where the descriptor is refused, its claims are not known, and every layer, table and medium has a place.
    """
    _require_whole(survey)
    plain = [e for e in survey.entries if e.kind in ("file", "folder") and unsafe_reason(e.path) is None]
    listed = survey.manifest.files if survey.manifest else {}
    lost = [(e.path, e.path in listed) for e in plain if not _has_place(e)]
    found = [Mismatch({"file": path}, "a place in the layout", _NO_PLACE[is_listed]) for path, is_listed in lost]
    layers = (RAW_DIR, *LAYERS) if survey.descriptor is None else survey.descriptor.layers
    tables = tuple(TABLES) if survey.descriptor is None else survey.descriptor.tables
    unclaimed = {RAW_DIR, *LAYERS} - set(layers)
    beyond = "a file that no claim covers"
    found += [Mismatch({"file": e.path}, "a file of a claimed layer", beyond) for e in plain if e.path in unclaimed]
    has_media = "frames" in tables
    code = {path: kind for shard in survey.shards for path, kind in shard.stored_code.items()}
    claimed = {TABLES[name].file_name for name in tables}
    for files in survey.shard_folders.values():
        for entry in files:
            name = entry.path.rsplit("/", 1)[1]
            if name in TABLE_FILES and name not in claimed:
                found.append(
                    Mismatch({"file": entry.path}, "tables of claimed streams", "a table that no claim covers")
                )
            elif name not in TABLE_FILES and not has_media and _has_place(entry):
                found.append(Mismatch({"file": entry.path}, "tables of claimed streams", beyond))
            elif name not in TABLE_FILES and _has_place(entry) and _is_working_file(name):
                found.append(Mismatch({"file": entry.path}, "tables and media", "a working file of a writer"))
            elif entry.path in code and _has_place(entry):
                found.append(Mismatch({"file": entry.path}, "tables and media", f"{code[entry.path]}: stored code"))
    yield Check.of(len(plain), tuple(found))


@rule("BD-DOC-001")
def documents_parse(survey: Survey) -> Iterator[Check]:
    """The descriptor is bounded, well-formed JSON."""
    found = [Mismatch(_DESCRIPTOR, "a JSON document", survey.document_error)] if survey.document_error else []
    yield Check.of(1, tuple(found))


@rule("BD-DOC-002")
def spec_version_is_known(survey: Survey) -> Iterator[Check]:
    """``spec_version`` is the one that this validator implements."""
    if survey.document_error is not None:
        yield Check.of(0, ())
        return
    version = survey.document.get("spec_version") if isinstance(survey.document, dict) else None
    mismatch = Mismatch({**_DESCRIPTOR, "pointer": "/spec_version"}, quote(SPEC_VERSION), quote(version))
    yield Check.of(1, () if version == SPEC_VERSION else (mismatch,))


@rule("BD-DOC-003")
def documents_conform(survey: Survey) -> Iterator[Check]:
    """The descriptor meets its JSON Schema."""
    yield Check.of(
        int(survey.document_error is None), (found.within(_DESCRIPTOR) for found in survey.schema_mismatches)
    )


@rule("BD-DOC-004")
def descriptor_agrees_with_itself(survey: Survey) -> Iterator[Check]:
    """What no schema can say: unique keys, one nominal policy, cameras of the claimed streams."""
    judged = survey.descriptor is not None or bool(survey.conflicts)
    yield Check.of(int(judged), (found.within(_DESCRIPTOR) for found in survey.conflicts))


@rule("BD-DOC-006")
def scenario_types_are_those_of_the_plan(survey: Survey) -> Iterator[Check]:
    """Attempts are of the scenario types that the descriptor names, where it names any."""
    planned = survey.descriptor.collection.scenario_types if survey.descriptor is not None else ()
    others = sorted(set().union(*(shard.scenario_types for shard in survey.shards)) - {*planned, ""})
    place = {**_DESCRIPTOR, "pointer": "/collection/scenario_types"}
    text = f"none of {', '.join(map(quote, others[:4]))}, which attempts have"
    found = [Mismatch(place, "every scenario type of the attempts, or none", text, len(others))]
    yield Check.of(len(survey.shards) if planned else 0, found if planned and others else ())


@rule("BD-DOC-005")
def descriptor_names_no_machine(survey: Survey) -> Iterator[Check]:
    """No text of the descriptor holds a path, a host or a time of the machine that wrote it."""
    judged = survey.document_error is None
    found = trace_mismatches(survey.document) if judged else ()
    yield Check.of(int(judged), (mismatch.within(_DESCRIPTOR) for mismatch in found))


@rule("BD-ENC-001")
def encoding_recomputes(survey: Survey) -> Iterator[Check]:
    """The digest of a declared `bd29` encoding is that of the bank's matrix.

    Raises:
        PreconditionError: It is an encoding of another name.
    """
    declared = survey.descriptor.action_encoding if survey.descriptor else None
    if survey.descriptor is None or declared is None:
        yield Check.of(0, ())
        return
    if declared.name != ENCODING_NAME:
        raise PreconditionError(f"the encoding {quote(declared.name)} is the dataset's own and cannot be recomputed")
    place: Location = {**_DESCRIPTOR, "pointer": "/action_encoding"}
    try:
        digest = encoding_digest(survey.descriptor.action_bank)
    except UsageError as error:
        yield Check.of(1, (Mismatch(place, f"a bank in the domain of `{ENCODING_NAME}`", str(error)),))
        return
    place = {**place, "pointer": "/action_encoding/sha256"}
    mismatch = Mismatch(place, f"sha256 {digest}", f"sha256 {declared.sha256}")
    yield Check.of(1, () if declared.sha256 == digest else (mismatch,))


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
    of_files = [(path, mismatches) for files in shards for path, mismatches in files.items()]
    every = [found.within({"file": path}) for path, mismatches in of_files for found in mismatches]
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

    A table that the manifest lists and that is not there is a missing file, not a missing claim.
    """
    _require_whole(survey)
    if survey.descriptor is None or not (survey.descriptor.has_raw or survey.shards):
        yield Check.of(0, ())
        return
    listed = survey.manifest.files if survey.manifest else {}
    tables = survey.descriptor.tables
    wanted = [f"{shard.folder}/{n}.parquet" for shard in survey.shards for n in tables if n not in shard.present]
    unlisted = [path for path in wanted if path not in listed]
    found = [Mismatch({"file": path}, "a table of a claimed stream", "no such file") for path in unlisted]
    if not survey.shards:
        found.append(Mismatch({"file": "raw"}, "at least one shard", "none"))
    num_claimed = len(survey.shards) * len(tables)
    yield Check.of(num_claimed - len(wanted) + len(unlisted), tuple(found))


@rule("BD-TAB-005")
def metadata_name_no_machine(survey: Survey) -> Iterator[Check]:
    """No key-value pair of a file's footer holds a path, a host or a time of the machine that wrote it."""
    yield _columns(survey, [shard.trace_mismatches for shard in survey.shards])


@rule("BD-TAB-006")
def raw_layer_holds_an_attempt(survey: Survey) -> Iterator[Check]:
    """The rollouts tables of all shards have a row."""
    num_attempts = sum(shard.rows.get("rollouts", 0) for shard in survey.shards)
    is_empty = bool(survey.shards) and not num_attempts
    lacking = Mismatch({"table": "rollouts"}, "at least one attempt", "no row in any shard")
    yield Check.of(int(bool(survey.shards)), (lacking,) if is_empty else ())
