"""Descriptors and manifests of strangers: whatever stands there, a finding and a verdict."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests import synthetic
from tests.audits import validate_once
from tests.sampling import sampled
from tests.validator.engine.datasets import failing, status, write, write_with

from branchdrive.contract.document import schema_mismatches

SECRET = b"nobody may read this"


DEEP = 100_000
DOCUMENTS: dict[str, bytes] = {
    "empty": b"",
    "blank": b" \n",
    "no JSON": b"title: a dataset\n",
    "cut off": json.dumps(synthetic.descriptor()).encode()[:500],
    "two documents": b"{} {}",
    "no UTF-8": b'{"title": "\xff"}',
    "UTF-16": json.dumps(synthetic.descriptor()).encode("utf-16"),
    "byte order mark": b"\xef\xbb\xbf{}",
    "NaN": b'{"tolerances": {"actuator": NaN}}',
    "infinity": b'{"tolerances": {"actuator": -Infinity}}',
    "number out of range": b'{"tolerances": {"actuator": 1e999}}',
    "number of a million digits": b'{"seed": ' + b"9" * 1_000_000 + b"}",
    "repeated key": b'{"a": 1, "a": 2}',
    "half a surrogate": b'{"title": "\\ud800"}',
    "deep lists": b"[" * DEEP + b"]" * DEEP,
    "deep lists, open": b"[" * DEEP,
    "deep objects": b'{"a":' * DEEP + b"1" + b"}" * DEEP,
    "5 MB": b'{"title": "' + b"x" * 5_000_000 + b'"}',
    "random": bytes(range(256)) * 20,
}


@pytest.mark.parametrize("content", DOCUMENTS.values(), ids=DOCUMENTS)
def test_a_descriptor_that_is_no_json_is_one_finding(content: bytes, tmp_path: Path) -> None:
    report = validate_once(write_with(tmp_path / "dataset", {"branchdrive.json": content}))
    assert (report.verdict, report.errors, failing(report)) == ("invalid", (), {"BD-DOC-001"})
    assert {t.reason for t in report.tallies if t.rule_id == "BD-VAL-001"} == {"the descriptor is unusable"}


@pytest.mark.parametrize(
    "document",
    [[], {}, None, 0, 1.5, True, "", "0.1", [synthetic.descriptor()], {"spec_version": ["0.1"]}, {"spec_version": 0.1}],
    ids=repr,
)
def test_a_descriptor_of_another_type_or_version_is_a_finding(document: Any, tmp_path: Path) -> None:
    content = json.dumps(document).encode()
    report = validate_once(write_with(tmp_path / "dataset", {"branchdrive.json": content}))
    assert (report.verdict, report.errors, failing(report)) == ("invalid", (), {"BD-DOC-002"})


ODD_VALUES = [None, [], {}, "", "x", -1, 0, 1e308, True, [[]], {"a": {}}, [None] * 50, 2**63, "\x00\u202e"]


@pytest.mark.parametrize("key", sampled(sorted(synthetic.descriptor()), every=2))
def test_properties_of_other_types_are_findings(key: str, tmp_path: Path) -> None:
    for value in ODD_VALUES:
        document = {**synthetic.descriptor(), key: value}
        report = validate_once(write(tmp_path / "dataset", {}, document))
        assert (report.verdict, report.errors) == ("invalid", ())
        if schema_mismatches(document, "descriptor.schema.json"):
            assert failing(report) & {"BD-DOC-002", "BD-DOC-003"}
        else:
            assert not failing(report) & {"BD-DOC-001", "BD-DOC-002", "BD-DOC-003"}


def test_a_descriptor_of_many_wrong_properties_ends_soon(tmp_path: Path) -> None:
    faults = {f"fault {i}": -1 for i in range(50_000)}
    document = {**synthetic.descriptor(), "collection": {"seed": 1, "faults": faults}}
    report = validate_once(write(tmp_path / "dataset", document=document))
    assert (report.verdict, report.errors, failing(report)) == ("invalid", (), {"BD-DOC-003"})


# --- manifests

LINE = b"0" * 64 + b"  raw/shard-00000/controls.parquet\n"
MANIFESTS: dict[str, bytes] = {
    "empty": b"",
    "every byte": bytes(range(256)) * 40,
    "10 MB of garbage": b"garbage " * 1_300_000,
    "10 MB of lines": b"garbage\n" * 1_300_000,
    "10 MB of one line": b"# branchdrive-manifest 0.1\n" + b"0" * 10_000_000,
    "the same file 100,000 times": b"# branchdrive-manifest 0.1\n" + LINE * 100_000,
    "no UTF-8": b"# branchdrive-manifest 0.1\n" + LINE.replace(b"raw", b"\xff\xff\xff"),
    "paths that leave the root": b"# branchdrive-manifest 0.1\n" + LINE.replace(b"raw/shard-00000", b"../../../etc"),
    "absolute paths": b"# branchdrive-manifest 0.1\n" + LINE.replace(b"raw/shard-00000", b"/etc"),
    "Windows line ends": b"# branchdrive-manifest 0.1\r\n" + LINE.replace(b"\n", b"\r\n"),
}


@pytest.mark.parametrize("content", MANIFESTS.values(), ids=MANIFESTS)
def test_garbage_in_the_place_of_the_manifest_is_a_finding(content: bytes, tmp_path: Path) -> None:
    root = write(tmp_path / "dataset")
    (root / "MANIFEST.sha256").write_bytes(content)
    report = validate_once(root)
    assert (report.verdict, report.errors) == ("invalid", ())
    assert "BD-LAY-001" in failing(report)
    assert status(report, "BD-VAL-001") == "pass"


def test_a_path_that_leaves_the_root_is_named_and_not_opened(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(SECRET)
    root = write(tmp_path / "dataset")
    manifest = (root / "MANIFEST.sha256").read_bytes()
    (root / "MANIFEST.sha256").write_bytes(manifest + b"0" * 64 + b"  ../secret\n")
    report = validate_once(root)
    assert report.verdict == "invalid"
    assert "BD-LAY-005" in failing(report)
