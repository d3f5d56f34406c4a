"""A dataset in a repository of the Hugging Face Hub, at one commit.

`huggingface_hub` resolves a revision, lists its files with their sizes and finds the user's token; files are read by
ranges from where the Hub serves those of that commit, as from any web server. The token goes to the Hub alone, never to
where it redirects to, and is neither kept, pickled nor printed.

Source: spec/03-layout.md#archives.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from types import MappingProxyType
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

from branchdrive.errors import PlatformError, UsageError
from branchdrive.formats.bucket import Bucket, Version
from branchdrive.formats.object_client import check_process, connect, store_faults
from branchdrive.formats.pinned import most_files

if TYPE_CHECKING:
    from obstore.store import ObjectStore

__all__ = ["HubRepository"]

_KIND = "dataset"
_URL = re.compile(
    r"hf://(?:datasets/)?(?!(?:models|spaces|kernels|buckets)/)(?P<name>[\w.-]+/[\w.-]+)"
    r"(?:@(?P<revision>refs/(?:pr/\d+|convert/[\w.-]+)|[^/@?#\s]+))?(?:/(?P<path>[^?#\s]*))?"
)
_COMMIT = re.compile(r"[0-9a-f]{40,64}")
_TOKEN = "the token that `hf auth login` keeps or HF_TOKEN holds"  # noqa: S105 - says where one is
_AGAIN = "run the same command again later"


@dataclass(frozen=True)
class HubRepository(Bucket):
    """The files below a folder of a repository of kind `dataset`, listed when it was opened.

    Attributes:
        url: ``hf://ORG/NAME@COMMIT``, and the folder; a branch or a tag that was asked for is this commit from then on.
        files_url: Where the Hub serves the files.
    """

    files_url: str = ""

    @classmethod
    def _unlisted(cls, url: str) -> HubRepository:
        found = _URL.fullmatch(url)
        if found is None:
            raise UsageError(
                "hf://...: names no dataset on the Hub: write hf://ORG/NAME, hf://ORG/NAME@REVISION or "
                "hf://ORG/NAME@REVISION/FOLDER, the name of a repository of kind `dataset`"
            )
        if find_spec("huggingface_hub") is None:
            raise PlatformError("the Hub needs the package 'huggingface_hub', which the extra `hub` brings")
        check_process()
        from huggingface_hub import HfApi

        name, revision, folder = found["name"], unquote(found["revision"] or "main"), (found["path"] or "").strip("/")
        api = HfApi()
        with _hub_faults(f"hf://{name}@{revision}"):
            commit = api.dataset_info(name, revision=revision, expand=["sha"]).sha or ""
            if not _COMMIT.fullmatch(commit):
                raise ValueError("an answer without a commit")
        below = f"/{folder}" if folder else ""
        files_url = f"{api.endpoint}/datasets/{name}/resolve/{commit}{quote(below)}"
        return cls(f"hf://{name}@{commit}{below}", MappingProxyType({}), files_url=files_url)

    def listed(self) -> HubRepository:
        """This place at its commit."""
        from huggingface_hub import HfApi
        from huggingface_hub.hf_api import RepoFile

        name, commit, folder = self._parts
        found: dict[str, Version] = {}
        with _hub_faults(self.url):
            tree = HfApi().list_repo_tree(name, folder or None, recursive=True, revision=commit, repo_type=_KIND)
            for one in tree:
                if isinstance(one, RepoFile):
                    found[one.path.removeprefix(f"{folder}/")] = Version(one.size)
                if len(found) > most_files():
                    raise UsageError(f"{self} holds more than {most_files()} files; name the folder of one dataset")
        return replace(self, versions=found)

    def head(self, path: str) -> Version | None:
        """The version of a file that is there; ``None`` where there is none."""
        from huggingface_hub import HfApi
        from huggingface_hub.hf_api import RepoFile

        name, commit, folder = self._parts
        whole = f"{folder}/{path}" if folder else path
        with _hub_faults(self.place(path)):
            found = HfApi().get_paths_info(name, [whole], revision=commit, repo_type=_KIND)
            return next((Version(one.size) for one in found if isinstance(one, RepoFile) and one.path == whole), None)

    @property
    def _parts(self) -> tuple[str, str, str]:
        """Name of the repository, commit, folder."""
        repository, _, rest = self.url.removeprefix("hf://").partition("@")
        commit, _, folder = rest.partition("/")
        return repository, commit, folder

    @property
    def connection(self) -> ObjectStore:
        """A client of where the files are, made in this process; errors as `check_process`."""
        from huggingface_hub import get_token

        check_process()
        with self.faults(""):
            return connect(self.files_url, token=get_token())

    def faults(self, path: str) -> AbstractContextManager[None]:
        """Tell what the Hub does wrong at a path from what is wrong with a dataset."""
        return store_faults(self.place(path), is_listing=not path, credentials=_TOKEN)


@contextmanager
def _hub_faults(place: str) -> Iterator[None]:
    """Tell what the Hub does wrong when it is asked what it holds; texts of libraries and servers end here.

    Raises:
        PlatformError: The Hub refuses, fails or cannot be reached, or its answer makes no sense.
        UsageError: There is no such repository, revision or folder.
    """
    from huggingface_hub.errors import (
        EntryNotFoundError,
        GatedRepoError,
        HfHubHTTPError,
        OfflineModeIsEnabled,
        RepositoryNotFoundError,
        RevisionNotFoundError,
    )

    try:
        yield
    except UsageError:
        raise
    except GatedRepoError:
        raise PlatformError(f"{place}: the Hub refuses access; accept its terms there, and look at {_TOKEN}") from None
    except (RevisionNotFoundError, EntryNotFoundError):
        raise UsageError(f"{place}: the repository has no such revision or folder") from None
    except RepositoryNotFoundError:
        raise UsageError(
            f"{place}: there is no such repository of kind `dataset`, or it is private; look at {_TOKEN}"
        ) from None
    except OfflineModeIsEnabled:
        raise PlatformError(f"{place}: HF_HUB_OFFLINE forbids to ask the Hub; name a folder, or unset it") from None
    except HfHubHTTPError as error:
        status = error.response.status_code
        if status in (401, 403):
            raise PlatformError(f"{place}: the Hub refuses access; look at {_TOKEN}") from None
        raise PlatformError(f"{place}: the Hub answered with status {status}; {_AGAIN}") from None
    except Exception as error:  # libraries of several versions, and answers that may be anything
        cause = type(error).__name__
        raise PlatformError(f"{place}: the Hub cannot be reached or understood ({cause}); {_AGAIN}") from None
