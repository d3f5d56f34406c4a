"""The executor on Dask that the guide for operators shows, as it stands there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from tests.repo.checkout import ROOT
from tests.validator.engine.datasets import DEPARTURES, write

PROGRAM = """
import json, sys
from dask_executor import dask_executor
from distributed import Client, LocalCluster
from tests.validator.runtime.tasks import die_on_three, double, lack, raise_on_three
from branchdrive import validate
from branchdrive.errors import PlatformError

if __name__ == "__main__":
    with LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        run = dask_executor(client)
        results = lambda function, tasks: [str(found)[-60:] for _, found in sorted(run(function, tasks))]
        try:
            found = {"lack": str(list(run(lack, [1, 2])))}
        except PlatformError as error:
            found = {"lack": str(error)}
        found |= {
            "double": results(double, list(range(9))),
            "none": results(double, []),
            "raise": results(raise_on_three, [1, 3]),
            "die": results(die_on_three, [1, 2, 3, 4]),
            "report": validate(sys.argv[1], executor=run).to_json(),
            "here": validate(sys.argv[1]).to_json(),
        }
        print(json.dumps(found))
"""


@pytest.mark.skipif(
    find_spec("distributed") is None, reason="NOT TESTED: Dask is not installed; the extra `test` brings it"
)
def test_the_executor_of_the_guide_runs_on_dask(tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(import os\n.*?)```", (ROOT / "docs/operators.md").read_text(), re.DOTALL)
    (tmp_path / "dask_executor.py").write_text(code)
    (tmp_path / "program.py").write_text(PROGRAM)
    root = write(tmp_path / "dataset", DEPARTURES["speed out of range"].tables())
    settings = {
        "PYTHONPATH": f"{tmp_path}:{ROOT}", "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
        "DASK_TEMPORARY_DIRECTORY": str(tmp_path),
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, str(tmp_path / "program.py"), str(root)],
        env={**os.environ, **settings}, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout)
    assert found["double"] == [str(2 * value) for value in range(9)]
    assert found["none"] == []
    assert found["raise"][0] == "2"
    assert "ValueError: three" in found["raise"][1]
    assert found["die"] == ["2", "4", "Died()", "8"]
    assert "no disk for" in found["lack"]
    assert found["report"] == found["here"]
    assert found["report"]["verdict"] == "invalid"
