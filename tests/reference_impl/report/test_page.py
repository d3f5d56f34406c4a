"""The page: what it holds, that nothing in it comes from elsewhere, and that text of a dataset stays text."""

from __future__ import annotations

import base64
import hashlib
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests import synthetic
from tests.reference_impl.report.reading import Page, made, whole_numbers
from tests.reference_impl.report.samples import HOSTILE, every, written
from tests.synthetic import BRANCH_TICK
from tests.validator.benchmark.samples import data, noise, prediction_set, risk_fit, small_protocol
from tests.validator.quality.release import documents, paper_groups, paper_pairs

from branchdrive import open_dataset, validate
from branchdrive.benchmark.results import results_document
from branchdrive.benchmark.tables import result_sections
from branchdrive.contract.layout import RESULTS_FILE
from branchdrive.errors import DecodeError
from branchdrive_reference.report import gallery
from branchdrive_reference.report.facts import read_report
from branchdrive_reference.report.packing import MISSING
from branchdrive_reference.report.section import sections
from branchdrive_reference.study.study import Study
from branchdrive_reference.study.survey import study_dataset


def counts(future: dict[str, object]) -> list[tuple[int, int]]:
    """Series of a future in the order in which they are packed."""
    rows, commands = int(str(future["rows"])), int(str(future["commands"]))
    found = [(rows, 2)] * 4 + [(rows, 1)] * 3 + [(commands, 2)] + [(commands, 1)] * 3
    for actor in future["actors"]:  # type: ignore[attr-defined]
        if actor[1] >= 0:
            found += [(actor[1], 2)] * 4
    return found


def test_every_group_opens_with_every_candidate(dataset: Path, page: Page) -> None:
    groups = open_dataset(dataset).groups
    assert tuple(group["name"] for group in page.groups) == groups
    keys = [entry["key"] for entry in page.shared["bank"]]
    for group in page.groups:
        assert sorted(future["key"] for future in group["futures"]) == sorted(keys)
        assert group["futures"][0]["key"] == "nominal"


def test_the_data_of_a_group_are_those_of_the_dataset(dataset: Path, page: Page) -> None:
    (first,) = [group for group in page.groups if group["name"] == "g0"]
    shapes = [(first["route"], 2)] * 2 + [shape for future in first["futures"] for shape in counts(future)]
    series = whole_numbers(first["data"].encode(), shapes)
    steps, nominal = page.shared["steps"], open_dataset(dataset).group("g0").nominal
    tick = nominal.column("observations", "tick").astype(int) - nominal.branch_tick
    seen = (tick >= -80) & (tick <= 130)
    assert series[2] == tick[seen].tolist()
    x_m = nominal.column("observations", "x_m")[seen]
    assert np.allclose(np.array(series[3]) * steps["place_m"] + first["at"][0], x_m, atol=steps["place_m"])
    speed_mps = nominal.column("observations", "speed_mps")[seen]
    assert np.allclose(np.array(series[6]) * steps["speed_mps"], speed_mps, atol=steps["speed_mps"])
    gap_m = np.ma.filled(nominal.column("evidence", "separation_m"), np.nan)[seen]
    own = np.array([np.nan if value == MISSING else value * steps["gap_m"] for value in series[7]])
    assert np.allclose(own, gap_m, atol=steps["gap_m"], equal_nan=True)


def test_histories_that_look_alike_are_written_once(page: Page) -> None:
    for group in page.groups:
        shares = [future["shares"] for future in group["futures"]]
        assert not shares[0]
        assert sum(shares) >= 9  # this dataset has noise, which shows in the others


def test_the_page_says_what_validator_and_study_say(dataset: Path, page: Page) -> None:
    report = validate(dataset)
    assert report.verdict in page.text
    for condition in report.conditions:
        assert condition.replace("`", "") in page.text
    assert report.response is not None
    assert all(action.action_key in page.text for action in report.response.actions)
    study: Study = study_dataset(dataset, lambda *_: None)
    assert f"{sum(study.population.attempts.values()):,}: " in page.text
    assert "compared nominal replays" in page.text


