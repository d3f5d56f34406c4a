"""The site has every page of the repository, names every public name once, and a link that leads nowhere is found."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from docs.site.links import broken_links
from docs.site.pages import ROOT, nav, site_files

import branchdrive
import branchdrive.testing

CONFIG: dict[str, Any] = tomllib.loads((ROOT / "docs/site/zensical.toml").read_text("utf-8"))["project"]


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return site_files()


def pages(entries: Any) -> Iterator[str]:
    if isinstance(entries, str):
        yield entries
    else:
        for inner in entries.values() if isinstance(entries, dict) else entries:
            yield from pages(inner)


def test_the_navigation_names_every_page_once(files: dict[str, bytes]) -> None:
    named = Counter(pages(nav(CONFIG["nav"], list(files))))
    rules = {name for name in files if re.fullmatch(r"docs/rules/BD-[A-Z]{3}-\d{3}\.md", name)}
    assert len(rules) > 200  # their index names them, which a test of their own holds
    assert named == Counter({name for name in files if name.endswith(".md")} - rules)


def test_every_document_of_the_repository_is_a_page(files: dict[str, bytes]) -> None:
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")} <= files.keys()
    assert {f"spec/{path.name}" for path in (ROOT / "spec").glob("*.md")} <= files.keys()


def test_links_lead_to_files_of_the_site(files: dict[str, bytes]) -> None:
    for name, content in files.items():
        if not name.endswith(".md"):
            continue
        prose = re.sub(r"^ *```.*?^ *```$", "", content.decode(), flags=re.DOTALL | re.MULTILINE)
        for target in re.findall(r"\[[^\]]*\]\((?![a-z]+:|#)([^)\s#[]+)", prose):
            there = (ROOT / name).parent.joinpath(target).resolve().relative_to(ROOT).as_posix()
            assert there in files, f"{name}: {target}"


def test_the_pages_of_the_api_have_every_public_name_once() -> None:
    text = "\n".join(path.read_text("utf-8") for path in sorted((ROOT / "docs" / "api").glob("*.md")))
    public = [f"branchdrive.{name}" for name in branchdrive.__all__]
    public += [f"branchdrive.testing.{name}" for name in branchdrive.testing.__all__]
    assert Counter(re.findall(r"^::: (\S+)$", text, re.M)) == Counter(public)


def test_every_schema_has_its_line(files: dict[str, bytes]) -> None:
    table = files["schemas/v0.1/README.md"].decode()
    for path in (ROOT / "schemas/v0.1").rglob("*.json"):
        assert f"]({path.relative_to(ROOT / 'schemas/v0.1').as_posix()}) |" in table


def test_globs_are_written_out_at_their_depth_alone() -> None:
    names = ["a/1.md", "a/2.md", "a/b/3.md", "c.md"]
    assert nav([{"A": ["a/*.md"]}, "c.md"], names) == [{"A": ["a/1.md", "a/2.md"]}, "c.md"]


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / "a.html").write_text(
        '<h1 id="top"></h1><a href="#top"></a><a href="#bottom"></a><a href="b/c.html#there"></a><a href="b/"></a>'
        '<img src="no.png"><a href="b/c.html#gone"></a><a href="https://x.example/none"></a>'
    )
    (tmp_path / "b" / "c.html").write_text('<p id="there"><a href="../a.html"></a></p>')
    assert list(broken_links(tmp_path)) == [
        "a.html: #bottom: there is no such anchor",
        "a.html: b/: there is no such file",
        "a.html: b/c.html#gone: there is no such anchor",
        "a.html: no.png: there is no such file",
    ]
