"""A program that works on Ray, for tests: `python -m tests.validator.runtime.ray_program PLACE` prints what it saw."""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
from hashlib import sha256
from pathlib import Path
from typing import Any

from tests import synthetic, synthetic_release
from tests.conformance.test_places import EVERY, drawn, options_of, told
from tests.places import files_of
from tests.validator.engine.datasets import DEPARTURES, write
from tests.validator.release.running import QUICK
from tests.validator.runtime.tasks import (
    allocate,
    die_on_three,
    double,
    kill_worker_once,
    lack,
    raise_on_three,
    sleep_and_tell,
    slow,
    where,
)

from branchdrive.engine.cache import Cache
from branchdrive.engine.validate import validate
from branchdrive.errors import PlatformError
from branchdrive.leakage.classifier import Unavailable
from branchdrive.release import leakage
from branchdrive.release.builder import STAGES, build_release
from branchdrive.release.stage import BuildOptions
from branchdrive.runtime import ray_executor as module
from branchdrive.runtime.executor import Executor, in_process, isolated
from branchdrive_conformance.case import cases_dir, load_cases
from branchdrive_conformance.materialize import DATASET_DIR, materialize


def results(executor: Executor, function: Any, tasks: list[Any]) -> list[str]:
    return [str(found)[-60:] for _, found in sorted(executor(function, tasks), key=lambda pair: pair[0])]


def reports(executor: Executor, place: Path, name: str) -> str:
    documents = []
    for root in (place / "valid", place / "invalid"):
        for cache in (None, Cache(place / "caches" / name), Cache(place / "caches" / name)):
            document = validate(root, executor=executor, cache=cache).to_json()
            conditions = [line for line in document["conditions"] if "earlier run" not in line]
            documents.append({**document, "cached": None, "conditions": conditions})
    return json.dumps(documents, sort_keys=True)


def fault(executor: Executor, function: Any, tasks: list[Any]) -> str:
    try:
        return f"nothing but {list(executor(function, tasks))}"
    except PlatformError as error:
        return str(error)


def one_machine(place: Path) -> dict[str, Any]:
    """What tasks and validations become on a Ray that is started here."""
    write(place / "valid")
    write(place / "invalid", DEPARTURES["speed out of range"].tables())
    executor = module.ray_executor(jobs=2)
    found: dict[str, Any] = {
        "double": results(executor, double, [0, 1, 2]),
        "raise": results(executor, raise_on_three, [1, 3]),
        "die": results(executor, die_on_three, [1, 2, 3, 4]),
        "allocate": results(executor, allocate, [1, 5 << 30]),
        "none": results(executor, double, []),
        "worker killed": results(executor, kill_worker_once, [(str(place / "mark"), n) for n in range(3)]),
        "lack": fault(executor, lack, [1, 2]),
        "where": next(iter(executor(where, [0])))[1],
        "reports": {
            name: reports(one, place, name)
            for name, one in {"in process": in_process, "pool": isolated(2), "ray": executor}.items()
        },
    }
    os.chdir(place)  # relative paths are those of the driver, wherever workers are
    found["relative"] = validate("valid", executor=executor).verdict
    ours, module.installation_digest = module.installation_digest, lambda *_: "another"
    found["other code"] = fault(executor, double, [1])
    module.installation_digest = ours
    return found


def two_nodes(place: Path) -> dict[str, Any]:
    """What becomes of tasks when one of two nodes is killed."""
    import ray
    from ray.cluster_utils import Cluster

    os.chdir(module._private_folder())
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    node = cluster.add_node(num_cpus=1)
    executor = module.ray_executor(cluster.address)
    list(executor(double, list(range(8))))
    threading.Timer(1.0, cluster.remove_node, [node], {"allow_graceful": False}).start()
    found = results(executor, slow, list(range(12)))
    ray.shutdown()
    cluster.shutdown()
    return {"node killed": found}


def built_in_parts(place: Path) -> dict[str, Any]:
    """Digests of the files of a release of two parts, as workers of Ray and as one process build and audit it."""
    leakage.sequence_classifier = lambda: Unavailable("none in this test")
    raw = place / "raw"
    synthetic.write_dataset(raw, synthetic_release.raw_tables(), synthetic_release.raw_descriptor())
    (raw / "raw/shard-00002").rename(raw / "raw/shard-00064")
    synthetic.seal_dataset(raw)
    found = {}
    for name, executor in {"ray": module.ray_executor(jobs=2), "one process": isolated(1)}.items():
        output = place / name.replace(" ", "-")
        build_release(
            raw, output=output, stages=STAGES, options=BuildOptions(synthetic_release.SEED), protocol=QUICK,
            executor=executor,
        )  # fmt: skip
        found[name] = {path: sha256(content).hexdigest() for path, content in files_of(output).items()}
    return found


def cases(place: Path, *, every: int = EVERY) -> dict[str, Any]:
    """Conformance cases of which a report by workers of Ray is another than one by this process, and how many agree."""
    executor, differing, num_equal = module.ray_executor(jobs=2), list[str](), 0
    for case in load_cases(cases_dir()):
        if drawn(case) % every == 0:
            folder = place / "case"
            materialize(cases_dir(), case, folder)
            options = options_of(case, folder)
            here, there = (
                told(validate(folder / DATASET_DIR, executor=one, **options)) for one in (in_process, executor)
            )
            num_equal += here == there
            differing += [case.name] * (here != there)
            shutil.rmtree(folder)
    return {"differing": differing, "equal": num_equal}


def waiting(place: Path) -> dict[str, Any]:
    """Wait for a task that does not end."""
    list(module.ray_executor(jobs=1)(sleep_and_tell, [str(place)]))
    return {}


if __name__ == "__main__":
    programs = {
        "one-machine": one_machine, "two-nodes": two_nodes, "built-in-parts": built_in_parts, "waiting": waiting,
        "cases": cases,
    }  # fmt: skip
    what = programs[sys.argv[1]]
    Path(sys.argv[3]).write_text(json.dumps(what(Path(sys.argv[2]))))
