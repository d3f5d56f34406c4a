"""The random stream of spec/15-random-words.md in whole Python numbers, written from its text alone.

Run as a module it writes the vectors that every implementation can check itself against::

    python -m tests.validator.statistics.random_words
"""

from __future__ import annotations

import json
from fractions import Fraction
from hashlib import sha256
from pathlib import Path
from typing import Any

PATH = Path(__file__).parents[3] / "schemas" / "v0.1" / "vectors" / "random-words.json"

_MULTIPLIERS = 0xD2E7470EE14C6C93, 0xCA5A826395121157
_INCREMENTS = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B
_MASK = 2**64 - 1


def block(counter: int, key: tuple[int, int]) -> list[int]:
    """Four words of Philox-4x64-10."""
    c0, c1, c2, c3 = ((counter >> 64 * i) & _MASK for i in range(4))
    for number in range(10):
        k0, k1 = ((k + number * w) & _MASK for k, w in zip(key, _INCREMENTS, strict=True))
        p, q = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (q >> 64) ^ c1 ^ k0, q & _MASK, (p >> 64) ^ c3 ^ k1, p & _MASK
    return [c0, c1, c2, c3]


def row(seed: int, name: str, number: int, num_words: int) -> list[int]:
    """Row `number` of rows of `num_words` words of a stream."""
    key = seed, int.from_bytes(sha256(name.encode()).digest()[:8], "little")
    num_blocks = (num_words + 3) // 4
    drawn = [word for i in range(num_blocks) for word in block(number * num_blocks + i + 1, key)]
    return drawn[:num_words]


def below(word: int, limit: int) -> int:
    """An integer below `limit`."""
    return (word >> 32) * limit >> 32


def counts(drawn: list[int], limit: int) -> list[int]:
    """How often each of `limit` units is drawn."""
    indices = [below(word, limit) for word in drawn]
    return [indices.count(unit) for unit in range(limit)]


def sign_bits(drawn: list[int], num_bits: int) -> list[int]:
    """The first bits of a row."""
    return [drawn[k // 64] >> k % 64 & 1 for k in range(num_bits)]


def order(drawn: list[int]) -> list[int]:
    """Places in ascending order of words whose lowest bits are their place."""
    width = (len(drawn) - 1).bit_length()
    return [key & (1 << width) - 1 for key in sorted((w >> width << width) | i for i, w in enumerate(drawn))]


def normal(triple: list[int]) -> Fraction:
    """A nearly normal variate of three words."""
    total = sum(word >> shift & 0xFFFF for word in triple for shift in (0, 16, 32, 48))
    return Fraction(total - 393_210, 65_536)


def uniform(word: int) -> Fraction:
    """A number between 0 and 1."""
    return Fraction(2 * (word >> 12) + 1, 2**53)


def vectors() -> dict[str, Any]:
    """Draws of every kind, words as 16 hexadecimal digits."""
    rows = [
        (0, "", 0, 4), (7, "metric/bootstrap", 0, 3), (7, "metric/bootstrap", 5, 3), (2**64 - 1, "größe", 2, 9),
        (1, "leakage/permutations", 9998, 12), (11, "fidelity/retention/train", 1999, 5),
    ]  # fmt: skip
    ends = [0, 1, 2**32 - 1, 2**32, 2**63 - 1, 2**63, _MASK - 1, _MASK]
    drawn, tied = row(3, "vectors", 0, 13), [9 << 60, 3 << 60, (9 << 60) + 3, (3 << 60) + 1, 3 << 60]
    return {
        "about": "Draws of spec/15-random-words.md; words are written as 16 hexadecimal digits.",
        "philox": [
            {"key": _hexadecimal(key), "counter": str(counter), "words": _hexadecimal(block(counter, key))}
            for key, counter in (((0, 0), 0), ((_MASK, _MASK), 2**256 - 1), ((7, 11), 2**64))
        ],
        "rows": [
            {"seed": str(seed), "name": name, "row": number, "num_words": n, "words": _hexadecimal(row(*place))}
            for place in rows
            for seed, name, number, n in [place]
        ],
        "below": [
            {"words": _hexadecimal(ends), "limit": limit, "integers": [below(word, limit) for word in ends]}
            for limit in (1, 2, 7, 1000, 2**32)
        ],
        "counts": [{"words": _hexadecimal(drawn), "num_units": n, "counts": counts(drawn, n)} for n in (1, 5, 13)],
        "signs": [
            {"words": _hexadecimal(drawn), "num_signs": n, "signs": [1 - 2 * bit for bit in sign_bits(drawn, n)]}
            for n in (1, 64, 67)
        ],
        "orders": [{"words": _hexadecimal(w), "order": order(w)} for w in (drawn, drawn[:1], drawn[:8], tied)],
        "uniforms": [{"word": w, "numerator": int(uniform(int(w, 16)) * 2**53)} for w in _hexadecimal(ends)],
        "normals": [
            {"words": _hexadecimal(w), "variate": float(normal(w))} for w in (drawn[:3], [0] * 3, [_MASK] * 3, ends[5:])
        ],
    }


def _hexadecimal(numbers: Any) -> list[str]:
    return [f"{number:016x}" for number in numbers]


def text() -> str:
    """The vectors as the file has them."""
    return json.dumps(vectors(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
