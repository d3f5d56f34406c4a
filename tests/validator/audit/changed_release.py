"""A release in memory whose documents are replaced one at a time, judged by the rules that read them.

The valid release is read once and every rule judged on it, with a note of the documents that each rule, and each
result shared by rules, has read: a changed document is judged by the rules that read it, everything else is kept.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from tests.validator.audit.rules.benchmark_release import BenchmarkDraft

from branchdrive.audit import engine
from branchdrive.audit.check import RELEASE_RULES
from branchdrive.audit.release import audit
from branchdrive.audit.release.view import ReleaseView
from branchdrive.audit.tally import Tally
from branchdrive.contract.catalogue import CATALOGUE
from branchdrive.contract.document import dump_json

T = TypeVar("T")

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
    """A view that notes what is read, and takes what several rules need from `known` where it is still right."""

    def __init__(self, source: ReleaseView, documents: Mapping[str, Any], changed: str | None = None) -> None:
        self._open: list[set[str]] = []
        self._known: dict[Any, tuple[Any, set[str]]] = {}
        super().__init__(
            source.descriptor, source.tables, Watched(documents, self._note), Watched(source.contents, self._note),
            source.raw, source.files, source.problems, digests=source.digests, sizes=source.sizes,
        )  # fmt: skip
        self.distrusted = source.distrusted
        for name in ("_frames", "_expected", "_aligned"):
            setattr(self, name, getattr(source, name))
        if isinstance(source, WatchedView):
            self._known = {key: found for key, found in source._known.items() if changed not in found[1]}

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

    def once(self, compute: Callable[[ReleaseView], T]) -> T:
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
        reads: Documents that each rule reads.
    """

    def __init__(self) -> None:
        views: list[ReleaseView] = []
        with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
            root = BenchmarkDraft().write(Path(folder) / "dataset")
            patch.setattr(audit, "_judge", lambda view, rule_id: views.append(view) or Tally(rule_id))
            engine.validate(root)
        self.view = WatchedView(views[0], views[0].documents)
        self.documents = dict(views[0].documents)
        self.reads: dict[str, set[str]] = {}
        for rule_id in (rule_id for rule_id in CATALOGUE if rule_id in RELEASE_RULES and rule_id not in SLOW):
            with self.view.noted() as self.reads[rule_id]:
                tally = audit._judge(self.view, rule_id)
            assert tally.unjudged is None and not tally.errors, (rule_id, tally)

    def tallies(self, path: str, document: Any) -> list[Tally]:
        """What the rules that read a document say about another one that conforms to its schema."""
        view = WatchedView(self.view, {**self.view.documents, path: document}, path)
        view.contents[path] = content = dump_json(document)
        view.digests[path] = hashlib.sha256(content).hexdigest()
        rules = [rule_id for rule_id, read in self.reads.items() if path in read]
        return [audit._judge(view, rule_id) for rule_id in rules]
