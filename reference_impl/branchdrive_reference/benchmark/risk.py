"""The learned risk of the guard, from out-of-fold predictions of training groups."""

from __future__ import annotations

from pydantic import ValidationError

from branchdrive.contract.document import dump_json
from branchdrive.derive.benchmark.data import BenchmarkData
from branchdrive.derive.benchmark.protocol import BenchmarkProtocol, protocol_digest
from branchdrive.derive.benchmark.ranking_result import utility_scale
from branchdrive.derive.guard.risk_fit import RiskFit
from branchdrive.errors import UsageError
from branchdrive_reference.benchmark.locking import stored_document
from branchdrive_reference.benchmark.training import fold_tasks, out_of_fold
from branchdrive_reference.benchmark.workspace import Workspace

__all__ = ["fit_guard", "waiting_risk"]

RISK = "benchmark/risk.json"
"""Where the risk waits until the ranking lock holds it; it is no file of the release."""


def fit_guard(workspace: Workspace, protocol: BenchmarkProtocol, data: BenchmarkData, *, device: str) -> RiskFit:
    """Fit the risk on predictions of the trained folds, and let it wait for the ranking lock.

    Raises:
        UsageError: The extra is not installed, or training holds no violation or nothing but violations.
        DatasetError: A fold cannot be read.
    """
    try:
        from branchdrive_reference.guard.fit import fit_risk
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the guard needs the package {error.name!r}: pip install 'branchdrive[guard]', or use `--no-guard`"
        ) from error
    release, guard = workspace.release, protocol.guard
    scalars = out_of_fold(release, workspace.folds, fold_tasks(release, protocol), device=device)
    try:
        found = fit_risk(
            scalars,
            data.part(protocol.partitions.fit).targets,
            nominal=data.nominal,
            scale=utility_scale(protocol, data),
            profiles=protocol.preferences,
            tolerance_m=guard.tolerance_m,
            alpha=guard.alpha,
        )
    except UsageError as error:
        raise UsageError(f"{release.root}: {error}; use `--no-guard` to go without a guard") from error
    record = {"protocol_digest": protocol_digest(protocol), "risk_fit": found.model_dump(mode="json")}
    workspace.keep(RISK, dump_json(record))
    return found


def waiting_risk(workspace: Workspace, protocol: BenchmarkProtocol) -> RiskFit | None:
    """The risk that waits for a ranking lock under this protocol; ``None`` if there is none."""
    record = stored_document(workspace, RISK)
    if not isinstance(record, dict) or record.get("protocol_digest") != protocol_digest(protocol):
        return None
    try:
        return RiskFit.model_validate(record.get("risk_fit"))
    except ValidationError:
        return None  # it is fitted anew
