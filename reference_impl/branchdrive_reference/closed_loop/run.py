"""A whole run: lock, record, drives, figures, tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import LOCK_FILE
from branchdrive.driving.feature import InputContract
from branchdrive.errors import UsageError
from branchdrive.formats.durable import make_dir, replace_file
from branchdrive.runtime.environment import extra
from branchdrive.runtime.file_lock import FileLock
from branchdrive.runtime.progress import unwatched
from branchdrive.writer.writer import DatasetWriter
from branchdrive_reference.benchmark.document import published_protocol
from branchdrive_reference.benchmark.release import Release, open_release
from branchdrive_reference.closed_loop.arm import Condition, arms_of
from branchdrive_reference.closed_loop.course import Schedule
from branchdrive_reference.closed_loop.execution import GroupDriver, drive_groups, read_groups
from branchdrive_reference.closed_loop.lock import drive_lock, keep_lock, record_access, warnings_of
from branchdrive_reference.closed_loop.plan import Plan, make_plan
from branchdrive_reference.closed_loop.recorder import DRIVES_DIR, Recorder, drives_descriptor
from branchdrive_reference.closed_loop.reference_field import ReferenceField
from branchdrive_reference.closed_loop.result import drive_results
from branchdrive_reference.closed_loop.selector import NOMINAL, Training, open_selectors
from branchdrive_reference.closed_loop.site import Field
from branchdrive_reference.closed_loop.table import render_drives
from branchdrive_reference.closed_loop.world_field import WorldField

__all__ = ["Found", "Request", "drive_release"]


@dataclass(frozen=True)
class Request:
    """What is to be driven.

    Attributes:
        release: Folder of the release that selectors are from.
        output: Folder of the run.
        selectors: Names, see `selector`; nominal is always among the driven ones.
        profile: What utility weighs.
        num_groups: Groups of the population.
        seed: Its seed.
        schedules: When selectors decide; each is driven.
        conditions: Noise; each is driven, exact drives first.
        world: ``MODULE:NAME`` of worlds of the SDK; the reference world by default.
        looks_ahead: Whether the bank is driven ahead at every decision.
        is_recorded: Whether what is driven is kept as a raw dataset.
        jobs: Worker processes.
    """

    release: Path
    output: Path
    selectors: tuple[str, ...]
    profile: str
    num_groups: int
    seed: int
    schedules: tuple[Schedule, ...]
    conditions: tuple[Condition, ...] = (Condition("exact"),)
    world: str | None = None
    looks_ahead: bool = False
    is_recorded: bool = False
    jobs: int = 1


@dataclass(frozen=True)
class Found:
    """What came of a run.

    Attributes:
        results: Document ``results.json``.
        tables: ``TABLES.md``.
    """

    results: dict[str, Any]
    tables: str


def drive_release(
    request: Request, *, field: Field | None = None, watch: Callable[[int, int], None] = unwatched
) -> Found:
    """Drive what is missing of a run, and write its figures and tables.

    Args:
        request: What is to be driven.
        field: Where; the world that the request names by default.
        watch: Called with the number of finished groups and of all, at the beginning and after every group.

    Raises:
        UsageError: The request does not fit the release, or a selector cannot decide.
        DatasetError: The release or what was driven cannot be read.
        PlatformError: An extra is not installed.
        KeyboardInterrupt: The user interrupted; whatever was finished is kept.
    """
    release = open_release(request.release)
    protocol = published_protocol(release)
    field = _field(request, release) if field is None else field
    _check(field, request, release)
    training = Training.of(release, protocol, request.profile)
    names = request.selectors if NOMINAL in request.selectors else (NOMINAL, *request.selectors)
    request.output.mkdir(parents=True, exist_ok=True)
    with _held(request.output):
        models = request.output.with_name(f"{request.output.name}.selectors")
        selectors, about = open_selectors(names, training, lambda model: _exported(release, protocol, model, models))
        arms = arms_of(list(selectors), request.schedules, request.conditions)
        plan = make_plan(field, request.seed, request.num_groups, field.routes_of(release, training.groups))
        declared = protocol.statistics
        statistics = {"seed": int(declared.seed), "resamples": int(declared.resamples), "flips": int(declared.flips)}
        simulator = f"{field.software.name} {field.software.version}"
        lock = drive_lock(
            release, plan, simulator, arms, list(about.values()), profile=request.profile,
            looks_ahead=request.looks_ahead, statistics=statistics,
        )  # fmt: skip
        keep_lock(request.output, lock)
        entries = record_access(release, lock)
        driver = GroupDriver(
            request.output, field, request.seed, training.bank, selectors, arms, release.layer.descriptor.unrecorded,
            request.looks_ahead,
        )  # fmt: skip
        if request.is_recorded:
            _drive_recorded(driver, plan, request, release.layer.descriptor, watch)
        else:
            drive_groups(driver, plan, jobs=request.jobs, watch=watch)
        clusters = dict(zip((place.group_id for place in plan.places), plan.clusters, strict=True))
        results = drive_results(
            read_groups(request.output, plan), clusters, arms, training, statistics=statistics,
            warnings=warnings_of(entries, lock),
        )  # fmt: skip
        found = Found(results, render_drives(results))
        replace_file(request.output / "results.json", dump_json(results))
        replace_file(request.output / "TABLES.md", found.tables.encode())
    return found


def _drive_recorded(
    driver: GroupDriver, plan: Plan, request: Request, release: Descriptor, watch: Callable[[int, int], None]
) -> None:
    """Drive what is missing, and keep all drives as a finished dataset."""
    root, field = request.output / DRIVES_DIR, driver.field
    descriptor = drives_descriptor(release, field, request.seed, request.conditions)
    places = {place.group_id: number for number, place in enumerate(plan.places)}
    maps = field.maps if "map" in descriptor.streams else None
    with DatasetWriter(root, descriptor, maps=maps) as writer:
        closed = None if writer.is_finished else writer.closed
        recording = replace(driver, recorder=Recorder(root, descriptor, places))
        drive_groups(recording, plan, closed=closed, jobs=request.jobs, between=writer.commit, watch=watch)
        writer.finalize()


@contextmanager
def _held(output: Path) -> Iterator[None]:
    """The folder of a run, held by this process alone."""
    lock = FileLock(output.with_name(f".{output.name}.lock"))
    if not lock.acquire(blocking=False):
        raise UsageError(f"--output: another command is driving in {str(output)!r}; wait for it")
    try:
        yield
    finally:
        lock.remove()


def _field(request: Request, release: Release) -> Field:
    if request.world is None:
        return ReferenceField.of(release.layer.descriptor)
    return WorldField.of(request.world, release)


def _check(field: Field, request: Request, release: Release) -> None:
    if not field.has_replay_noise and any(condition.replay > 0 for condition in request.conditions):
        raise UsageError("worlds of the collector SDK have no replay noise; leave out `--replay-noise`")
    if request.seed == release.layer.descriptor.collection.seed:
        raise UsageError(
            f"--seed: {request.seed} is the seed of the release, whose groups, those of `test` among them, would be "
            "driven; take another one"
        )
    if "evidence" not in release.layer.descriptor.tables:
        raise UsageError("a closed loop is judged by evidence of actors and collisions, which this dataset has not")


_SEEN = {InputContract.SENSOR.value: "sensor history", InputContract.OBJECTS.value: "sensor history and objects"}
"""What a model sees in a drive, by its contract."""


def _exported(release: Release, protocol: BenchmarkProtocol, model: str, folder: Path) -> tuple[Path, str]:
    """The ONNX export of a locked model, held against torch, in a file of its own: the lock names its digest.

    With it, what the model sees.
    """
    from branchdrive_reference.benchmark.prediction import locked_checkpoints

    with extra("models", "export", of="a selector `E-MODEL`"):
        from branchdrive_reference.benchmark.onnx_export import export_locked
    lock, declared = release.document(LOCK_FILE), protocol.model(model)
    checkpoints = [] if lock is None or declared is None else locked_checkpoints(release, lock, model)
    if declared is None or not checkpoints:
        raise UsageError(f"{release.root}: has no locked checkpoint of {model!r}; run `branchdrive benchmark` first")
    if declared.contract not in _SEEN:
        raise UsageError(f"{model!r} reads what drives do not tell; choose a model under {' or '.join(_SEEN)}")
    content, _ = export_locked(release, protocol, checkpoints)
    make_dir(folder)
    path = folder / f"{model}.onnx"
    replace_file(path, content)
    return path, _SEEN[declared.contract]
