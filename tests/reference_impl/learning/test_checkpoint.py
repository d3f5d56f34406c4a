"""A checkpoint comes back as it was written, or not at all."""

from __future__ import annotations

import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from hypothesis import given
from hypothesis import strategies as st
from tests.reference_impl.learning.small_models import small
from tests.validator.contract.mutation import mutated
from torch import Tensor

from branchdrive import DatasetError, UsageError
from branchdrive.contract.document import dump_json
from branchdrive_reference.learning.checkpoint import (
    MAX_ACTION_FEATURES,
    Checkpoint,
    Curve,
    checkpoint_path,
    read_checkpoint,
    write_checkpoint,
)
from branchdrive_reference.learning.configuration import MAX_WIDTH, ActionConfig, HistoryConfig, ModelConfig
from branchdrive_reference.learning.network import build_network, initialise, num_parameters
from branchdrive_reference.learning.provenance import Provenance
from branchdrive_reference.learning.tensor_file import MAX_BYTES, read_tensors, write_tensors

CONFIGURATION = small()
REFUSED = r"not a tensor file of BranchDrive|changed after it was written"
ORIGIN = Provenance("M3", 11, CONFIGURATION.digest, "ab" * 32, "cd" * 32, "ef" * 32, "01" * 32)


def weights() -> dict[str, Tensor]:
    network = build_network(CONFIGURATION.model, 29)
    initialise(network, seed=11)
    return network.state_dict()


def write(path: Path) -> Path:
    write_checkpoint(
        path,
        ORIGIN,
        CONFIGURATION,
        num_action_features=29,
        environment={"torch": "2.13.0", "device": "cpu"},
        curve=Curve((0.9, 0.8, 0.7), (0.5, 0.4, 0.4)),
        weights=weights(),
    )
    return path


def with_header(header: Any, payload: bytes = b"") -> bytes:
    """A file with a header of one's own."""
    content = json.dumps(header).encode()
    return len(content).to_bytes(8, "little") + content + payload


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(checkpoint_path(tmp_path, "M3", 11))


def rewritten(path: Path, tensors: dict[str, Tensor] | None = None, **document: Any) -> Path:
    file = read_tensors(path)
    write_tensors(path, {**file.document, **document}, file.tensors if tensors is None else tensors)
    return path


def test_it_comes_back_as_it_was(path: Path) -> None:
    found = read_checkpoint(path)
    assert path.name == "M3-seed11.safetensors"
    assert (found.provenance, found.configuration) == (ORIGIN, CONFIGURATION)
    assert found.curve.best_epoch == 2
    assert repr(found) == "Checkpoint(M3, seed 11, epoch 2)"
    network = found.network()
    assert all(torch.equal(values, weights()[name]) for name, values in network.state_dict().items())
    assert not any(values.requires_grad for values in network.parameters())


def test_reading_wakes_no_threads_of_torch(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for owner, name in ((torch, "isfinite"), (Tensor, "isfinite"), (Tensor, "clone")):
        monkeypatch.setattr(owner, name, None)
    assert read_checkpoint(path).provenance == ORIGIN


def test_the_same_content_has_the_same_bytes(path: Path) -> None:
    before = path.read_bytes()
    assert write(path).read_bytes() == before
    assert read_checkpoint(path, sha256=read_checkpoint(path).sha256).provenance == ORIGIN
    assert [found.name for found in path.parent.iterdir()] == [path.name]


def test_other_tools_can_read_it(path: Path) -> None:
    found = safetensors.torch.load_file(path)
    assert found.keys() == weights().keys()


def test_another_file_than_the_locked_one_is_refused(path: Path) -> None:
    locked = read_checkpoint(path).sha256
    rewritten(path, curve={"train": [1.0], "val": [1.0]})
    assert isinstance(read_checkpoint(path), Checkpoint)
    with pytest.raises(DatasetError, match=f"expected {locked}; it was replaced"):
        read_checkpoint(path, sha256=locked)


@pytest.mark.parametrize("place", [-1, -2000, 0, 9, 700])
def test_a_changed_byte_is_refused(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=REFUSED):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"\xff" * 64, pickle.dumps({"weights": 1}), safetensors.torch.save({"a": torch.ones(2)}),
     safetensors.torch.save({"a": torch.ones(2)}, {"branchdrive": "[]"}),
     safetensors.torch.save({"a": torch.ones(2)}, {"branchdrive": '{"document": [], "digest": ""}'}),
     *(with_header({"__metadata__": it}) for it in ({"branchdrive": 7}, {"branchdrive": None}, ["branchdrive"], 7)),
     with_header([]), with_header({})],
    ids=["empty", "bytes", "pickle", "no document", "a list", "no object", "a number as text", "null as text",
         "metadata as list", "metadata as number", "header as list", "no metadata"],
)  # fmt: skip
def test_other_files_are_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=REFUSED):
        read_checkpoint(path)


def test_a_file_that_is_cut_or_too_long_is_refused(path: Path) -> None:
    content = path.read_bytes()
    for changed in (content[:-1], content + b"\0"):
        path.write_bytes(changed)
        with pytest.raises(DatasetError, match="not a tensor file of BranchDrive"):
            read_checkpoint(path)