def test_equal_datasets_have_equal_reports(dataset: Path, page: Page, tmp_path: Path) -> None:
    again = made(dataset, tmp_path / "again.html")
    assert again.content == page.content


def test_the_policy_allows_the_own_script_and_style_alone(page: Page) -> None:
    (policy,) = [
        str(meta["content"]) for meta in page.of("meta") if meta.get("http-equiv") == "Content-Security-Policy"
    ]
    for name, text in (("script", page.code), ("style", page.style)):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{name}-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "http" not in policy


def test_nothing_is_fetched(page: Page) -> None:
    assert not page.of("link") + page.of("iframe") + page.of("object")
    assert all("src" not in script for script in page.of("script"))
    for _, attributes in page.elements:
        assert not any(name.startswith("on") or name == "style" for name in attributes)
        for name in ("href", "src"):
            assert str(attributes.get(name) or "#").startswith(("#", "data:image/"))
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org/2000/svg)", page.style + page.code)


def test_every_link_leads_somewhere(damaged_page: Page) -> None:
    page = damaged_page
    ids = {attributes["id"] for _, attributes in page.elements if "id" in attributes}
    links = [str(link["href"])[1:] for link in page.of("a")]
    played = [link.split("-", 2) for link in links if link.startswith("play-")]
    assert {link for link in links if not link.startswith("play-")} <= ids
    for _, place, *fault in played:
        found = {one["rule"]: len(one["spots"]) for one in page.groups[int(place)]["faults"]}
        assert all(int(spot[11:]) < found[spot[:10]] for spot in fault)
    assert {place for _, place, *_ in played} == {"0", "1"}


@pytest.mark.parametrize("column", ["scenario_type", "town", "route_id", "environment", "group_id"])
def test_text_of_a_dataset_never_becomes_markup(column: str, page: Page, tmp_path: Path) -> None:
    hostile = made(written(tmp_path / "d", {"rollouts": every(column, HOSTILE)}), tmp_path / "report.html")
    assert not hostile.of("img")
    assert len(hostile.of("script")) == 2 + len(hostile.groups)
    assert hostile.code == page.code
    assert not any(str(name).startswith("on") for _, attributes in hostile.elements for name in attributes)


def test_causes_stand_before_what_follows_from_them(tmp_path: Path) -> None:
    def in_kmh(table: object) -> object:
        index = table.schema.get_field_index("speed_mps")  # type: ignore[attr-defined]
        values = table["speed_mps"].to_numpy() * np.float32(3.6)  # type: ignore[index]
        import pyarrow as pa

        return table.set_column(index, table.schema.field(index), pa.array(values))  # type: ignore[attr-defined]

    page = made(written(tmp_path / "d", {"observations": in_kmh}), tmp_path / "report.html")  # type: ignore[dict-item]
    order = [str(article["id"]) for article in page.of("article")]
    assert order.index("BD-MOT-001") < order.index("BD-EVD-002")
    assert "May follow from" in page.text
    assert "To do:" in page.text
    heads = [str(head["id"]) for head in page.of("h2") if head.get("id")]
    assert heads[:4] == ["causes", "funnel", "findings", "groups"]
    (lost,) = (head for head in page.of("h3") if head.get("id") == "lost")
    elements = [attributes for _, attributes in page.elements]
    assert elements.index(lost) > elements.index(page.of("article")[-1])


def test_groups_that_do_not_qualify_are_named_with_their_reasons(damaged_dataset: Path, damaged_page: Page) -> None:
    page = damaged_page
    validated = validate(damaged_dataset)
    lost = [group for group in validated.groups or () if not group.qualifies]
    assert lost
    assert f"{validated.dataset.num_files} files with the manifest in {validated.dataset.num_shards} shard" in page.text
    for group in lost:
        assert group.group_id in page.text
        assert group.reason.replace("`", "") in page.text


