"""Which p-values fit the first permutations."""

from __future__ import annotations

from tests.each import each

from branchdrive.leakage.plausible import is_plausible


@each(
    ("reached", "drawn", "p", "expected"),
    [
        (93, 199, 0.4658, True),
        (93, 199, 1.0, False),
        (93, 199, 0.85, False),
        (199, 199, 1.0, True),
        (198, 199, 1.0, True),
        (197, 199, 1.0, False),
        (0, 199, 1 / 10_000, True),
        (3, 199, 1 / 10_000, False),
        (0, 199, 0.05, True),
        (0, 199, 0.2, False),
        (0, 9_999, 2 / 10_000, True),
        (0, 9_999, 3 / 10_000, False),
    ],
)
def test_counts_fit_p_values(reached: int, drawn: int, p: float, expected: bool) -> None:
    assert is_plausible(reached, drawn, p, 9_999) is expected
