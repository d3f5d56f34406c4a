"""The learned risk of the guard while it waits for the ranking lock, which then holds it."""

from __future__ import annotations

from pydantic import ValidationError

from branchdrive.benchmark.guard.risk import RiskFit
from branchdrive.benchmark.protocol import BenchmarkProtocol, protocol_digest
from branchdrive.contract.document import dump_json
from branchdrive_reference.benchmark.document import stored_document
from branchdrive_reference.benchmark.workspace import Workspace

__all__ = ["RISK", "keep_risk", "waiting_risk"]

RISK = "benchmark/risk.json"
"""Where the risk waits until the ranking lock holds it; it is no file of the release."""


def keep_risk(workspace: Workspace, protocol: BenchmarkProtocol, risk: RiskFit) -> None:
    """Let a risk that was fitted under this protocol wait."""
    record = {"protocol_digest": protocol_digest(protocol), "risk_fit": risk.model_dump(mode="json")}
    workspace.keep(RISK, dump_json(record))


def waiting_risk(workspace: Workspace, protocol: BenchmarkProtocol) -> RiskFit | None:
    """The risk that waits for a ranking lock under this protocol; ``None`` if there is none."""
    record = stored_document(workspace, RISK)
    if not isinstance(record, dict) or record.get("protocol_digest") != protocol_digest(protocol):
        return None
    try:
        return RiskFit.model_validate(record.get("risk_fit"))
    except ValidationError:
        return None  # it is fitted again