def test_a_damaged_group_opens_and_says_what_it_lacks(damaged_page: Page) -> None:
    first, second, _ = damaged_page.groups
    keys = {future["key"] for future in first["futures"]}
    assert "brake_0.30" not in keys
    assert "steer_left_0.05" not in keys
    assert "nominal" in keys
    said = " ".join(first["remarks"])
    assert "brake_0.30: no observation within the horizon has a place" in said
    assert "steer_left_0.05: no attempt is recorded" in said
    boxed = {future["key"] for future in first["futures"] if any(actor[1] >= 0 for actor in future["actors"])}
    assert boxed == {"accelerate_0.50"}
    assert "futures" not in second
    assert "No candidate of this group can be drawn." in second["remarks"]


def test_the_rules_that_a_group_fails_are_those_of_the_validator(damaged_dataset: Path, damaged_page: Page) -> None:
    report = validate(damaged_dataset)
    assert report.funnel is not None
    for group, outcome in zip(damaged_page.groups, report.funnel.outcomes, strict=True):
        assert {fault["rule"] for fault in group["faults"]} == {rule for rule, _ in outcome.failed}
        said = {fault["rule"]: fault["extent"].partition(" of ")[0] for fault in group["faults"]}
        assert said == {rule: str(number) for rule, number in outcome.failed}
    assert not damaged_page.groups[2]["faults"]
    assert all(group["judged"] for group in damaged_page.groups)


def test_a_place_names_candidate_tick_and_actor(damaged_page: Page) -> None:
    first, second, _ = damaged_page.groups
    faults = {fault["rule"]: fault for fault in first["faults"]}
    keys = [future["key"] for future in first["futures"]]
    degrees, huge = faults["BD-VAL-002"]["spots"]
    assert [keys[degrees[0]], degrees[1], degrees[3:5]] == ["accelerate_0.50", 20, ["", 1]]
    assert degrees[2] in [actor[0] for actor in first["futures"][degrees[0]]["actors"]]
    assert faults["BD-VAL-002"]["texts"][degrees[5]].startswith("yaw_rad of actors: expected -3.14159 .. 3.14159 rad")
    assert faults["BD-VAL-002"]["columns"][degrees[6]] == "yaw_rad of actors"
    assert [keys[huge[0]], huge[1], huge[4]] == ["brake_0.50", -BRANCH_TICK, 21]
    lacking = [spot[3] for spot in faults["BD-VAL-001"]["spots"] if spot[0] < 0]
    assert lacking[:3] == [
        "brake 0.30, attempt 1", "replay of the nominal, attempt 1", "replay of the nominal, attempt 2",
    ]  # fmt: skip
    assert {place for fault in second["faults"] for place, *_ in fault["spots"]} == {-1}


def test_a_place_is_told_where_the_validator_keeps_none_of_the_group(damaged_dataset: Path, damaged_page: Page) -> None:
    kept = [finding for finding in validate(damaged_dataset).findings if finding.rule == "BD-BOX-001"]
    assert {finding.group_id for finding in kept} == {None}  # rows of the attempt that lacks come first
    for group in damaged_page.groups[:2]:
        (fault,) = (fault for fault in group["faults"] if fault["rule"] == "BD-BOX-001")
        assert fault["texts"] == ["length_m of actors: expected above 0 and at most 100 m, found -1.0"]
        assert len(fault["spots"]) == 1


@pytest.mark.parametrize("table", ["observations", "actors", "evidence", "controls", "rollouts"])
@pytest.mark.parametrize("fault", ["missing", "no Parquet"])
def test_a_table_that_cannot_be_read_is_said(table: str, fault: str, dataset: Path, tmp_path: Path) -> None:
    root = tmp_path / "d"
    shutil.copytree(dataset, root)
    for place in root.glob(f"raw/*/{table}.parquet"):
        place.unlink() if fault == "missing" else place.write_bytes(b"PAR1 no more")
    page = made(root, tmp_path / "report.html")
    assert "invalid" in page.text
    assert "Not counted" in page.text
    said = " ".join(remark for group in page.groups for remark in group["remarks"])
    expected = {
        "observations": "the table of observations cannot be read", "actors": "Actors are not drawn",
        "evidence": "Gaps and contacts are unknown", "controls": "Commands are unknown",
    }  # fmt: skip
    if table == "rollouts":
        assert "No group can be listed" in page.text
    else:
        assert expected[table] in said
        assert "Rules on rows did not run here" in said
        assert not any(group["judged"] or group["faults"] for group in page.groups)


