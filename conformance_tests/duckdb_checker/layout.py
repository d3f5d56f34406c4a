"""Rules LAY: the folder, the manifest and its digests (spec/03-layout.md, spec/09-security.md)."""

import fnmatch
import hashlib
import os
import re
import stat
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from contract import DERIVED, LIMITS, RAW_TABLES, STREAMS, TABLES, VERSION

MANIFEST, DESCRIPTOR, IGNORE = "MANIFEST.sha256", "branchdrive.json", ".branchdriveignore"
_IDENTITY_TABLES = {f"{table}.parquet" for table in RAW_TABLES if table != "frames"}
LAYERS = ("raw", "canonical", "quality", "model", "benchmark", "media")
IDENTITY = LAYERS[:4]
_PART = "([0-9]{5}|[1-9][0-9]{5,7})"
PARTITIONS = ("train", "val", "calibration", "test")
SHARD = re.compile(r"raw/shard-(?:[0-9]{5}|[1-9][0-9]{5,8})(?=/|$)")
COMPANIONS = {
    "README.md", ".gitattributes", ".gitignore", ".git", ".cache", ".huggingface", IGNORE, "croissant.json",
    ".zenodo.json", "codemeta.json",
}  # fmt: skip
COMPANIONS_ANYWHERE = {".DS_Store", "Thumbs.db"}
WORKING_FOLDER = ".staging"
_WORKING_SUFFIXES = (".tmp", ".part", ".partial")
_PICKLE_SUFFIXES = (".pkl", ".pickle", ".joblib", ".pt", ".pth")
_CODE_HEADS = ("8002", "8003", "8004", "8005", "7f454c46", "4d5a9000", "cffaedfe", "cefaedfe", "cafebabe", "23212f")
_LINE = re.compile(r"([0-9a-f]{64})  (.+)", re.DOTALL)
_HEAD = re.compile(r"# (layer [a-z]+|dataset) ([0-9a-f]{64})")
_UNSAFE_CATEGORIES = {"Cc", "Cf", "Cs", "Zl", "Zp"}

Location = dict[str, Any]


def safe(path: str) -> bool:
    """Whether a path is relative and normalised and has no character that could mislead."""
    parts = path.split("/")
    return (
        all(part not in ("", ".", "..") and not part.endswith((" ", ".")) for part in parts)
        and not set(path) & {"\\", ":"}
        and not any(unicodedata.category(char) in _UNSAFE_CATEGORIES for char in path)
    )


