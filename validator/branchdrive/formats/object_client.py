"""A client of an object store by obstore: how it is made, how long it tries, and what its errors mean.

Credentials and endpoints come from the environment as obstore reads it; nothing of them is kept, pickled or printed,
and nothing in a dataset can name another place.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import lru_cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, cast

from branchdrive.errors import PlatformError, UsageError

if TYPE_CHECKING:
    from obstore.store import ObjectStore

__all__ = [
    "BRIEF_RETRIES", "BRIEF_TIMEOUTS", "RETRIES", "TIMEOUTS", "check_process", "check_url", "connect",
    "endpoints", "is_web", "store_faults",
]  # fmt: skip

RETRIES: dict[str, Any] = {
    "max_retries": 6,
    "retry_timeout": timedelta(seconds=90),
    "backoff": {"init_backoff": timedelta(milliseconds=100), "max_backoff": timedelta(seconds=5), "base": 2},
}
"""How often and how long a request is tried."""

TIMEOUTS: dict[str, Any] = {
    "connect_timeout": timedelta(seconds=10),
    "read_timeout": timedelta(seconds=30),
    "timeout": timedelta(minutes=10),
}
"""How long a server may be silent, and a request may take."""

BRIEF_RETRIES: dict[str, Any] = {**RETRIES, "max_retries": 3, "retry_timeout": timedelta(seconds=10)}
"""The same for what can be done without."""

BRIEF_TIMEOUTS: dict[str, Any] = {
    "connect_timeout": timedelta(seconds=3),
    "read_timeout": timedelta(seconds=5),
    "timeout": timedelta(minutes=1),
}
"""The same for what can be done without."""

_SCHEMES = ("s3", "gs", "az", "https")
_LOOPBACK = re.compile(r"http://(127\.0\.0\.1|localhost)(:\d+)?/")
_SECRETS = re.compile(r"[@?#\s]")
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT", "AZURE_STORAGE_ENDPOINT", "GOOGLE_BASE_URL")
_STATUS = re.compile(r"status code: (\d{3})")

_user: int | None = None
"""The process that has used obstore, of this one and those that it was forked from."""


def is_web(url: str) -> bool:
    """Whether a URL is of a web server, which lists nothing and takes nothing."""
    return url.startswith(("https://", "http://"))


def endpoints() -> tuple[str | None, ...]:
    """Servers that the environment names for buckets."""
    return tuple(map(os.environ.get, _ENDPOINTS))


def check_url(url: str) -> None:
    """Make sure of a URL before anything is asked.

    Raises:
        UsageError: It is of no kind that is read, or holds credentials or options; it is not shown then.
    """
    scheme, _, rest = url.partition("://")
    is_known = scheme in _SCHEMES or _LOOPBACK.match(url)
    if not is_known or not rest.partition("/")[0] or _SECRETS.search(rest):
        schemes = ", ".join(f"{name}://" for name in (*_SCHEMES, "hf"))
        raise UsageError(
            f"{scheme}://...: is no URL of a dataset: one begins with {schemes}, names a bucket or host and what is in "
            "it, and holds no credentials or options, which come from the environment"
        )


def check_process() -> None:
    """Make sure that this process may use obstore, and note that it does.

    Raises:
        PlatformError: obstore is not installed, or this process was forked from one that has used it: its threads are
            not in this one, which would wait for them for ever.
    """
    global _user
    if find_spec("obstore") is None:
        raise PlatformError("buckets need the package 'obstore', which the extra `cloud` brings")
    if _user not in (None, os.getpid()):
        raise PlatformError(
            "this process was forked from one that has read a bucket, and cannot read one; start new workers, as with "
            '`DataLoader(..., multiprocessing_context="spawn")`'
        )
    _user = os.getpid()


@lru_cache(maxsize=8)
def connect(url: str, *, is_brief: bool = False, token: str | None = None) -> ObjectStore:
    """A client of the store at a URL; errors are obstore's.

    A process has one for each URL, whatever the number of its tasks: each finds its credentials and connects again.

    Args:
        url: The URL.
        is_brief: Whether the store is given up soon.
        token: Shown to a web server; credentials of buckets are those of the environment.
    """
    from obstore.store import HTTPStore, from_url

    is_plain = any(place.startswith("http://") for place in (url, *endpoints()) if place)
    options: dict[str, Any] = {
        "client_options": {**(BRIEF_TIMEOUTS if is_brief else TIMEOUTS), **({"allow_http": True} if is_plain else {})},
        "retry_config": BRIEF_RETRIES if is_brief else RETRIES,
    }
    if token is not None:
        options["client_options"]["default_headers"] = {"authorization": f"Bearer {token}"}
    if url.startswith("s3://"):
        # What is written is checked where it arrives; some stores know no request that removes many objects.
        options["config"] = {"checksum_algorithm": "SHA256", "disable_bulk_delete": True}
    make: Any = HTTPStore.from_url if is_web(url) else from_url
    return cast("ObjectStore", make(url, **options))


@contextmanager
def store_faults(
    place: str, *, is_listing: bool = False, credentials: str = "the credentials in the environment"
) -> Iterator[None]:
    """Tell what a store does wrong from what is wrong with a dataset; texts of obstore, maybe with secrets, end here.

    Objects that are there, gone, changed or of a name that no path has, are left to the caller as obstore's errors.

    Args:
        place: What is asked for, as messages name it.
        is_listing: Whether it is the bucket itself.
        credentials: What decides about access.

    Raises:
        PlatformError: The store refuses, throttles, fails or is silent, after all retries.
        UsageError: There is no such bucket.
    """
    from obstore.exceptions import (
        AlreadyExistsError,
        BaseError,
        InvalidPathError,
        NotFoundError,
        PermissionDeniedError,
        PreconditionError,
        UnauthenticatedError,
    )

    try:
        yield
    except (AlreadyExistsError, InvalidPathError, NotFoundError, PreconditionError, FileNotFoundError):
        raise
    except (BaseError, OSError) as error:
        found = _STATUS.search(str(error))
        status = found[1] if found else ""
        if status in ("401", "403") or isinstance(error, PermissionDeniedError | UnauthenticatedError):
            raise PlatformError(
                f"{place}: the store refuses access; look at {credentials} and at what they allow"
            ) from None
        if status == "404" and is_listing:
            raise UsageError(f"{place}: there is no such bucket") from None
        raise PlatformError(f"{place}: {_cause(status, str(error))}; run the same command again later") from None


def _cause(status: str, text: str) -> str:
    """What an error of obstore says, without what it quotes of requests and answers."""
    if status:
        return f"the store answered with status {status}, also when it was asked again"
    low = text.lower()
    if "timed out" in low or "timedout" in low:
        return "the store did not answer in time"
    if "error sending request" in low or "connect" in low:
        return "the store cannot be reached"
    if "range" in low:
        return "the store cannot serve a part of an object"
    if "credential" in low or "token" in low:
        return "no credentials were found in the environment"
    return "the store could not be read"
