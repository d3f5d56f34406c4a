"""Errors that broken calls raise.

Wrong *data* never raises: it becomes findings. These classes are for wrong use of the library,
for contracts that a writer is about to break, and for files that cannot be read at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = [
    "BranchDriveError",
    "ContractError",
    "DatasetError",
    "DecodeError",
    "LimitError",
    "PlatformError",
    "ToolError",
    "UnknownNameError",
    "UsageError",
]


class BranchDriveError(Exception):
    """Base of every error that this distribution raises on purpose."""


class UsageError(BranchDriveError):
    """A call or a command line that cannot be carried out as given."""


class UnknownNameError(UsageError, KeyError):
    """A name that a mapping of the library does not have; the message names those that it has."""

    __str__ = Exception.__str__  # that of `KeyError` puts the message in quotes


class DatasetError(BranchDriveError):
    """A dataset that a reader or writer cannot open."""


class ToolError(BranchDriveError):
    """A command that could not finish for no reason in its input: exit code 4, never a finding about data."""


class PlatformError(ToolError):
    """What the machine lacks: a library that is too old or missing, a system call, space on a disk."""


class DecodeError(BranchDriveError):
    """Bytes that do not decode to a table inside the spec limits, or to an image."""


class LimitError(DecodeError):
    """Bytes that would decode to more than a spec limit allows."""


class ContractError(BranchDriveError):
    """Data that a writer refuses because it breaks the format; nothing was written.

    Attributes:
        findings: What is wrong, one finding per violated rule and place.
    """

    def __init__(self, message: str, findings: Sequence[Any] = ()) -> None:
        super().__init__(message)
        self.findings = tuple(findings)
