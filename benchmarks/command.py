"""Commands of the project as they are measured: run, and their figures as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.memory import Measured, run_measured
from branchdrive.runtime.process import python_command

__all__ = ["memory", "minutes", "run_branchdrive", "run_module", "size"]


def run_module(module: str, *arguments: str) -> Measured:
    """Run a module of this installation in a process of its own."""
    return run_measured(python_command("-m", module, *arguments))


def run_branchdrive(*arguments: str) -> Measured:
    """Run a `branchdrive` command, as a user would."""
    return run_module("branchdrive.cli", *arguments)


def minutes(wall_s: float) -> str:
    """A time in words."""
    return f"{wall_s / 60:.1f} min" if wall_s >= 60 else f"{wall_s:.1f} s"


def memory(main_bytes: int, worker_bytes: int) -> str:
    """Peak memory in words."""
    main = f"{main_bytes / 2**20:,.0f} MiB"
    return f"{main}, its largest worker {worker_bytes / 2**20:,.0f} MiB" if worker_bytes else main


def size(facts: Mapping[str, Any]) -> str:
    """Size of a dataset in words, from what a report says about it."""
    num_mib = facts["num_bytes"] / 2**20
    return f"{facts['num_groups']:,} groups, {facts['num_rollouts']:,} rollouts, {num_mib:,.0f} MiB"
