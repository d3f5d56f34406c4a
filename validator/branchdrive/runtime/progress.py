"""Progress without a listener."""

from __future__ import annotations

__all__ = ["unwatched"]


def unwatched(*_: object, **__: object) -> None:
    """Takes any progress and shows none."""
