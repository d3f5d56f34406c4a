"""A dataset below a prefix of an object store: S3 and what speaks it, Google, Azure, memory, the web.

A web server lists nothing: there, a dataset is what its manifest names.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from branchdrive.contract.companion import IGNORE_FILE
from branchdrive.contract.layout import DESCRIPTOR_FILE, MANIFEST_FILE
from branchdrive.contract.text import quote
from branchdrive.errors import DatasetError, PlatformError, UsageError
from branchdrive.formats.manifest import read_manifest
from branchdrive.formats.object_client import check_process, check_url, connect, endpoints, is_web, store_faults
from branchdrive.formats.pinned import Pinned, PinnedStore, most_files
from branchdrive.formats.ranged_file import RangedFile

if TYPE_CHECKING:
    from obstore.store import ObjectStore

__all__ = ["Bucket", "Version"]

_HEADS_AT_ONCE = 8

PART_BYTES = 16 << 20
"""Size of the parts of a large object: 10,000 of them, the most that S3 takes, hold more than a file may have."""


@dataclass(frozen=True)
class Version(Pinned):
    """One version of an object.

    Attributes:
        e_tag: What changes with the object; it is compared, and never taken for a digest.
        modified: When it was written.
    """

    e_tag: str | None = None
    modified: datetime | None = None

    @property
    def condition(self) -> dict[str, Any]:
        """Options of a request that only this version fulfils; a weak tag does not tell versions apart."""
        if self.e_tag is not None and not self.e_tag.startswith("W/"):
            return {"if_match": self.e_tag}
        return {} if self.modified is None else {"if_unmodified_since": self.modified}

    def is_of(self, meta: Mapping[str, Any]) -> bool:
        """Whether an answer is of this version, as far as it tells: a store may ignore conditions.

        Times are compared by seconds: listings have finer ones than answers.
        """
        if meta["size"] != self.size:
            return False
        if "if_match" in self.condition:
            return meta["e_tag"] in (None, self.e_tag)
        return self.modified is None or abs(meta["last_modified"] - self.modified) < timedelta(seconds=1)


@dataclass(frozen=True)
class Bucket(PinnedStore):
    """The objects below a prefix, listed when it was opened.

    Attributes:
        url: Of the prefix, without a slash at the end.
        client: An obstore store at the prefix, whose options then are its owner's; by default one is made from the
            URL and the environment where it is used.
        listing_error: Why the keys could not be listed to the end.
        is_brief: Whether the store is given up soon, for who can do without what it holds.
    """

    url: str
    versions: Mapping[str, Version] = field(compare=False, repr=False)
    client: ObjectStore | None = field(default=None, compare=False, repr=False)
    listing_error: str = ""
    is_brief: bool = False

    @classmethod
    def open_url(cls, url: str) -> Bucket:
        """The bucket or prefix at a URL, listed.

        Raises:
            UsageError: It is no such URL, there is no such bucket, or it holds more than a dataset can.
            PlatformError: obstore is not installed, or the store cannot be reached or refuses.
        """
        return cls._unlisted(url).listed()

    @classmethod
    def for_writing(cls, url: str) -> Bucket:
        """The bucket or prefix at a URL, listed; errors as `open_url`, also where nothing can be written."""
        if is_web(url):
            raise UsageError(f"{url!r} is a web server, which takes no files; name a bucket")
        if url.startswith("hf://"):
            raise UsageError("the Hub takes files from `hf upload`; name a folder or a bucket")
        found = cls.open_url(url)
        if found.unlisted:
            raise UsageError(f"{found}: {found.unlisted}; name another prefix")
        return found

    @classmethod
    def of_object(cls, url: str, name: str) -> Bucket:
        """The one object `name` below the prefix at a URL; errors as `open_url`."""
        bucket = cls._unlisted(url)
        version = bucket.head(name)
        if version is None:
            raise UsageError(f"{bucket.place(name)}: there is no such object")
        return replace(bucket, versions={name: version})

    @classmethod
    def _unlisted(cls, url: str) -> Bucket:
        check_url(url)
        return cls(url.rstrip("/"), MappingProxyType({}))

    @classmethod
    def of(cls, client: ObjectStore, name: str | None = None) -> Bucket:
        """The dataset in an obstore store, which is at its prefix; errors as `open_url`."""
        return cls(name or f"{type(client).__name__}", MappingProxyType({}), client).listed()

    @property
    def pinned(self) -> Mapping[str, Pinned]:
        """Versions of the objects by path."""
        return self.versions

    @property
    def unlisted(self) -> str:
        """Why the keys could not be listed to the end."""
        return self.listing_error

    def place(self, path: str) -> str:
        """URL of what is at a path."""
        return f"{self.url}/{path}" if path else self.url

    @property
    def has_versions(self) -> bool:
        """Yes, where the URL and the environment alone say which bucket it is."""
        return self.client is None and self.lists_all

    def lasting_version(self, path: str) -> str | None:
        """URL, path, size, ETag and time of the listed object; ``None`` where its ETag is none that can be trusted."""
        found = self.versions.get(path)
        if not self.has_versions or found is None or "if_match" not in found.condition or found.modified is None:
            return None
        written = found.modified.isoformat()
        return json.dumps([*endpoints(), self.url, path, found.size, found.e_tag, written])

    def only(self, paths: Collection[str]) -> Bucket:
        """The bucket with the versions of these objects alone."""
        return replace(self, versions={path: self.versions[path] for path in paths if path in self.versions})

    def listed(self) -> Bucket:
        """This place as it is now."""
        if not self.lists_all:
            return replace(self, versions=self._named_by_manifest())
        import obstore
        from obstore.exceptions import InvalidPathError

        found: dict[str, Version] = {}
        try:
            with self.faults(""):
                for batch in obstore.list(self.connection, chunk_size=1000):
                    for meta in batch:
                        if meta["path"]:
                            found[meta["path"]] = _version(meta)
                    if len(found) > most_files():
                        raise UsageError(
                            f"{self} holds more than {most_files()} objects; name the prefix of one dataset"
                        )
        except InvalidPathError as error:
            key = re.search(r'[Pp]ath:? "(.*?)"[ :]', str(error))
            name = quote(key[1]) if key else "an object"
            why = f"the key {name} is none that a folder could hold, and no key was read"
            return replace(self, versions=self._documents(), listing_error=why)
        return replace(self, versions=found, listing_error="")

    @property
    def lists_all(self) -> bool:
        """Whether the server lists objects; one of the web does not."""
        return not is_web(self.url)

    def _documents(self) -> dict[str, Version]:
        """Versions of descriptor and manifest, where nothing can be listed."""
        return self._versions((DESCRIPTOR_FILE, MANIFEST_FILE, IGNORE_FILE))

    def _named_by_manifest(self) -> dict[str, Version]:
        """Versions of the files that the manifest names, and of what lies beside them."""
        documents = self._documents()
        if MANIFEST_FILE not in documents:
            return documents
        manifest, _ = read_manifest(replace(self, versions=documents))
        return documents | self._versions([path for path in manifest.files if path not in documents])

    def _versions(self, paths: Sequence[str]) -> dict[str, Version]:
        """Versions of those objects that are there."""
        with ThreadPoolExecutor(_HEADS_AT_ONCE) as pool:
            found = zip(paths, pool.map(self.head, paths), strict=True)
            return {path: version for path, version in found if version is not None}

    def head(self, path: str) -> Version | None:
        """The version of an object that is there now; ``None`` where there is none."""
        import obstore
        from obstore.exceptions import NotFoundError

        try:
            with self.faults(path):
                return _version(obstore.head(self.connection, path))
        except (NotFoundError, FileNotFoundError):
            return None

    def _opened(self, path: str, found: Pinned) -> BinaryIO:
        version = cast("Version", found)
        return cast("BinaryIO", RangedFile(found.size, lambda start, stop: self._fetch(path, version, start, stop)))

    def _fetch(self, path: str, version: Version, start: int, stop: int) -> bytes:
        """Bytes of one version of an object.

        Raises:
            DatasetError: It is another now, or gone.
            PlatformError: The store does not answer as it should.
        """
        import obstore
        from obstore.exceptions import NotFoundError, PreconditionError

        options = version.condition
        if (start, stop) != (0, version.size):
            options["range"] = (start, stop)
        try:
            with self.faults(path):
                answer = obstore.get(self.connection, path, options=cast("Any", options))
                is_same = version.is_of(answer.meta)
                content = bytes(answer.bytes()) if is_same else b""
        except (NotFoundError, FileNotFoundError):
            raise DatasetError(f"{self}: {path!r} was removed after it was listed; read it again") from None
        except PreconditionError:
            is_same = False
        if not is_same:
            raise DatasetError(f"{self}: {path!r} was changed after it was listed; read it again") from None
        if len(content) != stop - start:
            raise PlatformError(f"{self.place(path)}: {len(content)} bytes came where {stop - start} were asked for")
        return content

    def get_now(self, path: str, max_bytes: int) -> tuple[Version, bytes] | None:
        """An object as it is at this moment, by one request; ``None`` where there is none.

        Args:
            path: The object.
            max_bytes: Of a larger one, no byte is read.

        Raises:
            PlatformError: The store refuses or fails.
        """
        import obstore
        from obstore.exceptions import NotFoundError

        try:
            with self.faults(path):
                answer = obstore.get(self.connection, path)
                content = b"" if answer.meta["size"] > max_bytes else bytes(answer.bytes())
                return _version(answer.meta), content
        except (NotFoundError, FileNotFoundError):
            return None

    def put_new(self, path: str, content: bytes) -> bool:
        """Write an object where there is none; returns whether there was none.

        A request whose answer was lost is sent again, and then finds what it has written itself.

        Raises:
            PlatformError: The store refuses or fails, or there is no such bucket.
        """
        import obstore
        from obstore.exceptions import AlreadyExistsError, NotFoundError, PreconditionError

        try:
            with self.faults(path):
                obstore.put(self.connection, path, content, mode="create", use_multipart=False)
        except (AlreadyExistsError, PreconditionError, FileExistsError):
            return False
        except (NotFoundError, FileNotFoundError):
            raise PlatformError(f"{self.place(path)}: there is no such bucket") from None
        return True

    def put_over(self, path: str, content: bytes, was: Version) -> bool:
        """Write an object in the place of one version of it; returns whether it was that version until then.

        A request whose answer was lost is sent again, and then finds another version, which it has written itself.

        Raises:
            PlatformError: The store refuses or fails.
        """
        import obstore
        from obstore.exceptions import NotFoundError, PreconditionError

        try:
            with self.faults(path):
                obstore.put(self.connection, path, content, mode={"e_tag": was.e_tag}, use_multipart=False)
        except (NotFoundError, PreconditionError, FileNotFoundError):
            return False
        return True

    def put_parts(self, path: str, pieces: Iterable[bytes], is_whole: Callable[[], bool]) -> bool:
        """Write an object of any size in parts, over what is there; it appears when all of them have come.

        Args:
            path: The object.
            pieces: Its bytes.
            is_whole: Asked in the end whether they are what they should be; the object does not appear if not.

        Returns:
            Whether it appeared. Parts of one that did not are left to the rules of the bucket.

        Raises:
            PlatformError: The store refuses or fails.
        """
        import obstore

        with self.faults(path):
            writer = obstore.open_writer(self.connection, path, buffer_size=PART_BYTES, max_concurrency=4)
            for piece in pieces:
                writer.write(piece)
            if not is_whole():
                return False
            writer.close()
        return True

    def remove(self, path: str) -> None:
        """Remove an object; nothing happens if there is none.

        Raises:
            PlatformError: The store refuses or fails.
        """
        import obstore
        from obstore.exceptions import NotFoundError

        with suppress(NotFoundError, FileNotFoundError), self.faults(path):
            obstore.delete(self.connection, path)

    @property
    def connection(self) -> ObjectStore:
        """A client of the store, made in this process; errors as `check_process`."""
        check_process()
        if self.client is not None:
            return self.client
        with self.faults(""):
            return connect(self.url, is_brief=self.is_brief)

    def faults(self, path: str) -> AbstractContextManager[None]:
        """Tell what a store does wrong at a path, or in listing, from what is wrong with a dataset."""
        return store_faults(self.place(path), is_listing=not path)


def _version(meta: Mapping[str, Any]) -> Version:
    return Version(meta["size"], e_tag=meta["e_tag"], modified=meta["last_modified"])
