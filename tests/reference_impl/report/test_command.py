"""`branchdrive report`: its forms, its outputs, and one line for wrong usage."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from tests.bucket_server import serving, use
from tests.places import packed
from tests.reference_impl.report.reading import Page, report

from branchdrive import open_dataset, validate
from branchdrive_reference.report import gallery
from branchdrive_reference.study.survey import study_dataset


def test_a_report_is_one_file_and_tells_its_verdict(dataset: Path, tmp_path: Path) -> None:
    code, out, err = report(dataset, "--output", tmp_path / "report.html")
    assert (code, err) == (0, "")
    size = (tmp_path / "report.html").stat().st_size
    size_line, verdict_line = out.splitlines()
    assert size_line == f"{tmp_path / 'report.html'}: {size:,} bytes; 3 groups, 3 to play in it"
    assert verdict_line == "Verdict: valid - the dataset conforms to the specification; 3 of 3 groups qualify"
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_the_document_has_what_validator_and_study_count(dataset: Path) -> None:
    code, out, _ = report(dataset, "--format", "json")
    document = json.loads(out)
    assert code == 0
    assert document["validation"] == json.loads(json.dumps(validate(dataset).to_json()))
    assert document["study"] == json.loads(json.dumps(study_dataset(dataset, lambda *_: None).to_json()))
    assert [group["id"] for group in document["groups"]] == list(open_dataset(dataset).groups)
    assert {group["outcome"] for group in document["groups"]} == {"qualifies"}


def test_a_report_says_the_same_wherever_the_dataset_is(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = report(dataset, "--format", "json")[1]
    assert report(dataset, "--output", tmp_path / "folder.html")[0] == 0
    archive = packed(dataset, tmp_path / "d.zip")
    with serving() as server:
        use(server, monkeypatch)
        server.fill(dataset, "d")
        for place in (str(archive), "s3://bucket/d"):
            code, out, err = report(place, "--format", "json")
            assert (code, err) == (0, "")
            assert out == expected.replace(json.dumps(str(dataset)), json.dumps(place))
        assert report("s3://bucket/d", "--output", tmp_path / "bucket.html")[0] == 0
    found, page = (Page(tmp_path / name).groups for name in ("bucket.html", "folder.html"))
    assert found == page


@pytest.mark.parametrize(("form", "verdict"), [("text", "Verdict: valid"), ("markdown", "BranchDrive: valid")])
def test_text_and_markdown_say_what_the_page_says(form: str, verdict: str, dataset: Path, tmp_path: Path) -> None:
    code, out, _ = report(dataset, "--format", form)
    assert code == 0
    for said in (verdict, "Action response", "What the dataset holds", "What was collected", "compared nominal replay"):
        assert said in out
    report(dataset, "--format", form, "--output", tmp_path / "report")
    assert "What was collected" in (tmp_path / "report").read_text()


def test_groups_beyond_the_budget_are_small_drawings(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tmp_path / "whole.html"
    report(dataset, "--output", whole)
    size = max(len(text) for name, text in Page(whole).scripts.items() if name.startswith("group-data-"))
    beside = gallery._TEXT_BYTES + 3 * gallery._CARD_BYTES
    limits = ({"PLAYED_BYTES": size + 1, "IMAGE_BYTES": 0}, {"PAGE_BYTES": beside + size + 1}, {"PAGE_BYTES": beside})
    for limit, played in zip(limits, (1, 1, 0), strict=True):
        with monkeypatch.context() as patch:
            for name, value in limit.items():
                patch.setattr(gallery, name, value)
            _, out, _ = report(dataset, "--output", tmp_path / f"{played}.html")
        assert f"3 groups, {played} to play in it" in out
    page = Page(tmp_path / "1.html")
    assert len(page.groups) == 1
    assert len([each for each in page.of("svg") if each.get("viewbox") == "0 0 240 132"]) == 3
    assert "no room for the others" in page.text


def test_with_a_folder_every_group_has_a_page(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gallery, "PLAYED_BYTES", 0)
    monkeypatch.setattr(gallery, "IMAGE_BYTES", 0)
    _, out, err = report(dataset, "--output", tmp_path / "report.html", "--folder")
    assert err == ""
    assert f"3 groups, 0 to play in it, 3 in {tmp_path / 'report-groups'}" in out
    page = Page(tmp_path / "report.html")
    links = [str(link["href"]) for link in page.of("a") if "report-groups" in str(link["href"])]
    assert links == [f"report-groups/{name}.html" for name in open_dataset(dataset).groups]
    for link in links:
        own = Page(tmp_path / link)
        assert len(own.groups) == 1
        assert {"href": "../report.html"} in own.of("a")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "give `--output report.html`"),
        (["--format", "json", "--folder"], "`--folder` belongs to `--format html`"),
        (["--output", "{dataset}/report.html"], "lies inside the dataset"),
        (["--output", "{dataset}/none/report.html"], "does not exist"),
    ],
)
def test_wrong_usage_is_one_line(arguments: list[str], said: str, dataset: Path) -> None:
    code, out, err = report(dataset, *(text.replace("{dataset}", str(dataset)) for text in arguments))
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1


def test_a_folder_that_holds_no_dataset_is_one_line(tmp_path: Path) -> None:
    code, _, err = report(tmp_path / "none", "--output", tmp_path / "report.html")
    assert code == 2
    assert err.count("\n") == 1


def test_without_the_extra_the_command_says_what_to_install(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    code, _, err = report(dataset, "--output", tmp_path / "report.html")
    assert code == 4
    assert "report" in err


def test_a_dataset_is_left_as_it_is(dataset: Path, tmp_path: Path) -> None:
    root = tmp_path / "d"
    shutil.copytree(dataset, root)
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    report(root, "--output", tmp_path / "report.html")
    assert {path: path.read_bytes() for path in root.rglob("*") if path.is_file()} == before
