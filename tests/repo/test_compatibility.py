"""The tests that `make compat` names are there."""

from __future__ import annotations

from pathlib import Path

from tests import compatibility
from tests.each import each

ROOT = Path(__file__).parents[2]

NAMED = {
    path
    for name in ("CORE_TESTS", "QUICK_CORE_TESTS", "EXTRA_TESTS", "NUMERIC_TESTS", "QUICK_NUMERIC_TESTS")
    for path in getattr(compatibility, name)
}


@each("path", sorted(NAMED), ids=str)
def test_tests_of_make_compat_exist(path: str) -> None:
    place = ROOT / path
    assert place.is_file() or list(place.rglob("test_*.py"))
