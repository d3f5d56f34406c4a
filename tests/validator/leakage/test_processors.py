"""An audit on other processors, and of inputs whose last bits are others."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.processors import Setting, runnable
from tests.repo.checkout import ROOT
from tests.sampling import sampled
from tests.validator.leakage import driven
from tests.validator.leakage.replays import changed, replay_inputs


def on_processor(setting: Setting, document: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", driven.__name__, str(document)]
    environment = setting.environment() | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{setting.name}: {done.stderr}"
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_an_audit_of_one_processor_follows_on_every_other(tmp_path: Path) -> None:
    document = tmp_path / "leakage.json"
    built, *found = [(setting.name, on_processor(setting, document)) for setting in runnable()]
    for name, other in (built, *found):
        assert other["mismatches"] == [], name
        assert other["exact"] == built[1]["exact"], name


@pytest.mark.parametrize("leak", sampled([1.0, 0.0], every=2))
def test_last_bits_of_inputs_turn_nothing_around(leak: float) -> None:
    rng = np.random.default_rng(0)

    def nudged(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.nextafter(values, rng.choice([-np.inf, np.inf], size=values.shape))

    clean = replay_inputs(60, seed=2)
    discrepancy = np.array(clean.discrepancy)
    discrepancy[:, 2] += leak
    inputs = changed(clean, discrepancy=discrepancy)
    other = changed(
        inputs,
        discrepancy=np.abs(nudged(discrepancy)),
        ego=nudged(clean.ego),
        controls=nudged(clean.controls),
    )
    document = driven.audited(inputs)
    assert document["gate"]["verdict"] == ("fail" if leak else "pass")
    document["inputs"]["digest"] = other.digest()  # of every bit, and of this test no matter
    assert driven.mismatches(document, other) == []
    again = driven.audited(other)
    assert again["gate"]["verdict"] == document["gate"]["verdict"]
    statuses = [[test["status"] for way in d["battery"]["ways"] for test in way["tests"]] for d in (document, again)]
    assert statuses[0] == statuses[1]