@pytest.mark.parametrize("name", ["branchdrive.json", "MANIFEST.sha256"])
def test_a_dataset_without_a_document_is_reported_all_the_same(name: str, dataset: Path, tmp_path: Path) -> None:
    root = tmp_path / "d"
    shutil.copytree(dataset, root)
    (root / name).unlink()
    assert "invalid" in made(root, tmp_path / "report.html").text


def test_camera_images_are_those_of_the_dataset(tmp_path: Path) -> None:
    root, tables = tmp_path / "d", synthetic.with_few_attempts(synthetic.media_tables())
    synthetic.write_dataset(root, tables, synthetic.media_descriptor())
    page = made(root, tmp_path / "report.html")
    group = open_dataset(root).group("g0")
    (first,) = [found for found in page.groups if found["name"] == "g0"]
    assert first["images"][0]["key"] == "nominal"
    assert {image["camera"] for image in first["images"][:6]} == {
        camera.name for camera in open_dataset(root).descriptor.cameras
    }
    for image in first["images"][:12]:
        rollout = group.nominal if image["key"] == "nominal" else group.interventions[image["key"]][0]
        (frame,) = rollout.frames(image["camera"], [image["tick"]])
        kind, _, content = image["uri"].partition(",")
        assert kind in ("data:image/png;base64", "data:image/jpeg;base64")
        assert base64.b64decode(content) == frame.read()
    assert f"{len(first['images']):,} of " in first["image_text"]


def test_images_stay_within_their_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root, tables = tmp_path / "d", synthetic.with_few_attempts(synthetic.media_tables())
    synthetic.write_dataset(root, tables, synthetic.media_descriptor())
    monkeypatch.setattr(gallery, "IMAGE_BYTES", 9000)
    page = made(root, tmp_path / "report.html")
    sizes = [sum(len(image["uri"]) for image in group["images"]) for group in page.groups]
    assert 0 < sum(sizes) < 9000 * 1.1


def test_an_image_that_is_none_is_left_out_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(content: bytes) -> object:
        raise DecodeError("46 bytes behind its end marker; expected a whole JPEG")

    root, tables = tmp_path / "d", synthetic.with_few_attempts(synthetic.media_tables())
    synthetic.write_dataset(root, tables, synthetic.media_descriptor())
    monkeypatch.setattr("branchdrive_reference.report.images.image_header", refused)
    page = made(root, tmp_path / "report.html")
    for group in page.groups:
        assert group["images"] == []
        assert any("Some image is not shown: 46 bytes behind" in remark for remark in group["remarks"])


def test_a_benchmark_has_its_tables_and_warnings(dataset: Path) -> None:
    report = read_report(dataset)
    document = results_document(small_protocol(), data(), prediction_set(), risk_fit(), noise(), warnings=["beware"])
    (found,) = [
        part for part in sections(replace(report, documents={RESULTS_FILE: document})) if part.name == "benchmark"
    ]
    assert found.warnings == ("beware",)
    titles = [part.title for part in found.parts]
    assert [part.title for part in result_sections(document)] == [title for title in titles if title]


def test_a_release_has_the_sections_of_its_documents(dataset: Path) -> None:
    groups = paper_groups()
    names = ("population", "split", "thresholds", "retention", "ledger", "variants")
    release = dict(zip((f"quality/{name}.json" for name in names), documents(groups, paper_pairs(groups)), strict=True))
    report = read_report(dataset)
    found = {part.name: part for part in sections(replace(report, documents=release))}
    assert list(found) == ["response", "holdings", "population", "split", "fidelity", "leakage"]
    assert found["population"].parts[0].rows[0][0] == "Discovered branch groups"
    assert "not audited" in found["leakage"].parts[0].paragraphs[0]
    assert [part.name for part in sections(report)] == ["response", "holdings"]
