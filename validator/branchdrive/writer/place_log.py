"""The log of committed shards, `.staging/places.log`: a line for each, appended when it is visible and never changed.

The first line says how many places a shard has. A later line of a shard replaces an earlier one. A reader of the
log goes on where it stopped, so that a commit costs each process the shard that was committed and nothing else.

What counts is in the shards themselves: a last line that a kill cut off is no line, what follows a damaged one is
forgotten, and the next `DatasetWriter` reads those shards instead.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from branchdrive.files.identity_print import prints_of
from branchdrive.formats.durable import replace_file
from branchdrive.formats.file_error import named

__all__ = ["LOG_FILE", "CommittedShard", "FileState", "KnownFile", "PlaceLog", "place_log"]

LOG_FILE = "places.log"
"""The log, in the staging area."""

_MAX_HEADER_BYTES = 128


class FileState(NamedTuple):
    """What tells that a file is the one that was looked at, and has not changed since."""

    size_bytes: int
    mtime_ns: int
    inode: int

    @classmethod
    def at(cls, path: Path) -> Self | None:
        """State of the file at `path`; ``None`` where nothing is."""
        try:
            status = path.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        return cls(status.st_size, status.st_mtime_ns, status.st_ino)


class KnownFile(NamedTuple):
    """A file whose digest is known as long as it has this state."""

    sha256: str
    state: FileState


@dataclass(frozen=True)
class CommittedShard:
    """What is known of a visible shard.

    Attributes:
        index: Its number.
        places: Place of each of its groups, by group id.
        prints: Prints of the identities of its attempts, 16 hexadecimal digits each, one after the other.
        files: Its files by name, those whose digest is known.
    """

    index: int
    places: Mapping[str, int]
    prints: str
    files: Mapping[str, KnownFile]

    @classmethod
    def of(
        cls, index: int, places: Mapping[str, int], rollout_ids: Iterable[str], files: Mapping[str, KnownFile]
    ) -> Self:
        """A shard with the attempts `rollout_ids`."""
        return cls(index, places, prints_of(rollout_ids).astype(">u8").tobytes().hex(), files)

    @property
    def rollout_prints(self) -> NDArray[np.uint64]:
        """Prints of the identities of its attempts ``[attempts]``."""
        return np.frombuffer(bytes.fromhex(self.prints), dtype=">u8").astype(np.uint64)

    def render(self) -> bytes:
        """The shard as a line of the log."""
        files = {name: [known.sha256, *known.state] for name, known in self.files.items()}
        document = {"shard": self.index, "places": dict(self.places), "rollouts": self.prints, "files": files}
        return _line(document)

    @classmethod
    def parse(cls, line: bytes) -> Self | None:
        """The shard of a line of the log; ``None`` where it is cut off or damaged."""
        document = _document(line)
        try:
            files = {
                str(name): KnownFile(str(sha256), FileState(int(size), int(mtime), int(inode)))
                for name, (sha256, size, mtime, inode) in document["files"].items()
            }
            places = {str(group_id): int(place) for group_id, place in document["places"].items()}
            bytes.fromhex(document["rollouts"])
            return cls(int(document["shard"]), places, document["rollouts"], files)
        except (KeyError, TypeError, ValueError, AttributeError):
            return None


class PlaceLog:
    """The log at `path` as far as it was read. Read it and append to it under the lock of the staging area only.

    Attributes:
        groups_per_shard: Places of one shard: place ``i`` lies in shard ``i // groups_per_shard``.
        committed: Place of every group in a shard, by group id.
        last_place: The last of them; -1 where there is none.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._forget()

    def _forget(self) -> None:
        self._header: bytes | None = None
        self._end = 0
        self._spans: dict[int, tuple[int, int]] = {}
        self._groups: dict[int, Mapping[str, int]] = {}
        self.groups_per_shard = 0
        self.committed: dict[str, int] = {}
        self.last_place = -1

    def read_on(self) -> bool:
        """Read what was appended since the last time; whether there is a log."""
        try:
            stream = self._path.open("rb")
        except FileNotFoundError:
            self._forget()
            return False
        with named(self._path), stream:
            header = os.pread(stream.fileno(), _MAX_HEADER_BYTES, 0).partition(b"\n")[0] + b"\n"
            if header != self._header or os.fstat(stream.fileno()).st_size < self._end:
                self._forget()
                size = _document(header).get("groups_per_shard")
                is_whole = os.fstat(stream.fileno()).st_size >= len(header)
                if not is_whole or type(size) is not int or size < 1:
                    return False
                self._header, self._end, self.groups_per_shard = header, len(header), size
            stream.seek(self._end)
            for line in stream:
                shard = CommittedShard.parse(line)
                if shard is None:
                    break
                self._take(shard, len(line))
        return True

    def _take(self, shard: CommittedShard, num_bytes: int) -> None:
        for group_id in self._groups.get(shard.index, ()):
            self.committed.pop(group_id, None)
        self.committed.update(shard.places)
        self.last_place = max(self.last_place, *shard.places.values()) if shard.places else self.last_place
        self._groups[shard.index] = shard.places
        self._spans[shard.index] = (self._end, num_bytes)
        self._end += num_bytes

    @property
    def shards(self) -> list[int]:
        """Numbers of the committed shards, sorted."""
        return sorted(self._spans)

    @property
    def is_torn(self) -> bool:
        """Whether something follows the last line that could be read."""
        return self._path.stat().st_size > self._end

    def shard_of(self, index: int) -> int:
        """Shard that place `index` lies in."""
        return index // self.groups_per_shard

    def groups_of(self, shard: int) -> Mapping[str, int]:
        """Places of the groups of a shard, by group id; empty where it is not committed."""
        return self._groups.get(shard, {})

    def holder_of(self, index: int) -> str | None:
        """The committed group at place `index`."""
        groups = self.groups_of(self.shard_of(index))
        return next((group_id for group_id, place in groups.items() if place == index), None)

    def read_shard(self, shard: int) -> CommittedShard | None:
        """All that is known of a shard, from its line; ``None`` where it is not committed."""
        if shard not in self._spans:
            return None
        start, num_bytes = self._spans[shard]
        with named(self._path), self._path.open("rb") as stream:
            stream.seek(start)
            return CommittedShard.parse(stream.read(num_bytes))

    def append(self, shard: CommittedShard) -> None:
        """Add a shard that is visible now, durably; what a kill left of a line goes."""
        self.read_on()
        line = shard.render()
        with named(self._path), self._path.open("r+b") as stream:
            stream.seek(self._end)
            stream.truncate()
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._take(shard, len(line))

    def begin(self, groups_per_shard: int, shards: Iterable[CommittedShard] = ()) -> None:
        """Write a log of these shards in place of what there is; other readers notice it by the first line."""
        header = _line({"groups_per_shard": groups_per_shard, "begun": os.urandom(8).hex()})
        replace_file(self._path, header + b"".join(shard.render() for shard in shards))
        self.read_on()


@lru_cache(maxsize=16)
def place_log(path: Path) -> PlaceLog:
    """The log at `path`, an absolute one; each process reads a line of it once."""
    return PlaceLog(path)


def _line(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, sort_keys=True, separators=(",", ":")).encode() + b"\n"


def _document(line: bytes) -> dict[str, Any]:
    """The object that a line holds; empty where it is cut off or damaged."""
    try:
        document = json.loads(line) if line.endswith(b"\n") else None
    except (ValueError, RecursionError):
        return {}
    return document if isinstance(document, dict) else {}
