"""Names and paths of a dataset, and which of them a stranger's dataset may use.

Source: spec/03-layout.md#folders, spec/09-security.md#paths.
"""

from __future__ import annotations

import re
import unicodedata
from pathlib import PurePosixPath

from branchdrive.contract.columns import TABLES
from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.errors import UsageError

__all__ = [
    "BENCHMARK",
    "BENCHMARK_LEDGER_FILE",
    "CARD_FILE",
    "DESCRIPTOR_FILE",
    "FILTERING_FILE",
    "IDENTITY_LAYERS",
    "LATENCY_FILE",
    "LAYERS",
    "LEAKAGE_FILE",
    "LEDGER_FILE",
    "LICENCE_FILE",
    "LOCK_FILE",
    "MANIFEST_FILE",
    "MAX_SHARD_INDEX",
    "PROTOCOL_FILE",
    "RANKING_LOCK_FILE",
    "RAW_DIR",
    "RESULTS_FILE",
    "SOURCE_FILE",
    "STAGING_DIR",
    "TABLES_FILE",
    "WRITER_LOCK",
    "folded",
    "layer_of",
    "shard_index",
    "shard_name",
    "unsafe_reason",
]

DESCRIPTOR_FILE = "branchdrive.json"
"""What the dataset is."""

MANIFEST_FILE = "MANIFEST.sha256"
"""Digests of every other file; written last."""

CARD_FILE = "README.md"
"""Dataset card of a release."""

LEDGER_FILE = "quality/ledger.json"
"""Test-set accesses for the release, and for benchmarks that it no longer has."""

BENCHMARK = "benchmark"
"""The layer that comes last, with its folder."""

PROTOCOL_FILE, LOCK_FILE, RANKING_LOCK_FILE, BENCHMARK_LEDGER_FILE, RESULTS_FILE, LATENCY_FILE = (
    f"{BENCHMARK}/{name}.json" for name in ("protocol", "lock", "ranking_lock", "ledger", "results", "latency")
)
"""What is compared and how, what is fixed before predictions and before selections, test-set accesses, results, and
how long the models took on one machine."""

TABLES_FILE = f"{BENCHMARK}/TABLES.md"
"""Results of the benchmark to read."""

SOURCE_FILE = "canonical/source.json"
"""The raw layer that the derived layers come from."""

FILTERING_FILE = "quality/filtering.json"
LEAKAGE_FILE = "quality/leakage.json"
"""Results of the leakage audit, where one was run."""

LICENCE_FILE = "LICENCE.txt"
"""Licence of a release."""

RAW_DIR = "raw"
"""Folder of the raw layer, one folder per shard."""

STAGING_DIR = ".staging"
"""Working area of writers; a finished dataset has none."""

WRITER_LOCK = "writer.lock"
"""Lock in the working area; who writes files of a dataset holds it, and there is one at a time."""

IDENTITY_LAYERS = ("raw", "canonical", "quality", "model")
"""Layers whose digests make up the identity of the dataset, in digest order."""

LAYERS = (*IDENTITY_LAYERS, BENCHMARK, "media")
"""Every layer, in manifest order."""

MAX_SHARD_INDEX = 999_999_999
"""Last shard that has a name: nine digits."""

_MEDIA = "media"
_MEDIA_INDEX = "frames"
_RAW_TABLE_FILES = frozenset(table.file_name for name, table in TABLES.items() if name != _MEDIA_INDEX)
_SHARD = re.compile(r"shard-([0-9]{5}|[1-9][0-9]{5,8})")
# Control characters, invisible formatting (bidirectional overrides among it), surrogates, line separators.
_UNPRINTABLE_CATEGORIES = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})


def shard_name(index: int) -> str:
    """Folder name of raw shard `index`, counted from 0.

    >>> shard_name(7)
    'shard-00007'

    Raises:
        UsageError: No shard has this index.
    """
    if not 0 <= index <= MAX_SHARD_INDEX:
        raise UsageError(f"shard {index} is not in 0 .. {MAX_SHARD_INDEX}; choose a smaller place for the group")
    return f"shard-{index:05d}"


def shard_index(name: str) -> int | None:
    """Index of the shard whose folder is called `name`; ``None`` if no shard is called so.

    >>> shard_index("shard-00007"), shard_index("shard-7")
    (7, None)
    """
    match = _SHARD.fullmatch(name)
    return int(match[1]) if match else None


def layer_of(path: str) -> str | None:
    """Layer that the file at `path`, relative to the root, belongs to; ``None`` outside every layer.

    A layer is its folder, but the media of a raw shard and their index form a layer of their own,
    so that media can be added or left out without a change of identity.

    >>> layer_of("raw/shard-00000/controls.parquet"), layer_of("raw/shard-00000/media.tar")
    ('raw', 'media')
    >>> layer_of("branchdrive.json") is None
    True
    """
    match PurePosixPath(path).parts:
        case (folder, shard, *rest) if folder == RAW_DIR and rest and shard_index(shard) is not None:
            return RAW_DIR if len(rest) == 1 and rest[0] in _RAW_TABLE_FILES else _MEDIA
        case (folder, _, *_) if folder in LAYERS and folder != _MEDIA:
            return folder
        case _:
            return None


def unsafe_reason(path: str, limits: Limits | None = None) -> str | None:
    """Why a dataset may not name the file `path`; ``None`` if it may.

    A path must be relative, normalised POSIX and mean the same file on every system.

    >>> unsafe_reason("raw/shard-00000/controls.parquet"), unsafe_reason("raw/../../secret")
    (None, 'is not normalised or leaves its folder')
    """
    limits = limits or spec_limits()
    if not path:
        return "is empty"
    # What Python calls printable is of none of these categories.
    if not path.isprintable() and any(unicodedata.category(c) in _UNPRINTABLE_CATEGORIES for c in path):
        return "holds control or formatting characters"
    if len(path.encode("utf-8")) > limits.max_path_bytes:
        return f"is longer than {limits.max_path_bytes} bytes"
    if "\\" in path:
        return "holds a backslash"
    if ":" in path:
        return "holds a colon, as drive letters do"
    parts = path.split("/")
    if len(parts) - 1 > limits.max_depth:
        return f"lies deeper than {limits.max_depth} folders"
    if parts[0] == "":
        return "is absolute"
    if any(part in {"", ".", ".."} for part in parts):
        return "is not normalised or leaves its folder"
    if any(part.endswith((" ", ".")) for part in parts):
        return "has a part that ends in a blank or a dot, which some systems drop"
    return None


def folded(path: str) -> str:
    """The path in the form in which some systems compare names: paths that are equal in it are one file there.

    >>> folded("RAW/Shard-00000") == folded("raw/shard-00000")
    True
    """
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", path).casefold())
