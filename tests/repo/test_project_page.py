"""What people see before they have the project: the page of the package, how to cite it, how to report a fault."""

from __future__ import annotations

import re
import tomllib
from email.message import Message
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType
from typing import Any

import pytest
import yaml
from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract import resources
from branchdrive.contract.resources import project_url
from branchdrive.contract.rule import CATALOGUE

PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))


def test_links_go_where_the_metadata_say_or_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    assert project_url() == PROJECT.get("urls", {}).get("Homepage", "")
    for declared, base in (
        ([], ""),
        (["Homepage, https://x.example/p/", "Docs, https://y.example"], "https://x.example/p"),
    ):
        message = Message()
        for line in declared:
            message["Project-URL"] = line
        monkeypatch.setattr(resources, "metadata", lambda name, message=message: message)
        project_url.cache_clear()
        rule = CATALOGUE["BD-MOT-001"]
        assert (project_url(), rule.url) == (base, f"{base}/docs/rules/BD-MOT-001.md" if base else None)
        assert rule.explained == (rule.url or "`branchdrive rules BD-MOT-001` explains it")
    project_url.cache_clear()


def test_the_page_has_relative_links_while_there_is_no_homepage() -> None:
    metadata: dict[str, Any] = {}
    hatch_build().ReadmeHook(str(ROOT), {}).update(metadata)
    assert metadata["readme"]["text"] == (ROOT / "README.md").read_text("utf-8")


def hatch_build() -> ModuleType:
    spec = spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def absolute_links(text: str) -> str:
    return str(hatch_build().absolute_links(text, "https://x.example"))


@each(
    ("text", "made"),
    [
        ("[a](docs/a.md#b)", "[a](https://x.example/docs/a.md#b)"),
        ("![p](docs/p.png) [`c`](./c)", "![p](https://x.example/docs/p.png) [`c`](https://x.example/c)"),
        ("[here](#there)", "[here](#there)"),
        ("[out](https://y.example/a)", "[out](https://y.example/a)"),
        ("[a](b)\n```sh\nf[0](x)\n```\n", "[a](https://x.example/b)\n```sh\nf[0](x)\n```\n"),
    ],
)
def test_links_of_the_package_s_page_lead_there_from_anywhere(text: str, made: str) -> None:
    assert absolute_links(text) == made


def test_the_readme_has_links_to_make_absolute() -> None:
    made = absolute_links((ROOT / "README.md").read_text("utf-8"))
    assert made.count("](https://x.example/") >= 10
    assert not re.search(r"\]\((?!https:|#)", re.sub(r"^```.*?^```", "", made, flags=re.DOTALL | re.MULTILINE))


def test_the_citation_has_what_its_format_demands() -> None:
    """Required keys and types of the Citation File Format 1.2.0, as far as the file uses them."""
    assert CITATION["cff-version"] == "1.2.0"
    assert {"message", "title", "authors"} <= set(CITATION)
    known = {
        "cff-version", "message", "title", "abstract", "type", "authors", "version", "license", "keywords",
    }  # fmt: skip
    assert set(CITATION) <= known
    assert CITATION["type"] in ("software", "dataset")
    assert CITATION["authors"] and all(set(author) == {"name"} for author in CITATION["authors"])
    assert all(isinstance(CITATION[key], str) for key in known - {"authors", "keywords"})


def test_the_citation_agrees_with_the_metadata() -> None:
    assert CITATION["version"] == PROJECT["version"]
    assert CITATION["license"] == PROJECT["license"]
    assert CITATION["keywords"] == PROJECT["keywords"]
    assert CITATION["title"].casefold() == f"BranchDrive: {PROJECT['description']}".casefold()


def test_the_readme_names_how_to_report_and_to_cite() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "(SECURITY.md)" in readme and "(CITATION.cff)" in readme
