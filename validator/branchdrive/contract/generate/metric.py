"""Lists of metrics in the schemas of the benchmark, from `metrics.json`."""

from __future__ import annotations

import copy
import re
from typing import Any

from branchdrive.contract.metric import metric_names
from branchdrive.contract.resources import load_resource

__all__ = ["metric_schemas", "protocol_text"]

_LIST = re.compile(r'("metrics": \[).*?(\n  \])', re.DOTALL)


def metric_schemas() -> dict[str, dict[str, Any]]:
    """Schemas by file name, with the names of all metrics and of those that tests compare models in."""
    protocol, results = (copy.deepcopy(load_resource(f"{name}.schema.json")) for name in ("protocol", "results"))
    targets = protocol["properties"]["targets"]["const"]
    names = metric_names(targets)
    protocol["properties"]["metrics"]["const"] = names
    kinds = {kind["properties"]["kind"]["const"]: kind for kind in protocol["properties"]["families"]["items"]["oneOf"]}
    member = kinds["prediction"]["properties"]["members"]["items"]
    member["properties"]["metric"]["enum"] = metric_names(targets, paired_only=True)
    results["$defs"]["estimate"]["properties"]["metric"]["enum"] = names
    return {"protocol.schema.json": protocol, "results.schema.json": results}


def protocol_text(text: str) -> str:
    """Text of `benchmark-protocol.json` with its metrics."""
    names = metric_names(load_resource("benchmark-protocol.json")["targets"])
    listed = ",".join(f'\n    "{name}"' for name in names)
    return _LIST.sub(rf"\g<1>{listed}\g<2>", text)
