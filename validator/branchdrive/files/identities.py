"""Identities of a shard as one block of bytes: what waits of many shards until they are compared.

A text of Python takes twice its length and more. Digests of 64 bits stand for identities where those of all shards
are compared; where two are equal, the texts are.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from typing import overload

import numpy as np
from numpy.typing import NDArray

from branchdrive.files.identity_print import prints_of, repeated

__all__ = ["Identities", "repeated_texts"]

_ENCODING = ("utf-8", "surrogatepass")


class Identities(Sequence[str]):
    """Texts in their order.

    Args:
        texts: The texts.

    Attributes:
        digests: Their prints; see `prints_of` ``[texts]``.
    """

    def __init__(self, texts: Iterable[str] = ()) -> None:
        texts = [*texts]
        encoded = [text.encode(*_ENCODING) for text in texts]
        self._stops = np.cumsum([len(text) for text in encoded], dtype=np.int32)
        self._block = zlib.compress(b"".join(encoded), 1)
        self.digests: NDArray[np.uint64] = prints_of(texts)

    @classmethod
    def of(cls, texts: Sequence[str]) -> Identities:
        """The texts as such a block."""
        return texts if isinstance(texts, cls) else cls(texts)

    def __len__(self) -> int:
        return len(self._stops)

    def __iter__(self) -> Iterator[str]:
        block, start = zlib.decompress(self._block), 0
        for stop in self._stops.tolist():
            yield block[start:stop].decode(*_ENCODING)
            start = stop

    @overload
    def __getitem__(self, index: int) -> str: ...

    @overload
    def __getitem__(self, index: slice) -> list[str]: ...

    def __getitem__(self, index: int | slice) -> str | list[str]:
        return [*self][index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and not isinstance(other, str) and [*self] == [*other]

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Identities({len(self)} texts)"


def repeated_texts(every: Sequence[Sequence[str]]) -> dict[str, list[int]]:
    """Texts that occur more than once, and for each occurrence the number of its sequence, in order."""
    blocks = [Identities.of(texts) for texts in every]
    return repeated({number: block.digests for number, block in enumerate(blocks)}, blocks.__getitem__)
