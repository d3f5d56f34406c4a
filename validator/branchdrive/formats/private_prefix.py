"""A prefix of a bucket, in which values wait under names until a later run asks for them.

Each is an object of its own, which appears whole or not at all, and which the first of several writers makes. Who may
write there is for the bucket to say, and everyone who may write can put verdicts there; but no value is believed that
is damaged, cut off or another's. What is old is removed by rules of the bucket.
"""

from __future__ import annotations

from dataclasses import dataclass

from branchdrive.errors import UsageError
from branchdrive.formats.bucket import Bucket
from branchdrive.formats.entry import MAX_ENTRY_BYTES, DamagedError, sealed, unsealed
from branchdrive.formats.object_client import check_process, check_url, is_web

__all__ = ["PrivatePrefix"]


@dataclass(frozen=True)
class PrivatePrefix:
    """A prefix with values; it travels to workers, each of which has credentials from its environment.

    Attributes:
        bucket: The prefix, of which nothing is listed.
    """

    bucket: Bucket

    def __str__(self) -> str:
        return str(self.bucket)

    @classmethod
    def at(cls, url: str) -> PrivatePrefix:
        """The prefix at a URL; nothing is asked of it yet.

        Raises:
            UsageError: It is no such URL, or of the web, where nothing can be written.
            PlatformError: obstore is not installed.
        """
        check_url(url)
        if is_web(url):
            raise UsageError(f"{url!r} is a web server, which takes no files; name a folder or a bucket for the cache")
        check_process()
        return cls(Bucket(url.rstrip("/"), {}, is_brief=True))

    def get(self, name: str) -> bytes | None:
        """What was put under a name; ``None`` if nothing was.

        Raises:
            DamagedError: It is not what was put there.
            PlatformError: The store refuses or fails, or does not answer soon.
        """
        found = self.bucket.get_now(_key(name), MAX_ENTRY_BYTES)
        return None if found is None else unsealed(name, found[1])

    def put(self, name: str, value: bytes) -> None:
        """Keep a value, unless there is one already; what is damaged gives way to it.

        Raises:
            PlatformError: As `get`.
        """
        content, key = sealed(name, value), _key(name)
        if content is None or self.bucket.put_new(key, content):
            return
        found = self.bucket.get_now(key, MAX_ENTRY_BYTES)
        if found is None:  # removed in the meantime
            return
        try:
            unsealed(name, found[1])
        except DamagedError:
            self.bucket.put_over(key, content, found[0])


def _key(name: str) -> str:
    return f"{name}.entry"
