"""The manifest `MANIFEST.sha256`: a digest of every file, of every layer, and the dataset's identity.

The text is what ``sha256sum -c`` reads, with the derived digests in comment lines on top::

    # branchdrive-manifest 0.1
    # layer raw <64 hexadecimal digits>
    # dataset <64 hexadecimal digits>
    <64 hexadecimal digits>  raw/shard-00000/controls.parquet

Source: spec/03-layout.md#manifest, #digests, #identity.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from branchdrive.contract.companion import IGNORE_FILE, Companions, ignored_names
from branchdrive.contract.layout import (
    CARD_FILE,
    IDENTITY_LAYERS,
    LAYERS,
    MANIFEST_FILE,
    STAGING_DIR,
    layer_of,
    unsafe_reason,
)
from branchdrive.contract.limits import Limits, spec_limits
from branchdrive.contract.mismatch import Mismatch
from branchdrive.errors import DatasetError
from branchdrive.formats.durable import partial_path
from branchdrive.formats.folder import Folder
from branchdrive.formats.store import Store

__all__ = [
    "SAFE_PATH", "WELL_FORMED", "Manifest", "build_manifest", "check_against_manifest", "files_of", "malformed",
    "parse_manifest", "read_manifest", "sound_manifest", "write_manifest",
]  # fmt: skip

_QUALITY = "quality"
_HEADER = "# branchdrive-manifest 0.1"
_LAYER_LINE = re.compile(r"# layer ([a-z]+) ([0-9a-f]{64})")
_DATASET_LINE = re.compile(r"# dataset ([0-9a-f]{64})")
_FILE_LINE = re.compile(r"([0-9a-f]{64})  (.+)")
_DIGEST_COLUMNS = 66
_MAX_MISMATCHES = 100

WELL_FORMED = "a well-formed manifest"
"""What is expected of a manifest's text."""

SAFE_PATH = "a safe relative path"
"""What is expected of a path: another is one that no dataset may name."""


def malformed(line: int, message: str) -> Mismatch:
    """What is wrong with a line of a manifest's text; lines count from 1, line 0 is the whole file."""
    return Mismatch({"file": MANIFEST_FILE}, WELL_FORMED, f"line {line} {message}")


@dataclass(frozen=True)
class Manifest:
    """What a manifest states. It may state wrong digests: compare it with ``Manifest.of(manifest.files)``.

    Attributes:
        files: SHA-256 of every file by path relative to the root, hexadecimal.
        layers: Digest of every layer that has files, in the order of `LAYERS`.
        identity: Identity of the dataset.
    """

    files: Mapping[str, str]
    layers: Mapping[str, str]
    identity: str

    @classmethod
    def of(cls, files: Mapping[str, str]) -> Manifest:
        """The manifest whose layer digests and identity follow from `files`.

        ``layer = SHA-256(its file lines)``, ``identity = SHA-256(layer lines of IDENTITY_LAYERS)``.
        """
        lines: dict[str, list[str]] = {}
        for path in sorted(files):
            layer = layer_of(path)
            if layer is not None:
                lines.setdefault(layer, []).append(_file_line(files[path], path))
        layers = {layer: _digest(lines[layer]) for layer in LAYERS if layer in lines}
        identity = _digest([f"layer {name} {layers[name]}\n" for name in IDENTITY_LAYERS if name in layers])
        return cls({path: files[path] for path in sorted(files)}, layers, identity)

    def render(self) -> bytes:
        """The manifest's text."""
        head = [f"{_HEADER}\n"]
        head += [f"# layer {name} {self.layers[name]}\n" for name in LAYERS if name in self.layers]
        head += [f"# dataset {self.identity}\n"]
        return "".join(head + [_file_line(self.files[path], path) for path in sorted(self.files)]).encode()

    def __repr__(self) -> str:
        return f"Manifest({len(self.files)} files, layers {list(self.layers)}, identity {self.identity!r})"


def _file_line(digest: str, path: str) -> str:
    return f"{digest}  {path}\n"


