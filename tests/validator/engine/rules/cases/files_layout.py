"""Defects and limits of files: manifest, digests, paths, kinds, sizes, places."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
from tests.synthetic import BRANCH_TICK, MEDIA_FILE, STRIDE
from tests.validator.engine.rules.case import (
    NOMINAL,
    SHARD_0,
    SHARD_1,
    boundary,
    mutant,
)
from tests.validator.engine.rules.cases.media_archives import repeated
from tests.validator.engine.rules.draft import Draft
from tests.validator.engine.rules.semantic_map import add_semantic_map

from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE, STAGING_DIR
from branchdrive.contract.limits import spec_limits
from branchdrive.formats.folder import Folder
from branchdrive.formats.manifest import Manifest, build_manifest

CONTROLS = f"{SHARD_1}/controls.parquet"


MEDIA = f"{SHARD_1}/{MEDIA_FILE}"


OTHER_DIGEST = "0" * 64


def _flip(root: Path, path: str, place: int) -> None:
    content = bytearray((root / path).read_bytes())
    content[place] ^= 1
    (root / path).write_bytes(content)


def _truncate(root: Path, path: str, size: int) -> None:
    os.truncate(root / path, size)


# BD-LAY-001


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_was_never_written(d: Draft) -> None:
    d.is_sealed = False


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_is_of_another_version(d: Draft) -> None:
    d.edit_manifest(lambda text: text.replace("branchdrive-manifest 0.1", "branchdrive-manifest 9.9"))


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_is_cut_off(d: Draft) -> None:
    d.edit_manifest(lambda text: text[:-1])


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_lists_a_path_twice(d: Draft) -> None:
    d.edit_manifest(lambda text: text + text.splitlines()[-1] + "\n")


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_is_out_of_order(d: Draft) -> None:
    def swap(text: str) -> str:
        *head, last, least = text.splitlines(keepends=True)
        return "".join([*head, least, last])

    d.edit_manifest(swap)


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_has_no_identity(d: Draft) -> None:
    d.edit_manifest(lambda text: re.sub("# dataset .*\n", "", text))


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_has_upper_case_digests(d: Draft) -> None:
    d.edit_manifest(
        lambda text: re.sub(f"(?m)^[0-9a-f]{{64}}  {CONTROLS}", lambda m: m[0][:64].upper() + m[0][64:], text)
    )


@mutant("BD-LAY-001", at={"file": MANIFEST_FILE})
def manifest_lists_itself(d: Draft) -> None:
    d.edit_manifest(
        lambda text: text.replace(f"  {DESCRIPTOR_FILE}", f"  {MANIFEST_FILE}\n{OTHER_DIGEST}  {DESCRIPTOR_FILE}")
    )


@boundary("BD-LAY-001", "BD-LAY-005", base="media")
def path_in_another_script(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_1 / "вид спереди..1.bin").write_bytes(b"more"))


# BD-LAY-002


@mutant("BD-LAY-002", base="media", at={"file": MEDIA})
def byte_of_media_flipped(d: Draft) -> None:
    d.after_seal(lambda root: _flip(root, MEDIA, 7))


@mutant("BD-LAY-002", at={"file": CONTROLS})
def byte_of_footer_flipped(d: Draft) -> None:
    d.after_seal(lambda root: _flip(root, CONTROLS, -1))


@mutant("BD-LAY-002", at={"file": CONTROLS})
def table_truncated(d: Draft) -> None:
    d.after_seal(lambda root: _truncate(root, CONTROLS, 1000))


@mutant("BD-LAY-002", at={"file": CONTROLS})
def table_emptied(d: Draft) -> None:
    d.after_seal(lambda root: _truncate(root, CONTROLS, 0))


@mutant("BD-LAY-002", at={"file": DESCRIPTOR_FILE})
def descriptor_edited(d: Draft) -> None:
    def retitle(root: Path) -> None:
        path = root / DESCRIPTOR_FILE
        path.write_text(path.read_text().replace("A small valid dataset", "A small edited dataset"))

    d.after_seal(retitle)


@boundary("BD-LAY-002", "BD-LAY-003", base="media")
def empty_file(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_1 / "empty.bin").write_bytes(b""))


# BD-LAY-003


@mutant("BD-LAY-003", at={"file": CONTROLS})
def table_removed(d: Draft) -> None:
    d.after_seal(lambda root: (root / CONTROLS).unlink())


@mutant("BD-LAY-003", base="media", at={"file": MEDIA})
def media_removed(d: Draft) -> None:
    d.after_seal(lambda root: (root / MEDIA).unlink())


@mutant("BD-LAY-003", at={"file": f"{SHARD_1}/rollouts.parquet"}, findings=5)
def shard_removed(d: Draft) -> None:
    def remove(root: Path) -> None:
        for path in (root / SHARD_1).iterdir():
            path.unlink()
        (root / SHARD_1).rmdir()

    d.after_seal(remove)


@mutant("BD-LAY-003", at={"file": SHARD_1})
def folder_listed_as_a_file(d: Draft) -> None:
    def list_it(root: Path) -> None:
        files = {**build_manifest(Folder(root)).files, SHARD_1: OTHER_DIGEST}
        (root / MANIFEST_FILE).write_bytes(Manifest.of(files).render())

    d.after_seal(list_it)


# BD-LAY-004


def _forget(root: Path, path: str) -> None:
    files = dict(build_manifest(Folder(root)).files)
    del files[path]
    (root / MANIFEST_FILE).write_bytes(Manifest.of(files).render())


@mutant("BD-LAY-004", at={"file": CONTROLS})
def table_not_listed(d: Draft) -> None:
    d.after_seal(lambda root: _forget(root, CONTROLS))


@mutant("BD-LAY-004", at={"file": DESCRIPTOR_FILE})
def descriptor_not_listed(d: Draft) -> None:
    d.after_seal(lambda root: _forget(root, DESCRIPTOR_FILE))


@mutant("BD-LAY-004", base="media", at={"file": f"{SHARD_0}/.late.bin"})
def hidden_file_added(d: Draft) -> None:
    d.after_seal(lambda root: (root / SHARD_0 / ".late.bin").write_bytes(b"late"))


@mutant("BD-LAY-004", at={"file": STAGING_DIR})
def working_area_left(d: Draft) -> None:
    def leave(root: Path) -> None:
        (root / STAGING_DIR / "groups").mkdir(parents=True)
        (root / STAGING_DIR / "groups" / "g9").write_bytes(b"open")

    d.after_seal(leave)


@boundary("BD-LAY-004", base="media")
def hidden_file_that_is_listed(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / ".thumbnails").write_bytes(b"small"))


# BD-LAY-005


@mutant("BD-LAY-005", at={"file": MANIFEST_FILE})
def manifest_path_leaves_the_root(d: Draft) -> None:
    d.edit_manifest(lambda text: f"{text}{OTHER_DIGEST}  raw/../../secret\n")


@mutant("BD-LAY-005", at={"file": MANIFEST_FILE})
def manifest_path_is_absolute(d: Draft) -> None:
    d.edit_manifest(lambda text: f"{text}{OTHER_DIGEST}  /etc/passwd\n")


@mutant("BD-LAY-005", at={"file": MANIFEST_FILE})
def manifest_path_has_a_backslash(d: Draft) -> None:
    d.edit_manifest(lambda text: f"{text}{OTHER_DIGEST}  raw\\x\n")


@mutant("BD-LAY-005", base="media", at={"file": f"{SHARD_0}/c:"})
def name_is_a_drive(d: Draft) -> None:
    d.after_seal(lambda root: (root / SHARD_0 / "c:").write_bytes(b""))


@mutant("BD-LAY-005", base="media")
def name_reverses_the_line(d: Draft) -> None:
    d.after_seal(lambda root: (root / SHARD_0 / "gpj.\u202egnp").write_bytes(b""))


@mutant("BD-LAY-005", base="media")
def name_is_not_unicode(d: Draft) -> None:
    d.after_seal(lambda root: Path(os.fsdecode(os.fsencode(root / SHARD_0) + b"/\xff")).write_bytes(b""))


@mutant("BD-LAY-005", base="media", at={"file": f"{SHARD_0}/rear.bin"})
def names_that_differ_in_case(d: Draft) -> None:
    for name in ("Rear.bin", "rear.bin"):
        d.before_seal(lambda root, name=name: (root / SHARD_0 / name).write_bytes(b""))


@mutant("BD-LAY-005", base="media", at={"file": f"{SHARD_0}/\\xe9.bin"})
def names_that_differ_in_the_form_of_a_letter(d: Draft) -> None:
    for name in ("e\u0301.bin", "\u00e9.bin"):
        d.before_seal(lambda root, name=name: (root / SHARD_0 / name).write_bytes(b""))


@boundary("BD-LAY-005", base="media")
def names_of_equal_letters_in_two_shards(d: Draft) -> None:
    for folder, name in ((SHARD_0, "Rear.bin"), (SHARD_1, "rear.bin")):
        d.before_seal(lambda root, folder=folder, name=name: (root / folder / name).write_bytes(b""))


# BD-LAY-006


def _link(root: Path, path: str, target: str) -> None:
    (root / path).unlink(missing_ok=True)
    (root / path).symlink_to(target)


@mutant("BD-LAY-006", at={"file": CONTROLS})
def link_in_place_of_a_table(d: Draft) -> None:
    d.after_seal(lambda root: _link(root, CONTROLS, "../shard-00000/controls.parquet"))


@mutant("BD-LAY-006", base="media", at={"file": f"{SHARD_0}/passwd"})
def link_out_of_the_root(d: Draft) -> None:
    d.after_seal(lambda root: _link(root, f"{SHARD_0}/passwd", "/etc/passwd"))


@mutant("BD-LAY-006", at={"file": "raw/shard-00002"})
def link_to_a_folder(d: Draft) -> None:
    d.after_seal(lambda root: _link(root, "raw/shard-00002", "shard-00000"))


@mutant("BD-LAY-006", at={"file": f"{SHARD_0}/evidence.parquet"})
def pipe_in_place_of_a_table(d: Draft) -> None:
    def pipe(root: Path) -> None:
        (root / SHARD_0 / "evidence.parquet").unlink()
        os.mkfifo(root / SHARD_0 / "evidence.parquet")

    d.after_seal(pipe)


@boundary("BD-LAY-006", base="media")
def second_name_of_one_file(d: Draft) -> None:
    d.before_seal(lambda root: os.link(root / MEDIA, root / SHARD_1 / "again.bin"))


# BD-LAY-007


def _name_of_path_bytes(num_bytes: int) -> str:
    return "m" * (num_bytes - len(SHARD_0) - 1)


@mutant("BD-LAY-007", base="media", at={"file": f"{SHARD_0}/{_name_of_path_bytes(spec_limits().max_path_bytes + 1)}"})
def path_too_long(d: Draft) -> None:
    name = _name_of_path_bytes(spec_limits().max_path_bytes + 1)
    d.after_seal(lambda root: (root / SHARD_0 / name).write_bytes(b""))


@boundary("BD-LAY-007", base="media")
def path_as_long_as_allowed(d: Draft) -> None:
    name = _name_of_path_bytes(spec_limits().max_path_bytes)
    d.before_seal(lambda root: (root / SHARD_0 / name).write_bytes(b""))


@mutant("BD-LAY-007", at={"file": CONTROLS})
def too_many_columns(d: Draft) -> None:
    count = spec_limits().max_table_columns + 1
    d.tables[SHARD_1]["controls"] = pa.table({f"column_{i}": [0] for i in range(count)})


@mutant("BD-LAY-007", at={"file": CONTROLS})
def too_many_rows(d: Draft) -> None:
    ticks = pa.array(np.zeros(spec_limits().max_table_rows + 1, np.int32))
    d.tables[SHARD_1]["controls"] = pa.table({"tick": ticks})


# BD-LAY-008


def _restate(root: Path, pattern: str) -> None:
    path = root / MANIFEST_FILE
    text = path.read_text()
    assert re.search(pattern, text)
    path.write_text(re.sub(f"({pattern}) [0-9a-f]{{64}}", rf"\1 {OTHER_DIGEST}", text))


@mutant("BD-LAY-008", at={"file": MANIFEST_FILE, "pointer": "layer raw"})
def layer_digest_is_wrong(d: Draft) -> None:
    d.after_seal(lambda root: _restate(root, "# layer raw"))


@mutant("BD-LAY-008", base="media", at={"file": MANIFEST_FILE, "pointer": "layer media"})
def media_digest_is_wrong(d: Draft) -> None:
    d.after_seal(lambda root: _restate(root, "# layer media"))


@mutant("BD-LAY-008", at={"file": MANIFEST_FILE, "pointer": "dataset"})
def identity_is_chosen(d: Draft) -> None:
    d.after_seal(lambda root: _restate(root, "# dataset"))


@mutant("BD-LAY-008", at={"file": MANIFEST_FILE, "pointer": "layer model"})
def layer_without_files_is_stated(d: Draft) -> None:
    d.edit_manifest(lambda text: text.replace("# dataset", f"# layer model {OTHER_DIGEST}\n# dataset"))


@boundary("BD-LAY-008", "BD-LAY-009")
def shard_number_of_six_digits(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_1).rename(root / "raw" / "shard-100000"))


INDEX = {"file": f"{SHARD_0}/frames.parquet"}


@mutant("BD-LAY-007", base="media", at=INDEX)
def range_that_too_many_rows_name(d: Draft) -> None:
    repeated(d, spec_limits().max_range_rows + 1)


@mutant("BD-LAY-007", base="media", at=INDEX)
def semantic_map_of_two_moments(d: Draft) -> None:
    add_semantic_map(d)
    d.duplicate("frames", {"tick": BRANCH_TICK + STRIDE}, rollout_id=NOMINAL, camera="bev")


@mutant("BD-LAY-007", base="media", at=INDEX, findings=2)
def images_of_too_many_pixels(d: Draft) -> None:
    for camera in d.descriptor["cameras"]:
        camera["width_px"] = camera["height_px"] = 16_384


# Several places: what violates a rule is counted


@mutant("BD-LAY-002", base="media", at={"file": f"{SHARD_1}/{MEDIA_FILE}"}, findings=2)
def media_of_two_shards_flipped(d: Draft) -> None:
    d.after_seal(lambda root: [_flip(root, f"{shard}/{MEDIA_FILE}", 7) for shard in (SHARD_0, SHARD_1)])
