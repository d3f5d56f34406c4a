"""An entry is built once, whole, and again after any change of what it depends on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from tests import content_cache
from tests.content_cache import MAX_KEPT, kept, kept_folder


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(content_cache, "ROOT", tmp_path)
    monkeypatch.setattr(content_cache, "STORE", tmp_path / "store")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/one.py").write_text("1")
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    """As in another process."""
    content_cache._digest.cache_clear()
    content_cache._folder.cache_clear()


def counted() -> tuple[list[int], Callable[[], list[int]]]:
    calls: list[int] = []

    def build() -> list[int]:
        calls.append(len(calls))
        return [len(calls)]

    return calls, build


def test_a_value_is_built_once_and_is_nobody_elses(checkout: Path) -> None:
    calls, build = counted()
    kept("value", build).append(7)
    forget()
    assert kept("value", build) == [1]
    assert calls == [0]


@pytest.mark.parametrize("change", ["a source", "another source", "a setting"])
def test_it_is_built_again_after_a_change(change: str, checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls, build = counted()
    kept("value", build)
    forget()
    match change:
        case "a source":
            (checkout / "tests/one.py").write_text("2")
        case "another source":
            (checkout / "schemas").mkdir()
            (checkout / "schemas/limits.json").write_text("{}")
        case _:
            monkeypatch.setenv("OPENBLAS_CORETYPE", "invented")
    assert kept("value", build) == [2]
    assert calls == [0, 1]


def test_what_was_interrupted_is_not_there(checkout: Path, tmp_path: Path) -> None:
    def fails(root: Path) -> None:
        root.mkdir()
        (root / "half").touch()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept_folder("folder", fails, tmp_path / "copy")
    whole = kept_folder("folder", lambda root: (root.mkdir(), (root / "whole").touch()), tmp_path / "copy")
    assert [path.name for path in whole.iterdir()] == ["whole"]


def test_the_newest_folders_are_kept(checkout: Path) -> None:
    _, build = counted()
    for number in range(MAX_KEPT + 2):
        (checkout / "tests/one.py").write_text(f"{number} changed")
        forget()
        kept("value", build)
    assert len(list((checkout / "store").iterdir())) == MAX_KEPT
    assert kept("value", build) == [MAX_KEPT + 2]
