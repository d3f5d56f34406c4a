"""Judgements of rules on derived layers, each made once on what the rule reads.

A rule reads a few tables and documents. Where they, and all that is not a file of the layers, are what they were in
an earlier judgement, the rule is not run again.
"""

from __future__ import annotations

import pickle
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import pyarrow as pa
import pytest
from tests.validator.audit.noting_view import Noting, NotingView

from branchdrive.audit.release import audit
from branchdrive.audit.tally import Tally
from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.layer import table_path
from branchdrive.dataset.layout import SOURCE_FILE
from branchdrive.dataset.parquet import decode_table
from branchdrive.derive.layer.frame import Frame


class Judgement(NamedTuple):
    """What a rule said, and of what.

    Attributes:
        read: Digest of every table and document that it asked for; ``None`` of one that is not there.
        tally: Its tally, pickled.
        distrusted: Tables that break their structure once it has run.
    """

    read: dict[str, str | None]
    tally: bytes
    distrusted: frozenset[str]


_judgements: defaultdict[tuple[str, str, frozenset[str]], list[Judgement]] = defaultdict(list)
"""By rule, by what is no file of the layers, and by the tables that break their structure before the rule runs."""

_frames: dict[tuple[str, str], Frame] = {}
"""Rows of tables by name and digest; rules do not change what they read."""


class DigestedView(NotingView):
    """A view that knows the digests of what is read, and what `surroundings` it has beside files of the layers."""

    def __init__(self, *parts: Any, **more_parts: Any) -> None:
        super().__init__(*parts, **more_parts)
        self.by_path = self.digests
        self.digests = Noting(self.by_path, self._note)
        raw = self.raw.descriptor and self.raw.descriptor.model_dump_json()
        present = [sorted(part.keys()) for part in (self.tables, self.documents, self.contents)]
        self.surroundings = repr(
            (self.descriptor.model_dump_json(), raw, self.raw.digest, self.raw.reason, self.raw.extract is None,
             sorted(self.files), sorted(self.problems.items()), present)
        )  # fmt: skip

    def digest(self, name: str) -> str | None:
        """Digest of a table by name, or of a document by path."""
        return self.by_path.get(table_path(name) if name in LAYER_TABLES else name)

    def rows(self, table: str) -> Frame:
        self._note(table)
        key = table, str(self.digest(table))
        if key not in _frames:
            _frames[key] = super().rows(table)
        return _frames[key]

    def expected(self, table: str) -> Frame:
        self._note(SOURCE_FILE)  # which names the raw layer that the rows come from
        return super().expected(table)


_judge = audit._judge


@cache
def _decoded(content: bytes, name: str) -> pa.Table:
    return decode_table(content, name)


@contextmanager
def remembered_judgements(raw: str) -> Iterator[None]:
    """Inside the block, a rule on derived layers of a raw layer that `raw` names runs once on what it reads."""

    def judge(view: DigestedView, rule_id: str) -> Tally:
        before = frozenset(view.distrusted)
        known = _judgements[rule_id, raw + view.surroundings, before]
        for judgement in known:
            if all(view.digest(name) == digest for name, digest in judgement.read.items()):
                view.distrusted |= judgement.distrusted
                tally: Tally = pickle.loads(judgement.tally)
                return tally
        with view.noted() as asked:
            made = _judge(view, rule_id)
        read = {name: view.digest(name) for name in asked}
        known.append(Judgement(read, pickle.dumps(made), frozenset(view.distrusted)))
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(audit, "ReleaseView", DigestedView)
        patch.setattr(audit, "decode_table", _decoded)
        patch.setattr(audit, "_judge", judge)
        yield