def _digest(lines: list[str]) -> str:
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def parse_manifest(content: bytes, limits: Limits | None = None) -> tuple[Manifest, list[Mismatch]]:
    """Read a manifest that may be hostile.

    Returns:
        What could be read, and what is wrong with the text: at most 100 mismatches, reading stops there.
        Whether the stated layer digests and identity follow from the files is not judged here.
    """
    limits = limits or spec_limits()
    if len(content) > limits.max_manifest_bytes:
        too_long = malformed(0, f"has {len(content)} bytes; the limit is {limits.max_manifest_bytes}")
        return Manifest({}, {}, ""), [too_long]
    reading = _Reading(limits)
    number = 0
    for number, line in _lines(content):
        reading.take(number, line)
        if reading.is_over:
            break
    reading.end(number, terminated=content.endswith(b"\n"))
    return Manifest(reading.files, reading.layers, reading.identity), reading.mismatches


def _lines(content: bytes) -> Iterator[tuple[int, memoryview]]:
    """Numbered lines without their line feed, none of them copied."""
    view = memoryview(content)
    number = start = 0
    while start < len(content):
        number += 1
        end = content.find(b"\n", start)
        end = len(content) if end < 0 else end
        yield number, view[start:end]
        start = end + 1


class _Reading:
    """State of one pass over a manifest's lines."""

    def __init__(self, limits: Limits) -> None:
        self.files: dict[str, str] = {}
        self.layers: dict[str, str] = {}
        self.identity = ""
        self.mismatches: list[Mismatch] = []
        self.is_over = False
        self._limits = limits
        self._last_path = ""

    def take(self, number: int, line: memoryview) -> None:
        """Read line `number`."""
        text = self._text(number, line)
        if text is None:
            return
        if number == 1:
            if text != _HEADER:
                self._report(number, f"expected {_HEADER!r}, found {text[:80]!r}")
        elif text.startswith("#"):
            self._take_digest(number, text)
        else:
            self._take_file(number, text)

    def end(self, number: int, *, terminated: bool) -> None:
        """Judge the text as a whole after its last line."""
        if number == 0:
            self._report(1, f"expected {_HEADER!r}, found an empty file")
        elif not self.is_over:
            if not terminated:
                self._report(number, "the last line has no line feed; the manifest may be cut off")
            if not self.identity:
                self._report(number, "states no dataset identity: the line `# dataset <digest>` is missing")

    def _text(self, number: int, line: memoryview) -> str | None:
        if len(line) > _DIGEST_COLUMNS + self._limits.max_path_bytes:
            self._report(number, f"has {len(line)} bytes, more than a digest and the longest allowed path")
            return None
        try:
            return bytes(line).decode("utf-8")
        except UnicodeDecodeError as error:
            self._report(number, f"is not UTF-8 at byte {error.start}")
            return None

    def _take_digest(self, number: int, text: str) -> None:
        if self.files:
            self._report(number, f"comment lines stand above the files; found {text[:80]!r}")
        elif match := _LAYER_LINE.fullmatch(text):
            later = LAYERS[LAYERS.index(match[1]) :] if match[1] in LAYERS else ()
            if not later or self.identity or any(name in self.layers for name in later):
                self._report(number, f"layers are {', '.join(LAYERS)}, once each, in this order; found {match[1]!r}")
            else:
                self.layers[match[1]] = match[2]
        elif (match := _DATASET_LINE.fullmatch(text)) and not self.identity:
            self.identity = match[1]
        else:
            self._report(number, f"is no layer or dataset line of this version, or repeats one: {text[:80]!r}")

    def _take_file(self, number: int, text: str) -> None:
        match = _FILE_LINE.fullmatch(text)
        if match is None:
            form = "64 lower-case hexadecimal digits, two blanks and a path"
            self._report(number, f"expected {form}, found {text[:80]!r}")
            return
        digest, path = match.groups()
        reason = unsafe_reason(path, self._limits)
        if reason is not None:
            self._note(number, Mismatch({"file": MANIFEST_FILE}, SAFE_PATH, f"path {path!r} {reason}"))
        elif path == MANIFEST_FILE:
            self._report(number, "lists the manifest itself")
        elif path in self.files:
            self._report(number, f"path {path!r} is listed twice")
        elif len(self.files) == self._limits.max_files:
            self._report(number, f"lists more than {self._limits.max_files} files; the rest was not read")
            self.is_over = True
        else:
            if path < self._last_path:
                self._report(number, f"path {path!r} is out of order; paths are sorted by their bytes")
            self._last_path = path
            self.files[path] = digest

    def _report(self, number: int, message: str) -> None:
        self._note(number, malformed(number, message))

    def _note(self, number: int, mismatch: Mismatch) -> None:
        self.mismatches.append(mismatch)
        if len(self.mismatches) == _MAX_MISMATCHES - 1:
            self.mismatches.append(malformed(number, "has too many problems; the rest was not read"))
            self.is_over = True


