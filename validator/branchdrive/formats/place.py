"""What a user writes for the place of a dataset: a folder, a bucket's URL, an archive."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from branchdrive.formats.archive import ARCHIVE_NAME, Archive
from branchdrive.formats.folder import Folder
from branchdrive.formats.store import Store

if TYPE_CHECKING:
    from obstore.store import ObjectStore

__all__ = ["Place", "open_store"]

Place = str | Path | Store
"""A folder's path, a URL, the path or URL of an archive, or a place that is open."""


def open_store(place: Place | ObjectStore, *, follow_links: bool = False, allow: Iterable[str | Path] = ()) -> Store:
    """Open a place of a dataset, for whatever reads one; what is listed is then read in that version.

    Args:
        place: A folder, whether or not it is there; ``s3://BUCKET/PREFIX``, ``gs://`` or ``az://``, which need the
            extra `cloud`; a ``https://`` folder, of which the files are seen that its manifest names;
            ``hf://ORG/NAME@REVISION`` on the Hugging Face Hub, with the extra `hub`; a ``.zip`` that
            `branchdrive pack` wrote, in any of these; a store of obstore at the dataset's prefix, with options and
            credentials of your own.
        follow_links: Whether links are followed, in a folder: those that stay in it, and those into `allow`.
        allow: Folders that links may lead into.

    Raises:
        UsageError: Folders are allowed although links are not followed, one is no folder, or a URL is of no kind that
            can be read, or leads nowhere.
        DatasetError: The archive is none that may be read.
        PlatformError: A library is missing, or the store cannot be reached or refuses.
    """
    if isinstance(place, Store):
        return place
    if not isinstance(place, str | Path):
        from branchdrive.formats.bucket import Bucket

        return Bucket.of(place)
    text = str(place)
    if "://" in text:
        return _at_url(text)
    folder = Folder.at(place, follow_links=follow_links, allow=allow)
    if text.endswith(ARCHIVE_NAME) and folder.root.is_file():
        path = folder.root.resolve() if folder.root.is_symlink() else folder.root  # a place that is named may be a link
        return Archive.open_file(replace(folder, root=path.parent), path.name)
    return folder


def _at_url(url: str) -> Store:
    from branchdrive.formats.bucket import Bucket
    from branchdrive.formats.hub import HubRepository

    kind = HubRepository if url.startswith("hf://") else Bucket
    if not url.endswith(ARCHIVE_NAME):
        return kind.open_url(url)
    home, _, name = url.rpartition("/")
    return Archive.open_file(kind.of_object(home, name), name)
