"""A view of a release that notes what is read of it: documents and texts by path, tables by name."""

from __future__ import annotations

from collections.abc import Callable, ItemsView, Iterator, KeysView, Mapping, ValuesView
from contextlib import contextmanager
from typing import Any, TypeVar

from branchdrive.audit.release.view import ReleaseView
from branchdrive.contract.layer import LAYERS
from branchdrive.derive.layer.frame import Alignment, Frame

T = TypeVar("T")

CONTEXTS = "contexts"
"""The table that says which groups the other tables of the model layer are about."""


class Noting(dict[str, Any]):
    """A dictionary by path that tells which paths were asked for; who goes through it asks for all."""

    def __init__(self, content: Mapping[str, Any], asked: Callable[[str], None]) -> None:
        super().__init__(content)
        self.asked = asked

    def _ask_for_all(self) -> None:
        for path in super().__iter__():
            self.asked(path)

    def __getitem__(self, path: str) -> Any:
        self.asked(path)
        return super().__getitem__(path)

    def __contains__(self, path: object) -> bool:
        self.asked(str(path))
        return super().__contains__(path)

    def get(self, path: str, default: Any = None) -> Any:
        self.asked(path)
        return super().get(path, default)

    def __iter__(self) -> Iterator[str]:
        self._ask_for_all()
        return super().__iter__()

    def keys(self) -> KeysView[str]:  # type: ignore[override]
        self._ask_for_all()
        return super().keys()

    def values(self) -> ValuesView[Any]:  # type: ignore[override]
        self._ask_for_all()
        return super().values()

    def items(self) -> ItemsView[str, Any]:  # type: ignore[override]
        self._ask_for_all()
        return super().items()


class NotingView(ReleaseView):
    """A view that notes what is read, by rules and by what they compute once for all of them."""

    def __init__(
        self,
        descriptor: Any,
        tables: Mapping[str, Any],
        documents: Mapping[str, Any],
        contents: Mapping[str, Any],
        *parts: Any,
        **more_parts: Any,
    ) -> None:
        self._open: list[set[str]] = []
        self._known: dict[Any, tuple[Any, set[str]]] = {}
        noting = [Noting(part, self._note) for part in (tables, documents, contents)]
        super().__init__(descriptor, *noting, *parts, **more_parts)

    def rows(self, table: str) -> Frame:
        self._note(table)
        return super().rows(table)

    def expected(self, table: str) -> Frame:
        if table in LAYERS["model"].tables:
            self._note(CONTEXTS)
        return super().expected(table)

    def aligned(self, table: str) -> Alignment:
        self.expected(table)
        self._note(table)
        return super().aligned(table)

    def _note(self, path: str) -> None:
        for asked in self._open:
            asked.add(path)

    @contextmanager
    def noted(self) -> Iterator[set[str]]:
        """The paths and names that are asked for inside the block."""
        asked: set[str] = set()
        self._open.append(asked)
        try:
            yield asked
        finally:
            self._open.pop()

    def once(self, compute: Callable[[ReleaseView], T]) -> T:
        if compute not in self._known:
            with self.noted() as asked:
                result = compute(self)
            self._known[compute] = result, asked
        found: T = self._known[compute][0]
        for path in self._known[compute][1]:
            self._note(path)
        return found