def folded(path: str) -> str:
    """A path as systems know it that tell neither case nor forms of letters apart."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFD", path).casefold())


UNHIDEABLE = {folded(name) for name in (DESCRIPTOR, MANIFEST, "LICENCE.txt", WORKING_FOLDER, *LAYERS[:5])}


def readable(path: str) -> bool:
    """Whether a file may be opened: its path is safe and within the limits."""
    short = len(os.fsencode(path)) <= LIMITS["max_path_bytes"]
    return short and path.count("/") <= LIMITS["max_depth"] and safe(path)


def layer_of(path: str) -> str | None:
    """The layer that a file belongs to, or None in the root."""
    top, _, rest = path.partition("/")
    if not rest or top not in LAYERS[:5]:
        return None
    shard = SHARD.match(path)
    is_in_shard = top == "raw" and shard is not None and shard[0] != path
    is_table = path.count("/") == 2 and path.rsplit("/", 1)[-1] in _IDENTITY_TABLES
    return "media" if is_in_shard and not is_table else top


def shard_of(path: str) -> str | None:
    """The folder of the shard that a file lies in, or None outside of shards."""
    match = SHARD.match(path)
    return match[0] if match else None


@dataclass
class Manifest:
    """A manifest as it was parsed; `broken` says why it is not well formed."""

    digests: dict[str, str] = field(default_factory=dict)
    stated: dict[str, str] = field(default_factory=dict)
    unsafe: int = 0
    broken: str | None = None


def parse_manifest(data: bytes | None) -> Manifest:
    """Reads the manifest; a line that breaks its form spoils it as a whole, and one with an unsafe path is no line."""
    if data is None:
        return Manifest(broken="missing")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        return Manifest(broken="not UTF-8")
    if not text.endswith("\n"):
        return Manifest(broken="the last line is cut off")
    first, *lines = text[:-1].split("\n")
    if first != f"# branchdrive-manifest {VERSION}":
        return Manifest(broken="the first line is another")
    heads = []
    while lines and lines[0].startswith("#"):
        heads.append(_HEAD.fullmatch(lines.pop(0)))
    files = [_LINE.fullmatch(line) for line in lines]
    if any(match is None for match in [*heads, *files]):
        return Manifest(broken="a line has another form")
    names = [head[1].removeprefix("layer ") for head in heads if head]
    paths = [match[2] for match in files if match]
    order = [*LAYERS, "dataset"]
    if any(name not in order for name in names) or names[-1:] != ["dataset"]:
        return Manifest(broken="the identity is missing")
    if [order.index(name) for name in names] != sorted({order.index(name) for name in names}):
        return Manifest(broken="layers are out of order")
    keys = [path.encode() for path in paths if readable(path)]
    if keys != sorted(set(keys)) or MANIFEST in paths:
        return Manifest(broken="paths are out of order, repeated, or the manifest's own")
    return Manifest(
        {match[2]: match[1] for match in files if match and readable(match[2])},
        {head[1].removeprefix("layer "): head[2] for head in heads if head},
        sum(not readable(path) for path in paths),
    )


@dataclass(frozen=True)
class Folder:
    """A dataset's folder: what lies in it, by kind, without its companions."""

    root: Path

    def read(self, path: str, limit: int) -> bytes | None:
        """Bytes of a regular file, or None where there is none or it exceeds the limit."""
        entry = self.root / path
        if not (entry.exists() and stat.S_ISREG(entry.lstat().st_mode)) or entry.lstat().st_size > limit:
            return None
        return entry.read_bytes()

    @cached_property
    def manifest(self) -> Manifest:
        """The parsed manifest."""
        return parse_manifest(self.read(MANIFEST, LIMITS["max_manifest_bytes"]))

    @cached_property
    def ignore_faults(self) -> list[str]:
        """Why the ignore file cannot be followed."""
        entry = self.root / IGNORE
        if not os.path.lexists(entry):
            return []
        data = self.read(IGNORE, LIMITS["max_ignore_bytes"]) if not entry.is_symlink() else None
        if data is None:
            return ["not a regular file within the limits"]
        try:
            patterns = [line for line in data.decode("utf-8").splitlines() if line.strip() and not line.startswith("#")]
        except UnicodeDecodeError:
            return ["not UTF-8"]
        if len(patterns) > LIMITS["max_ignore_patterns"]:
            return ["too many patterns"]
        return [line for line in patterns if "/" in line.removesuffix("/") or line != line.strip()]

    @cached_property
    def patterns(self) -> list[str]:
        """Patterns of further companions; none where the ignore file breaks its rules."""
        data = self.read(IGNORE, LIMITS["max_ignore_bytes"])
        if data is None or self.ignore_faults:
            return []
        lines = data.decode("utf-8").splitlines()
        return [
            line.removesuffix("/").replace("[", "[[]") for line in lines if line.strip() and not line.startswith("#")
        ]

    @cached_property
    def _listed(self) -> set[str]:
        """Files that the manifest lists and the names of the root that they lie under, folded."""
        paths = [folded(path) for path in self.manifest.digests]
        return {name for path in paths for name in (path, path.split("/")[0])}

    def is_companion(self, path: str) -> bool:
        """Whether an entry is no part of the dataset."""
        if folded(path) in self._listed:
            return False
        if path.rsplit("/", 1)[-1] in COMPANIONS_ANYWHERE:
            return True
        if "/" in path:
            return False
        hidden = folded(path) not in UNHIDEABLE and any(fnmatch.fnmatchcase(path, pattern) for pattern in self.patterns)
        return path in COMPANIONS or hidden

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Every entry below the root by its path: `file`, `folder` or `other`."""
        return dict(self._walk(""))

    def _walk(self, folder: str) -> Iterator[tuple[str, str]]:
        for entry in sorted(os.scandir(self.root / folder), key=lambda entry: entry.name):
            path = f"{folder}/{entry.name}" if folder else entry.name
            if self.is_companion(path):
                continue
            mode = entry.stat(follow_symlinks=False).st_mode
            if stat.S_ISDIR(mode):
                yield path, "folder"
                if path != WORKING_FOLDER and safe(path):
                    yield from self._walk(path)
            else:
                yield path, "file" if stat.S_ISREG(mode) else "other"

    @property
    def num_repeated_bytes(self) -> int:
        """Bytes of files that have several names, counted for every name but the first."""
        entries = [(self.root / path).lstat() for path, kind in self.kinds.items() if kind == "file"]
        once = {(entry.st_dev, entry.st_ino): entry.st_size for entry in entries}
        return sum(entry.st_size for entry in entries) - sum(once.values())

    @cached_property
    def digests(self) -> dict[str, str]:
        """SHA-256 of every listed file that exists."""
        found = {}
        for path in self.manifest.digests:
            if self.kinds.get(path) == "file":
                with (self.root / path).open("rb") as file:
                    found[path] = hashlib.file_digest(file, "sha256").hexdigest()
        return found

    @cached_property
    def sound(self) -> set[str]:
        """Files whose bytes are those that the manifest names, or that it does not list."""
        files = {path for path, kind in self.kinds.items() if kind == "file"}
        return {path for path in files if self.digests.get(path) == self.manifest.digests.get(path)}

    @cached_property
    def shards(self) -> list[str]:
        """Folders of shards, empty ones and the listed ones whose files are gone included."""
        listed = [name for name in self.manifest.digests if (match := SHARD.match(name)) and name != match[0]]
        folders = [name for name, kind in self.kinds.items() if kind == "folder"]
        return sorted({match[0] for name in (*folders, *listed) if (match := SHARD.match(name))})


def num_examined(rule: str, folder: Folder) -> int:
    """How many files a rule examines, of those that may have nothing to examine."""
    of_some = {
        "BD-LAY-002": len(folder.digests),
        "BD-LAY-003": len(folder.manifest.digests),
        "BD-LAY-010": int(os.path.lexists(folder.root / IGNORE)),
    }
    return of_some.get(rule, 1)


def lay_001(folder: Folder) -> list[Location]:
    """Manifest is present and well formed."""
    return [{"file": MANIFEST}] if folder.manifest.broken else []


def lay_002(folder: Folder) -> list[Location]:
    """File digests match the manifest."""
    listed = folder.manifest.digests
    return [{"file": path} for path, digest in folder.digests.items() if digest != listed[path]]


def lay_003(folder: Folder) -> list[Location]:
    """Every file of the manifest exists."""
    return [{"file": path} for path in folder.manifest.digests if folder.kinds.get(path, "folder") == "folder"]


def lay_004(folder: Folder) -> list[Location]:
    """Every file is listed in the manifest."""
    expected = {MANIFEST, *folder.manifest.digests}
    files = [path for path, kind in folder.kinds.items() if kind == "file" and path not in expected and readable(path)]
    return [{"file": path} for path in files] + [{"file": WORKING_FOLDER}] * (WORKING_FOLDER in folder.kinds)


def lay_005(folder: Folder) -> list[Location]:
    """Paths are safe, stay inside the root, and differ by more than case and form of letters."""
    found = [{"file": path} for path in folder.kinds if not safe(path)] + [{"file": MANIFEST}] * folder.manifest.unsafe
    seen = set()
    for path in sorted(folder.kinds):
        name = folded(path)
        found += [{"file": path}] * (name in seen)
        seen.add(name)
    return found


def lay_006(folder: Folder) -> list[Location]:
    """Only regular files and folders."""
    return [{"file": path} for path, kind in folder.kinds.items() if kind == "other"]


def lay_007(folder: Folder) -> list[Location]:
    """Limits of paths, of their number and of the manifest hold; limits of tables are judged where they are read."""
    found = []
    for path, kind in folder.kinds.items():
        size = (folder.root / path).lstat().st_size if kind == "file" else 0
        limit = LIMITS["max_table_bytes" if path.endswith(".parquet") else "max_media_bytes"]
        if path == MANIFEST:
            limit = LIMITS["max_manifest_bytes"]
        if (safe(path) and not readable(path)) or size > limit:
            found.append({"file": path})
    if sum(kind == "file" for kind in folder.kinds.values()) > LIMITS["max_files"]:
        found.append({"file": ""})
    if folder.num_repeated_bytes > LIMITS["max_repeated_bytes"]:
        found.append({"file": ""})
    return found


def lay_008(folder: Folder) -> list[Location]:
    """Layer digests and dataset identity match their recomputation."""
    texts: dict[str, str] = {}
    for path, digest in folder.manifest.digests.items():
        layer = layer_of(path)
        if layer is not None:
            texts[layer] = texts.get(layer, "") + f"{digest}  {path}\n"
    layers = {layer: hashlib.sha256(text.encode()).hexdigest() for layer, text in texts.items()}
    identity = "".join(f"layer {name} {layers[name]}\n" for name in IDENTITY if name in layers)
    expected = {**layers, "dataset": hashlib.sha256(identity.encode()).hexdigest()}
    stated = folder.manifest.stated
    names = [name for name in {**expected, **stated} if expected.get(name) != stated.get(name)]
    return [{"file": MANIFEST, "pointer": name if name == "dataset" else f"layer {name}"} for name in names]


def in_layer(layer: str, path: str, kind: str) -> bool:
    """Whether a derived layer declares a file or a folder, by its path in the layer."""
    declared = DERIVED[layer]
    free = declared.get("free", [])
    if kind == "folder":
        return any(expression.startswith(f"^{path}/") for expression in free)
    names = set(declared["documents"])
    for table, traits in declared["tables"].items():
        stem = f"{table}-({'|'.join(PARTITIONS)})" if "divided_by" in traits else table
        is_of_groups = not {"group_id", "rollout_id"}.isdisjoint(traits["key"])
        if re.fullmatch(stem + (f"-{_PART}" if is_of_groups else "") + r"\.parquet", path):
            return True
    return path in names or any(re.search(expression, path) for expression in free)


def lay_009(folder: Folder, descriptor: dict[str, Any]) -> list[Location]:
    """Files have a place in the layout."""
    streams = [STREAMS[name] for name in descriptor["streams"]]
    tables = {f"{table}.parquet" for stream in streams for table in stream["tables"]}
    media = any(stream.get("cameras") for stream in streams)
    layers = descriptor.get("layers", ["raw"])
    root = {MANIFEST, DESCRIPTOR, "README.md", "LICENCE.txt", WORKING_FOLDER}

    def is_code(path: str) -> bool:
        with (folder.root / path).open("rb") as file:
            return file.read(4).hex().startswith(_CODE_HEADS) or path.lower().endswith(_PICKLE_SUFFIXES)

    def placed(path: str, kind: str) -> bool:
        parts = path.split("/")
        if len(parts) == 1:
            return path in layers if kind == "folder" else path in root
        if parts[0] != "raw":
            return parts[0] in layers and in_layer(*path.split("/", 1), kind)
        if len(parts) == 2:
            return kind != "file" and SHARD.fullmatch(path) is not None
        if any(parts[2].startswith(f"{table}.parquet.") for table in TABLES) or parts[2].endswith(_WORKING_SUFFIXES):
            return False
        known = parts[2].removesuffix(".parquet") in TABLES and parts[2].endswith(".parquet")
        if not known and len(parts) == 3 and kind == "file" and is_code(path):
            return False
        return len(parts) == 3 and kind != "folder" and (parts[2] in tables or (media and not known))

    found: list[str] = []
    for path, kind in folder.kinds.items():
        listed = kind == "folder" or path in folder.manifest.digests
        inside = any(path.startswith(outer + "/") for outer in found)
        if listed and readable(path) and path != WORKING_FOLDER and not inside and not placed(path, kind):
            found.append(path)
    return [{"file": path} for path in found]


def lay_010(folder: Folder) -> list[Location]:
    """The ignore file is bounded."""
    return [{"file": IGNORE} for _ in folder.ignore_faults]
