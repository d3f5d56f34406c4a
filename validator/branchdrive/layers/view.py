"""The derived layers of a dataset as rules see them: decoded tables, parsed documents, and what raw says instead.

Source: spec/10-layers.md#derivation.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from branchdrive.contract.columns import LAYER_TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layer import paths_by_table, table_path, table_paths
from branchdrive.contract.layout import SOURCE_FILE
from branchdrive.contract.mismatch import Mismatch, PreconditionError
from branchdrive.tables.arrow import StoredFrame
from branchdrive.tables.frame import Alignment, Frame, align, with_homes
from branchdrive.tables.view import TableView

if TYPE_CHECKING:
    import pyarrow as pa


__all__ = ["PiecesOf", "RawLayer", "ReleaseView"]

T = TypeVar("T")
Piece = TypeVar("Piece")

PiecesOf = Callable[[Callable[["ReleaseView"], Any]], "list[Any] | None"]
"""Gives what a function of a part was for every part, in their order; ``None`` where that is not known of all."""


class RawLayer:
    """The raw layer that a release was derived from, as far as it is available.

    Attributes:
        rows: Rows that it gives, by table; ``None`` where it is not available.
        reason: Why it is not.
        shards: The same rows shard by shard; of one piece where they are not given so.
        digest: Digest of the content of the layer; ``None`` where it is not known.
        descriptor: Its dataset's descriptor; ``None`` where it is not available.
    """

    def __init__(
        self,
        rows: Mapping[str, Frame] | None,
        reason: str = "",
        *,
        shards: Sequence[Mapping[str, Frame]] | None = None,
        digest: str | None = None,
        descriptor: Descriptor | None = None,
    ) -> None:
        self.rows = rows
        self.reason = reason
        self.shards = tuple(shards) if shards is not None else (() if rows is None else (rows,))
        self.digest = digest
        self.descriptor = descriptor


class ReleaseView:
    """Derived layers of one dataset.

    Attributes:
        descriptor: The dataset's descriptor.
        tables: Decoded tables with the declared columns, by name.
        documents: Parsed documents that conform to their schema, by path.
        contents: Bytes of every document and text file that was read, by path.
        raw: The raw layer.
        mismatches: Those that were found while files were read, by rule id.
        files: Paths of all files of the derived layers and of the root.
        digests: SHA-256 of the files that were read, by path; empty where digests were not computed.
        num_rows: Rows of each file of its tables, by path.
        part: Number of the part that its rows of groups are of; ``None`` where they are of several.
        sizes: Bytes of the checkpoints, of which the header alone is in `contents`, by path.
        content: Digest of what each table and document says, by path; empty where digests were not computed.
        pieces_of: What parts gave before; nothing by default.
    """

    def __init__(
        self,
        descriptor: Descriptor,
        tables: Mapping[str, pa.Table],
        documents: Mapping[str, Any],
        contents: Mapping[str, bytes],
        raw: RawLayer,
        files: frozenset[str],
        mismatches: Mapping[str, list[Mismatch]] | None = None,
        *,
        digests: Mapping[str, str] | None = None,
        num_rows: Mapping[str, int] | None = None,
        part: int | None = None,
        sizes: Mapping[str, int] | None = None,
        content: Mapping[str, str] | None = None,
        pieces_of: PiecesOf = lambda _: None,
    ) -> None:
        self.descriptor = descriptor
        self.tables = tables
        self.documents = documents
        self.contents = contents
        self.raw = raw
        self.files = files
        self.digests = dict(digests or {})
        self.num_rows = dict(num_rows or {})
        self.part = part
        self.sizes = dict(sizes or {})
        self.content = dict(content or {})
        self.pieces_of = pieces_of
        self.mismatches = dict(mismatches or {})
        self._frames: dict[str, Frame] = {}
        self._paths = paths_by_table(self.num_rows)
        self._expected: dict[str, Frame] = {}
        self._aligned: dict[str, Alignment] = {}
        self._computed: dict[Callable[[ReleaseView], Any], Any] = {}
        self._broken: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        return f"ReleaseView({sorted(self.tables)}, {len(self.documents)} documents)"

    @cached_property
    def table_names(self) -> tuple[str, ...]:
        """Decoded tables of the claimed layers, in declared order."""
        return tuple(name for name in LAYER_TABLES if name in self.tables)

    def __getitem__(self, table: str) -> TableView:
        """Typed columns of a decoded table."""
        return TableView(table, self.tables[table])

    def paths(self, table: str) -> tuple[str, ...]:
        """Paths of the files of a decoded table, in the order of their rows."""
        return self._paths.get(table, ())

    def file_of(self, table: str, row: int) -> tuple[str, int]:
        """Path of the file that holds a row of a decoded table, and the number of the row in it."""
        for path in self.paths(table):
            if row < self.num_rows[path]:
                return path, row
            row -= self.num_rows[path]
        raise IndexError(row)

    def file_for(self, table: str, frame: Frame, row: int) -> str | None:
        """Path of the file that a row of `frame` is in, or belongs in; ``None`` where no file, or no one, is for it.

        Args:
            table: The table that the rows are of.
            frame: Its rows as they are stored, as `frame` gives them, or rows that it should have.
            row: Number of the row.
        """
        if frame is self._frames.get(table):
            return self.file_of(table, row)[0]
        declared = LAYER_TABLES[table]
        partition = frame["partition"][row] if declared.partitions else None
        if partition not in (declared.partitions or (None,)) or (declared.is_of_groups and self.part is None):
            return None
        return table_path(table, partition, self.part or 0)

    def without(self, broken: Collection[str]) -> ReleaseView:
        """This view for rules that require others, without the tables that fail those; it shares what was computed."""
        view = copy(self)
        view._broken = frozenset(broken)
        return view

    def claims(self, layer: str) -> bool:
        """Whether the dataset claims the layer."""
        return layer in self.descriptor.layers

    def has(self, table: str) -> bool:
        """Whether the release has the table, which may be optional; a file of it may break the format."""
        return table in self.tables or bool(table_paths(table, self.files))

    def frame(self, table: str) -> Frame:
        """Rows of a stored table.

        Raises:
            PreconditionError: It is missing or breaks its structure.
        """
        if table not in self.tables or table in self._broken:
            file = f"a file of the table `{table}`" if LAYER_TABLES[table].is_of_groups else table_path(table)
            raise PreconditionError(f"{file} is missing or breaks the format")
        return self.rows(table)

    def rows(self, table: str) -> Frame:
        """Rows of a decoded table, whatever rules say about them; rules share them, so they cannot be changed."""
        if table not in self._frames:
            self._frames[table] = StoredFrame(self.tables[table], table)
        return self._frames[table]

    def document(self, path: str) -> Any:
        """A stored document that conforms to its schema.

        Raises:
            PreconditionError: It is missing or does not conform.
        """
        if path not in self.documents:
            raise PreconditionError(f"{path} is missing or breaks its schema")
        return self.documents[path]

    @property
    def raw_rows(self) -> Mapping[str, Frame]:
        """What the raw layer says.

        Raises:
            PreconditionError: It is not available, or is another than the release names.
        """
        if self.raw.rows is None:
            raise PreconditionError(self.raw.reason)
        named = self.documents.get(SOURCE_FILE, {}).get("raw_layer", self.raw.digest)
        if self.raw.digest not in (None, named):
            raise PreconditionError("the given raw layer is not the one that the release was built from")
        return self.raw.rows

    def raw_shards(self, table: str) -> Iterator[Frame]:
        """What the raw layer says of a table, shard by shard: who takes one at a time holds one.

        Raises:
            PreconditionError: As `raw_rows`.
        """
        _ = self.raw_rows  # raises
        return (rows[table] for rows in self.raw.shards)

    def merged(self, piece: Callable[[ReleaseView], Piece], merge: Callable[[Sequence[Piece]], T]) -> T:
        """What follows from the rows of all parts, of pieces that each part gave.

        Rows of all parts are one piece where some part gave none, and where pieces do not fit together: what is wrong
        is said of all rows then, whatever the parts are.

        Args:
            piece: What a part gives, a function of its view that the rule was bound with.
            merge: What follows from pieces, whatever the parts are; a `ValueError` where they do not fit together.

        Raises:
            PreconditionError: As `piece`, of all rows.
            ValueError: As `piece` or `merge`, of all rows.
        """
        pieces = self.pieces_of(piece)
        if pieces is not None:
            with suppress(ValueError):
                return merge(pieces)
        return merge([piece(self)])

    def expected(self, table: str) -> Frame:
        """Rows that the raw layer gives for a table, as far as raw alone decides them.

        The model layer holds the groups of its contexts, so its tables are expected for those that raw has.

        Raises:
            PreconditionError: The raw layer, or the contexts, are not available.
        """
        if table not in self._expected:
            frame = self.raw_rows[table]
            if LAYER_TABLES[table].partitions:
                frame = with_homes(frame, self.homes)
            self._expected[table] = frame
        return self._expected[table]

    @property
    def homes(self) -> dict[str, str]:
        """Partition of every group of the contexts.

        Raises:
            PreconditionError: The contexts are missing or break their structure.
        """
        contexts = self.frame("contexts")
        return dict(zip(contexts["group_id"].tolist(), contexts["partition"].tolist(), strict=True))

    def aligned(self, table: str) -> Alignment:
        """Pairs of expected and stored rows of a table.

        Raises:
            PreconditionError: One of both is not available.
        """
        if table not in self._aligned:
            self._aligned[table] = align(self.expected(table), self.frame(table), LAYER_TABLES[table].key)
        return self._aligned[table]

    def cached(self, compute: Callable[[ReleaseView], T]) -> T:
        """Result of `compute` on this view, computed on first use: what several rules need."""
        if compute not in self._computed:
            self._computed[compute] = compute(self)
        result: T = self._computed[compute]
        return result
