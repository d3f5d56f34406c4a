"""A release in memory whose documents and tables are replaced one at a time, judged by the rules that read them.

The valid release is read once and every rule judged on it, with a note of the documents and tables that each rule,
and each result shared by rules, has read: what changes is judged by the rules that read it, everything else is kept.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
from tests.validator.engine.release_view import release_view
from tests.validator.engine.rules.benchmark_release import BenchmarkDraft
from tests.validator.engine.rules.case import NO_SUBJECT

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.document import dump_json
from branchdrive.contract.layer import LAYERS, paths_by_table
from branchdrive.contract.rule import rules_of
from branchdrive.engine.derived_rules import judge_layers
from branchdrive.engine.tally import Tally
from branchdrive.layers.view import ReleaseView
from branchdrive.tables.frame import Alignment, Frame

T = TypeVar("T")

CONTEXTS = "contexts"
"""The table that says which groups the other tables of the model layer are about."""

SLOW = ("BD-LKG-003", "BD-LKG-012")
"""Rules that draw permutations again, once others found that protocol and counts are the specification's."""


class Watched(dict[str, Any]):
    """A dictionary by path that notes which paths were asked for."""

    def __init__(self, content: Mapping[str, Any], asked: Callable[[str], None]) -> None:
        super().__init__(content)
        self.asked = asked

    def __getitem__(self, path: str) -> Any:
        self.asked(path)
        return super().__getitem__(path)

    def __contains__(self, path: object) -> bool:
        self.asked(str(path))
        return super().__contains__(path)

    def get(self, path: str, default: Any = None) -> Any:
        self.asked(path)
        return super().get(path, default)


class WatchedView(ReleaseView):
    """A view that notes what is read, and keeps what was computed from a source and does not hang on the change.

    Documents are noted by path, tables by name.
    """

    def __init__(self, source: ReleaseView, changed: str = "", **parts: Mapping[str, Any]) -> None:
        self._open: list[set[str]] = []
        self._known: dict[Any, tuple[Any, set[str]]] = {}
        parts = {name: parts.get(name, getattr(source, name)) for name in ("tables", "documents", "contents")}
        num_rows = dict(source.num_rows)
        if changed in LAYER_TABLES:  # all rows of another table stand in its first file
            first, *others = paths_by_table(num_rows)[changed]
            num_rows |= {**dict.fromkeys(others, 0), first: len(parts["tables"][changed])}
        super().__init__(
            source.descriptor, **{name: Watched(part, self._note) for name, part in parts.items()},
            raw=source.raw, files=source.files, mismatches=source.mismatches,
            digests=source.digests, sizes=source.sizes, num_rows=num_rows,
        )  # fmt: skip
        stale = {changed, *(LAYERS["model"].tables if changed == CONTEXTS else ())}
        self._frames = {name: frame for name, frame in source._frames.items() if name != changed}
        self._aligned = {name: found for name, found in source._aligned.items() if name not in stale}
        if changed != CONTEXTS:
            self._expected = dict(source._expected)
        if isinstance(source, WatchedView):
            self._known = {key: found for key, found in source._known.items() if changed not in found[1]}

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
        """The paths that are asked for inside the block."""
        asked: set[str] = set()
        self._open.append(asked)
        try:
            yield asked
        finally:
            self._open.pop()

    def cached(self, compute: Callable[[ReleaseView], T]) -> T:
        if compute not in self._known:
            with self.noted() as asked:
                result = compute(self)
            self._known[compute] = result, asked
        found: T = self._known[compute][0]
        for path in self._known[compute][1]:
            self._note(path)
        return found


class ChangedRelease:
    """A valid release with a benchmark, and what becomes of a change of one of its documents.

    Attributes:
        documents: Its documents by path; not to be changed.
        reads: Documents and tables that each rule reads.
    """

    def __init__(self) -> None:
        draft = BenchmarkDraft()
        draft.add_filtering()
        draft.reseal("card")
        draft.follow("lock")
        draft.add_latencies()
        with tempfile.TemporaryDirectory() as folder:
            view = release_view(draft.write(Path(folder) / "dataset"))
        self.view = WatchedView(view)
        self.documents = dict(view.documents)
        self.reads: dict[str, set[str]] = {}
        for rule_id in (rule_id for rule_id in rules_of("layers", "layer_rows") if rule_id not in SLOW):
            with self.view.noted() as self.reads[rule_id]:
                tally = judge_layers(self.view, [rule_id])[0][rule_id]
            assert not tally.errors and (tally.unjudged is None or rule_id in NO_SUBJECT), (rule_id, tally)

    def tallies(self, path: str, document: Any) -> list[Tally]:
        """What the rules that read a document say about another one that conforms to its schema."""
        content = dump_json(document)
        view = WatchedView(
            self.view, path, documents={**self.view.documents, path: document},
            contents={**self.view.contents, path: content},
        )  # fmt: skip
        view.digests[path] = hashlib.sha256(content).hexdigest()
        return self._judged(view, path)

    def table_tallies(self, name: str, table: pa.Table) -> list[Tally]:
        """What the rules that read a table say about another one with its columns."""
        return self._judged(WatchedView(self.view, name, tables={**self.view.tables, name: table}), name)

    def _judged(self, view: WatchedView, changed: str) -> list[Tally]:
        return list(judge_layers(view, [r for r, read in self.reads.items() if changed in read])[0].values())
