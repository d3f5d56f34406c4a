"""Exit codes of all commands, and which of them each verdict ends with.

Source: spec/07-rules.md#verdicts.
"""

from __future__ import annotations

__all__ = [
    "EXIT_FAILED", "EXIT_INTERRUPTED", "EXIT_INVALID", "EXIT_OF_VERDICT", "EXIT_PARTIAL", "EXIT_SUCCESS",
    "EXIT_TERMINATED", "EXIT_USAGE",
]  # fmt: skip

EXIT_SUCCESS = 0

EXIT_INVALID = 1
"""A dataset does not conform, or a pilot has a problem."""

EXIT_USAGE = 2
"""Wrong usage, a path that cannot be used among it; there is no verdict."""

EXIT_PARTIAL = 3
"""No rule failed, and not every rule could be judged."""

EXIT_FAILED = 4
"""The tool or the machine failed."""

EXIT_INTERRUPTED = 130
"""Interrupted by the keyboard, 128 and the number of the signal; there is no verdict."""

EXIT_TERMINATED = 143
"""Asked to terminate, 128 and the number of the signal."""

EXIT_OF_VERDICT = {
    "valid": EXIT_SUCCESS,
    "valid-with-waivers": EXIT_SUCCESS,
    "invalid": EXIT_INVALID,
    "partial": EXIT_PARTIAL,
    "error": EXIT_FAILED,
}
