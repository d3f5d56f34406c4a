"""Files for operators: they parse, agree with each other and with what the executor on Ray demands."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from tests.repo.checkout import ROOT

from branchdrive.contract.limits import spec_limits

OPERATORS = ROOT / "examples/operators"
RAY = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line)["ray"]


def document(name: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((OPERATORS / name).read_text())
    return found


def test_the_manifest_of_kuberay_has_nodes_that_agree() -> None:
    cluster = document("kuberay.yaml")
    assert (cluster["apiVersion"], cluster["kind"]) == ("ray.io/v1", "RayCluster")
    assert cluster["spec"]["rayVersion"] == RAY
    groups = [cluster["spec"]["headGroupSpec"], *cluster["spec"]["workerGroupSpecs"]]
    pods = [group["template"]["spec"] for group in groups]
    nodes = [pod["containers"][0] for pod in pods]
    for name in ("image", "workingDir", "env", "envFrom", "volumeMounts"):
        assert all(node[name] == nodes[0][name] for node in nodes), name
    assert all(pod["volumes"] == pods[0]["volumes"] for pod in pods)
    assert nodes[0]["image"].endswith(f":{RAY}")
    for group, node in zip(groups[1:], nodes[1:], strict=True):
        num_cpus, limits = int(group["rayStartParams"]["num-cpus"]), node["resources"]["limits"]
        assert node["resources"]["requests"] == limits
        assert num_cpus == int(limits["cpu"])
        assert int(limits["memory"].removesuffix("Gi")) << 30 > num_cpus * spec_limits().max_worker_bytes


def test_the_file_of_ray_up_starts_every_node_alike() -> None:
    cluster = document("cluster.yaml")
    assert len(cluster["provider"]["worker_ips"]) == cluster["max_workers"]
    head, worker = (cluster[f"{node}_start_ray_commands"][-1] for node in ("head", "worker"))
    begin = r"cd ~/empty && TMPDIR=/shared/tmp /opt/branchdrive/bin/ray start "
    assert re.match(begin + "--head --port=6379 ", head)
    assert re.match(begin + r"--address=\$RAY_HEAD_IP:6379$", worker)
    assert f"'ray=={RAY}'" in " ".join(cluster["setup_commands"])


@pytest.mark.skipif(find_spec("ray") is None, reason="NOT TESTED: Ray is not installed, 80 MB; `make ray` does this")
def test_ray_takes_the_file() -> None:
    import ray

    schema = json.loads((Path(ray.__file__).parent / "autoscaler/ray-schema.json").read_bytes())
    jsonschema.Draft7Validator(schema).validate(document("cluster.yaml"))


def test_the_page_names_the_files() -> None:
    page = (ROOT / "docs/operators.md").read_text()
    for path in sorted(OPERATORS.iterdir()):
        assert f"(../examples/operators/{path.name})" in page
