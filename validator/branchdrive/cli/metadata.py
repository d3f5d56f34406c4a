"""`branchdrive metadata`: a dataset in the words of those who find, load and archive datasets."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from branchdrive.cli.links import add_link_arguments
from branchdrive.contract.companion import CODEMETA_FILE, CROISSANT_FILE, ZENODO_FILE
from branchdrive.errors import DatasetError

if TYPE_CHECKING:
    from branchdrive.formats.folder import Folder

SUMMARY = "describe a dataset as Croissant, for Zenodo, or as CodeMeta"
ORDER = 125

FORMATS = {"croissant": CROISSANT_FILE, "zenodo": ZENODO_FILE, "codemeta": CODEMETA_FILE}
"""Formats, and the file beside the dataset that each is looked for in."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("dataset", metavar="DATASET", type=Path, help="a finished dataset or release")
    parser.add_argument(
        "--format", choices=[*FORMATS], default="croissant", help="what to print (default: croissant, 1.1 with RAI)"
    )
    parser.add_argument(
        "--write", action="store_true", help=f"write it beside the dataset instead: {', '.join(FORMATS.values())}"
    )
    add_link_arguments(parser)


def run(args: argparse.Namespace, stdout: TextIO, stderr: TextIO) -> int:
    """Print the document, or write it beside the dataset.

    Raises:
        DatasetError: The descriptor or the manifest cannot be read.
    """
    from branchdrive.contract.text import printable
    from branchdrive.formats.folder import Folder

    dataset = Folder.at(args.dataset, follow_links=args.follow_links, allow=args.allow)
    content = document(dataset, args.format)
    if args.write:
        dataset.replace(FORMATS[args.format], content)
        stdout.write(f"{printable(str(args.dataset / FORMATS[args.format]))}: {len(content):,} bytes\n")
    else:
        stdout.write(content.decode())
    return 0


def document(dataset: Folder, form: str) -> bytes:
    """A dataset's document in one of the `FORMATS`: equal bytes for equal descriptors and files.

    Raises:
        DatasetError: The descriptor or the manifest cannot be read.
    """
    from branchdrive.card.croissant import croissant
    from branchdrive.card.deposit import codemeta, zenodo
    from branchdrive.contract.document import dump_json
    from branchdrive.formats.descriptor_file import read_descriptor
    from branchdrive.formats.manifest import read_manifest

    descriptor = read_descriptor(dataset)
    if form == "croissant":
        manifest, mismatches = read_manifest(dataset)
        if mismatches:
            raise DatasetError(f"{dataset}: its manifest is damaged; run `branchdrive-validate`")
        found: dict[str, Any] = croissant(descriptor, manifest.files)
    else:
        found = {"zenodo": zenodo, "codemeta": codemeta}[form](descriptor)
    return dump_json(found)