def test_a_link_is_not_followed(path: Path) -> None:
    link = path.with_name("M3-seed23.safetensors")
    link.symlink_to(path)
    with pytest.raises(DatasetError, match="without following links"):
        read_checkpoint(link)
    with pytest.raises(DatasetError, match="does not exist"):
        read_checkpoint(path.with_name("M3-seed37.safetensors"))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"format": "branchdrive-checkpoint-0"}, "is not a checkpoint of the format"),
        ({"more": 1}, "is not a checkpoint of the format"),
        ({"provenance": {**ORIGIN.record, "code_version": "0.0.1"}}, "`code_version` is '0.0.1', expected "),
        ({"provenance": {**ORIGIN.record, "model": "M1"}}, "`model` is 'M1', expected 'M3'"),
        ({"provenance": {**ORIGIN.record, "seed": "11"}}, "`seed` is '11'"),
        ({"provenance": {**ORIGIN.record, "data_digest": [1]}}, r"`data_digest` is \[1\]"),
        ({"provenance": {"model": "M3"}}, "missing 6 required positional arguments"),
        ({"configuration": small(patience=3).record}, "`config_digest` is "),
        ({"configuration": {}}, "not a valid model configuration"),
        ({"curve": {"train": [1.0], "val": []}}, "no pair of equally many losses"),
        ({"num_action_features": 30}, "tensor 'bank.layers.0.weight' is "),
        *(({"num_action_features": size}, "`num_action_features` is ") for size in (2**62, 0, -1, "29", True)),
    ],
)
def test_a_document_that_does_not_fit_is_refused(path: Path, document: dict[str, Any], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        read_checkpoint(rewritten(path, **document))


@pytest.mark.parametrize("width", [MAX_WIDTH, 2**40])
def test_a_large_width_takes_no_memory(path: Path, width: int) -> None:
    record = json.loads(json.dumps(CONFIGURATION.record))
    record["model"]["fusion_width"] = width
    origin = {**ORIGIN.record, "config_digest": hashlib.sha256(dump_json(record)).hexdigest()}
    message = r"expected torch.float32 \[768" if width == MAX_WIDTH else "/model/fusion_width: Input should be less"
    with pytest.raises(DatasetError, match=message):
        read_checkpoint(rewritten(path, configuration=record, provenance=origin))


def test_the_largest_model_can_be_read_again_while_it_is_trained() -> None:
    widest = ModelConfig(
        "M3", "sensor", MAX_WIDTH, HistoryConfig(MAX_WIDTH, MAX_WIDTH, MAX_WIDTH), ActionConfig(MAX_WIDTH, MAX_WIDTH)
    )
    with torch.device("meta"):
        num = num_parameters(build_network(widest, MAX_ACTION_FEATURES))
    assert 4 * 4 * num < 0.9 * MAX_BYTES  # weights, the best ones, and two moments of each, in float32


@pytest.mark.parametrize("name", ["../../x/pwn", "a/b", "/etc/M3", "..", "", "M3\n"])
def test_no_checkpoint_stands_outside_of_its_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="is not a name of a model"):
        checkpoint_path(tmp_path, name, 11)


def test_tensors_that_do_not_fit_are_refused(path: Path) -> None:
    good = weights()
    for name, values, message in (
        ("decoder.bias", torch.ones(8), r"torch.float32 \[8\], expected torch.float32 \[9\]"),
        ("decoder.bias", good["decoder.bias"].double(), r"torch.float64 \[9\], expected"),
        ("decoder.bias", torch.full((9,), torch.nan), "holds a value that is not a number"),
        ("decoder.more", torch.ones(9), "'decoder.more' is missing or too many"),
    ):
        with pytest.raises(DatasetError, match=message):
            read_checkpoint(rewritten(path, {**good, name: values}))
    del good["decoder.bias"]
    with pytest.raises(DatasetError, match=r"'decoder.bias' is missing or too many"):
        read_checkpoint(rewritten(path, good))


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint that stays the same for every example."""
    return write(tmp_path_factory.mktemp("fuzzed") / "M3-seed11.safetensors")


def is_read_or_refused(folder: Path, content: bytes) -> None:
    changed = folder / "changed.safetensors"
    changed.write_bytes(content)
    try:
        found = read_checkpoint(changed)
    except DatasetError as error:
        assert str(error).isprintable()
    else:
        assert type(found.provenance.seed) is int
        assert found.provenance.model == found.configuration.model.name


@given(st.data())
def test_a_mutated_header_is_read_or_refused(fuzzed: Path, data: st.DataObject) -> None:
    content = fuzzed.read_bytes()
    end = 8 + int.from_bytes(content[:8], "little")
    header = data.draw(mutated(st.just(json.loads(content[8:end]))))
    is_read_or_refused(fuzzed.parent, with_header(header, content[end:]))


@given(st.data())
def test_a_mutated_document_is_read_or_refused(fuzzed: Path, data: st.DataObject) -> None:
    """The digest is that of the mutated document, so that what it says is judged."""
    file = read_tensors(fuzzed)
    changed = fuzzed.parent / "written.safetensors"
    write_tensors(changed, data.draw(mutated(st.just(file.document))), file.tensors)
    is_read_or_refused(fuzzed.parent, changed.read_bytes())


@given(st.data())
def test_mutated_bytes_are_read_or_refused(fuzzed: Path, data: st.DataObject) -> None:
    content = fuzzed.read_bytes()
    start = data.draw(st.integers(0, len(content)) | st.integers(0, 1200))
    stop = min(len(content), start + data.draw(st.integers(0, 12)))
    is_read_or_refused(fuzzed.parent, content[:start] + data.draw(st.binary(max_size=12)) + content[stop:])
