"""Loops over declarations as one test: every case is tried, and a failure names each case that fails.

``each`` is written like ``pytest.mark.parametrize``, which makes a test of every case and is for cases that
somebody wants to run by themselves::

    @each("rule", CATALOGUE.values(), ids=lambda rule: rule.id)
    def test_rule_has_a_mutant(rule: RuleInfo) -> None: ...

All cases of one test share its fixtures.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

import pytest

__all__ = ["Loop", "each"]

Test = Callable[..., None]
Loop = Callable[[Test], Test]
Cases = Iterable[Any] | Callable[[], Iterable[Any]]
Ids = Iterable[object] | Callable[[Any], object] | None
_Case = tuple[Callable[[], str], tuple[Any, ...]]

_SHOWN = 20
"""Names of failing cases in the first line of a failure; the group below it has them all."""


def each(names: str | Sequence[str], cases: Cases, *, ids: Ids = None) -> Loop:
    """Decorator of a test that is run on every case and then fails for all that failed.

    Args:
        names: Parameters that a case gives, as a sequence or separated by commas.
        cases: Values, tuples of values where there are several names, or ``pytest.param``; or a function that gives
            them, which is called when the test runs: of what takes time to make.
        ids: Names of the cases, or what makes one of a value; by default the values themselves.

    Raises:
        ValueError: There is no case, so that the test would hold of nothing; of a function, when the test runs.
    """
    parameters = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)

    def named(rows: Iterable[Any]) -> list[_Case]:
        rows = list(rows)
        if not rows:
            raise ValueError(f"no case gives {names!r}")
        labels = list(ids) if ids is not None and not callable(ids) else [None] * len(rows)
        return [
            _case(row, len(parameters), label, ids if callable(ids) else None)
            for row, label in zip(rows, labels, strict=True)
        ]

    known = named(cases) if isinstance(cases, Iterable) else []

    def decorate(test: Test) -> Test:
        signature = inspect.signature(test)

        @wraps(test)
        def loop(**fixtures: Any) -> None:
            failures: list[BaseException] = []
            failing: list[str] = []
            tried = known if isinstance(cases, Iterable) else named(cases())
            for label_of, values in tried:
                try:
                    test(**fixtures, **dict(zip(parameters, values, strict=True)))
                except pytest.skip.Exception as skipped:
                    raise RuntimeError(
                        f"case {label_of()} skips, which would skip all cases; leave it out"
                    ) from skipped
                except (Exception, pytest.fail.Exception) as failure:
                    failing.append(label_of())
                    failure.add_note(f"case: {failing[-1]}")
                    failures.append(failure)
            if failures:
                more = f" and {len(failing) - _SHOWN} more" if len(failing) > _SHOWN else ""
                summary = f"{len(failing)} of {len(tried)} cases fail: {', '.join(failing[:_SHOWN])}{more}"
                raise BaseExceptionGroup(summary, failures)

        kept = [parameter for name, parameter in signature.parameters.items() if name not in parameters]
        loop.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return loop

    return decorate


def _case(row: Any, num_names: int, label: object, name: Callable[[Any], object] | None) -> _Case:
    """A case whose label is made where it fails: values may be long to print."""
    if isinstance(row, type(pytest.param())):
        if row.marks:
            raise ValueError(f"case {row.id or row.values} has marks, which a loop ignores; use `parametrize`")
        label, values = label if row.id is None else row.id, tuple(row.values)
    else:
        values = (row,) if num_names == 1 else tuple(row)

    def label_of() -> str:
        if label is not None:
            return str(label)
        return "-".join(str(value if name is None or (own := name(value)) is None else own) for value in values)

    return label_of, values
