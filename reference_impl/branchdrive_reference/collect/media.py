"""Media of a collection: rendered once all of its groups are there, with the same bytes as by `branchdrive render`."""

from __future__ import annotations

from pathlib import Path

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.errors import UsageError
from branchdrive.formats.descriptor_file import differing_values, read_descriptor
from branchdrive.formats.folder import Folder
from branchdrive.raw.reader import open_dataset
from branchdrive.release.publish import is_rendering
from branchdrive_reference.rendering.plan import MediaPlan
from branchdrive_reference.rendering.rig import MEDIA_STREAMS, cameras_of

__all__ = ["default_media", "is_being_rendered"]


def default_media() -> MediaPlan:
    """What is rendered of a collection: every stream, small, around the branch."""
    return MediaPlan(cameras_of(MEDIA_STREAMS))


def is_being_rendered(root: Path, descriptor: Descriptor, num_groups: int) -> bool:
    """Whether a collection at `root` is finished, and has its media or some of them.

    Args:
        root: Folder of the dataset, which need not exist.
        descriptor: What the collection is without media.
        num_groups: Groups of the whole collection.

    Raises:
        UsageError: It is another collection, or has media of another number of groups.
        DatasetError: Its descriptor or its rollouts cannot be read.
    """
    if not (root / DESCRIPTOR_FILE).exists():
        return False
    found = read_descriptor(Folder(root))
    if not found.cameras and not is_rendering(root):
        return False
    fields = differing_values(found.without_media.model_dump(mode="json"), descriptor.model_dump(mode="json"))
    if fields:
        raise UsageError(
            f"{root}: holds a dataset with another descriptor ({'; '.join(fields)}); choose another folder"
        )
    num_found = len(open_dataset(root).groups)
    if num_found != num_groups:
        raise UsageError(
            f"{root}: is finished with {num_found} groups and has media, so it keeps its version; choose another "
            f"folder for {num_groups}"
        )
    return True
