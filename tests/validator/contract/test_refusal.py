"""Values that break the format are refused in plain words, where a descriptor is made and where one is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.synthetic import descriptor as synthetic_descriptor

from branchdrive.contract.descriptor import Collection, Descriptor, Driver, Rates, ReplayNoise, Software, Vehicle
from branchdrive.contract.document import dump_json
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.errors import ContractError, DatasetError
from branchdrive.formats.descriptor_file import read_descriptor
from branchdrive.formats.folder import Folder

CALLS: dict[str, tuple[Callable[[], Any], str, str, str]] = {
    "10 Hz": (lambda: Rates(tick_s=0.1), "/tick_s", "step the simulator at 20 Hz", "0.1"),
    "a name": (lambda: Software(name=":x", version="1"), "/name", "a letter or a digit first", "':x'"),
    "degrees": (lambda: Vehicle(max_steer_rad=35.0), "/max_steer_rad", "at most 1.5708", "35.0"),
    "an axis": (lambda: Vehicle(actuation="two"), "/actuation", "one of 'pedals' or 'single_axis'", "'two'"),  # type: ignore[arg-type]
    "a driver": (lambda: Driver(), "/kind", "a value", "nothing"),  # type: ignore[call-arg]
    "noise": (lambda: ReplayNoise(kind="natural", strength=1.0), "/", "injected noise, and no other", "natural"),
    "a seed": (lambda: Collection(seed=-1), "/seed", "at least 0", "-1"),
    "a property": (lambda: Driver(kind="log", name="x"), "/name", "no property of this name", "'x'"),  # type: ignore[call-arg]
}


@pytest.mark.parametrize("name", CALLS)
def test_a_call_is_refused_in_plain_words(name: str) -> None:
    call, pointer, expected, found = CALLS[name]
    with pytest.raises(ContractError) as raised:
        call()
    (wrong,) = raised.value.findings
    assert wrong.location == {"pointer": pointer}
    assert expected in wrong.expected
    assert found in wrong.found
    assert "pydantic" not in str(raised.value)
    assert f"BD-DOC-003 {pointer}" in str(raised.value)


def test_every_problem_is_a_line_that_is_safe_to_print() -> None:
    with pytest.raises(ContractError) as raised:
        Descriptor(**{**synthetic_descriptor(), "dataset_id": "A\x1b[31m", "unrecorded": ["observations.x_m"]})
    assert [wrong.location["pointer"] for wrong in raised.value.findings] == ["/dataset_id"]
    assert all(line.isprintable() for line in str(raised.value).splitlines())


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"unrecorded": ["observations.x_m"]}, "cannot be unrecorded; those that can are"),
        ({"unrecorded": ["actors.height_m", "actors.height_m"]}, "must not repeat"),
        ({"driver": {"kind": "log"}}, "a log has no expert that computes"),
        ({"dataset_id": "My Data"}, "/dataset_id: expected 1 to 128 lower-case letters"),
    ],
)
def test_a_file_is_refused_in_plain_words(tmp_path: Path, change: dict[str, Any], problem: str) -> None:
    (tmp_path / DESCRIPTOR_FILE).write_bytes(dump_json({**synthetic_descriptor(), **change}))
    with pytest.raises(DatasetError) as raised:
        read_descriptor(Folder(tmp_path))
    assert problem in str(raised.value)
    assert "pydantic" not in str(raised.value)


@pytest.mark.parametrize(("number", "kind"), [(0, "exact"), (0.5, "injected")])
def test_a_number_is_short_for_injected_noise(number: float, kind: str) -> None:
    noise = Collection.model_validate({"seed": 1, "replay_noise": number}).replay_noise
    assert noise == ReplayNoise.of_strength(number)
    assert (noise.kind, noise.strength or 0) == (kind, number)