def read_manifest(dataset: Store) -> tuple[Manifest, list[Mismatch]]:
    """The manifest of a dataset, and what is wrong with its text; see `parse_manifest`.

    Raises:
        DatasetError: There is none, or it cannot be read.
    """
    return parse_manifest(dataset.read(MANIFEST_FILE, spec_limits().max_manifest_bytes))


def build_manifest(
    dataset: Store, listed: Collection[str] = (), *, known: Mapping[str, str] = MappingProxyType({})
) -> Manifest:
    """Digest every file of a dataset, except the manifest itself, a writer's working area and companions.

    Where there is a quality layer, `README.md` is the card of the release and no companion.

    Args:
        dataset: Its folder.
        listed: Paths of files that are part of the dataset, whatever they are called.
        known: Digests of files that need not be read, by path.

    Raises:
        DatasetError: The dataset holds a link, a special file or an unsafe path, or its ignore file is malformed.
    """
    return Manifest.of({path: known.get(path) or dataset.digest(path) for path in files_of(dataset, listed)})


def check_against_manifest(dataset: Store, *, known: Mapping[str, str] = MappingProxyType({})) -> Manifest:
    """Manifest of a finished dataset whose files are exactly those that it lists.

    Args:
        dataset: Its folder.
        known: Digests of files that need not be read, by path.

    Raises:
        DatasetError: The manifest is damaged, or a file differs, is missing or is not listed.
    """
    listed, mismatches = read_manifest(dataset)
    found = build_manifest(dataset, listed.files, known=known)
    if mismatches or listed != found:
        paths = sorted(path for path, _ in set(listed.files.items()) ^ set(found.files.items()))
        what = f"{sorted(set(paths))[:5]} differ" if paths else "derived digests differ"
        raise DatasetError(f"{dataset}: is finished, but {what} from {MANIFEST_FILE}; restore the files first")
    return found


def sound_manifest(dataset: Store) -> Manifest:
    """Manifest of a finished dataset that names each of its files, whatever is in them.

    Raises:
        DatasetError: There is none, it is damaged, or a file is missing or not listed.
    """
    manifest, mismatches = read_manifest(dataset)
    if mismatches or manifest != Manifest.of(manifest.files):
        raise DatasetError(f"{dataset}: {MANIFEST_FILE} is damaged; run `branchdrive-validate`")
    different = sorted({*files_of(dataset, manifest.files)} ^ {*manifest.files})
    if different:
        raise DatasetError(f"{dataset}: {MANIFEST_FILE} and the files differ in {different[:5]}; restore them first")
    return manifest


def files_of(dataset: Store, listed: Collection[str] = ()) -> Iterator[str]:
    """Paths of the files that the manifest of a dataset has to list; see `build_manifest`."""
    patterns: tuple[str, ...] = ()
    if dataset.status(IGNORE_FILE) is not None:
        try:
            patterns = ignored_names(dataset.read(IGNORE_FILE, spec_limits().max_ignore_bytes))
        except ValueError as error:
            raise DatasetError(f"{dataset}: {IGNORE_FILE!r} {error}; correct it") from error
    quality = dataset.status(_QUALITY)
    card = [CARD_FILE] if quality is not None and quality.kind == "folder" else []
    companions = Companions((*listed, *card), patterns)
    not_listed = {MANIFEST_FILE, partial_path(Path(MANIFEST_FILE)).name, STAGING_DIR}
    folders = [""]
    while folders:
        folder = folders.pop()
        for entry in dataset.entries(folder)[1]:
            if entry.path in not_listed or entry.path in companions:
                continue
            reason = unsafe_reason(entry.path)
            if reason is not None:
                raise DatasetError(f"{dataset}: path {entry.path!r} {reason}; rename it before the dataset is finished")
            if entry.kind == "folder":
                folders.append(entry.path)
            elif entry.kind == "file":
                yield entry.path
            else:
                raise DatasetError(
                    f"{dataset}: {entry.path!r} is a link or a special file; put a regular file in its place"
                )


def write_manifest(dataset: Folder, manifest: Manifest) -> None:
    """Write the manifest of a dataset: durable, and never visible in parts."""
    dataset.replace(MANIFEST_FILE, manifest.render())
