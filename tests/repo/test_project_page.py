"""What people see before they have the project: the page of the package, how to cite it, how to report a fault."""

from __future__ import annotations

import re
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

import yaml
from tests.each import each
from tests.repo.checkout import ROOT

from branchdrive.contract.resources import PROJECT_URL

PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))


def test_the_homepage_is_where_the_library_says() -> None:
    assert PROJECT["urls"]["Homepage"] == PROJECT_URL


@each(("name", "url"), PROJECT["urls"].items())
def test_a_url_is_a_file_of_the_repository(name: str, url: str) -> None:
    assert (ROOT / url.removeprefix(PROJECT_URL).lstrip("/")).exists()


def absolute_links(text: str) -> str:
    spec = spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return str(module.absolute_links(text, "https://x.example"))


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
        "cff-version", "message", "title", "abstract", "type", "authors", "version", "license", "url", "keywords",
    }  # fmt: skip
    assert set(CITATION) <= known
    assert CITATION["type"] in ("software", "dataset")
    assert CITATION["authors"] and all(set(author) == {"name"} for author in CITATION["authors"])
    assert all(isinstance(CITATION[key], str) for key in known - {"authors", "keywords"})


def test_the_citation_agrees_with_the_metadata() -> None:
    assert CITATION["version"] == PROJECT["version"]
    assert CITATION["license"] == PROJECT["license"]
    assert CITATION["url"] == PROJECT_URL
    assert CITATION["keywords"] == PROJECT["keywords"]
    assert CITATION["title"].casefold() == f"BranchDrive: {PROJECT['description']}".casefold()


def test_the_readme_names_how_to_report_and_to_cite() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    assert "(SECURITY.md)" in readme and "(CITATION.cff)" in readme
