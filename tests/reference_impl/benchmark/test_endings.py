"""A benchmark of a release that tells how drives end reports it, and the release is valid with it."""

from __future__ import annotations

import json
from pathlib import Path

from tests.reference_impl.benchmark.small_release import invoke, smallest_protocol, write_protocol
from tests.synthetic_release import SEED, raw_descriptor, raw_tables
from tests.validator.engine.rules.draft import Draft

from branchdrive.benchmark.protocol.protocol import default_protocol
from branchdrive.benchmark.ranking.ending_table import LIMITS
from branchdrive.contract.layout import CARD_FILE, RESULTS_FILE
from branchdrive.engine.validate import validate
from branchdrive.release.builder import STAGES, build_release
from branchdrive.release.stage import BuildOptions


def test_ends_of_drives_are_reported_on_every_surface(tmp_path: Path) -> None:
    root = Draft(raw_tables(), raw_descriptor()).write(tmp_path / "dataset")
    stages = [stage for stage in STAGES if stage != "leakage"]
    build_release(root, stages=stages, options=BuildOptions(SEED, tables=frozenset({"endings"})))
    document = {**smallest_protocol(), "outcomes": default_protocol().document["outcomes"]}
    protocol = write_protocol(tmp_path / "protocol.json", document)
    said = invoke("benchmark", root, "--protocol", protocol, "--no-guard")
    assert LIMITS in said
    report = validate(root)
    assert (report.verdict, report.errors) == ("valid", ())
    for profile in json.loads((root / RESULTS_FILE).read_bytes())["ranking"]["profiles"]:
        assert all("endings" in entry["outcomes"] for entry in profile["entries"])
    assert LIMITS in (root / CARD_FILE).read_text()
    assert (root / "benchmark/figures/selected_endings.svg").is_file()
