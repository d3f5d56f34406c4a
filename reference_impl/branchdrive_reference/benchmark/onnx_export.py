"""The deployable selector: mean predicted scalars of the bank from one context, as an ONNX model.

Inputs are ``state [16, 21]`` and ``controls [80, 3]`` in physical units, float32, and for a model of objects ``objects
[16, 32, 11]`` and ``objects_mask [16, 32]``; the output ``targets [A, 6]`` is in the order of the bank and of the
targets, in their units. Metadata name the bank, the targets, the checkpoints, and
the scale and weights from which a profile's utility follows, so that nothing else is needed to choose.

A selector that reads cameras takes one observation at a time, before its history where it reads one: ``views
[6, *encoding]``, ``mask [6]`` and ``past [seeds, 15, width]``, and beside the targets it gives ``steps``, of the last
15 observations, which are ``past`` of the next observation. What it says counts from the 16th observation on.

Operators are those of opset 20. Each recurrence is one operator ``GRU`` of its own width.

Source: paper, "Complete-Bank Ranking and Offline Policy Evaluation" (latency of the structured selector).
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from branchdrive.benchmark.prediction.inputs import utility_scale
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.contract.timing import HISTORY_OBSERVATIONS
from branchdrive.driving.feature import InputContract
from branchdrive.driving.target import TARGETS
from branchdrive.driving.utility import REVERSED, WEIGHED, Profile, Scale
from branchdrive.errors import BranchDriveError
from branchdrive.model.features import HISTORIES, OBJECT_FEATURES
from branchdrive.model.reader import ModelLayer
from branchdrive.runtime.environment import extra
from branchdrive_reference.benchmark.release import Release, benchmark_data
from branchdrive_reference.learning.checkpoint import Checkpoint
from branchdrive_reference.learning.image_encoder import open_encoder
from branchdrive_reference.learning.image_encoding import ENCODINGS, VIEWS
from branchdrive_reference.learning.image_inputs import image_arrays, mask_of
from branchdrive_reference.learning.network import SequenceEncoder
from branchdrive_reference.learning.ranker import VIEW_CAMERAS, BankNetwork, CameraNetwork, reads_cameras

__all__ = [
    "CAMERA_INPUTS", "INPUTS", "OPSET", "OUTPUT", "STEPS", "TOLERANCE", "check_equal", "contexts_of",
    "export_locked",
    "export_selector", "largest_difference", "open_selector",
]  # fmt: skip

OPSET = 20
"""Version of the operators: the first with one for the activation."""

INPUTS, OUTPUT = ("state", "controls"), "targets"
CAMERA_INPUTS, STEPS = ("views", "mask", "past"), "steps"
"""What a selector that reads cameras takes and gives besides."""

TOLERANCE = 1e-5
"""Largest difference to torch, in units of the larger of 1 and the value."""

UTILITY = (
    "sum over weighed of weight * d, d = clip((y - q05) / max(q95 - q05, 1e-6), 0, 1), and 1 - d where reversed; "
    "under a profile in near_m, d = sqrt(clip(y / near_m, 0, 1)) for the first"
)
"""How utility follows from targets ``y``, as the metadata say it."""

Array = NDArray[np.float32]


def export_selector(
    checkpoints: Sequence[Checkpoint],
    release: ModelLayer,
    *,
    scale: Scale,
    profiles: Mapping[str, Profile],
    origin: Mapping[str, str] | None = None,
) -> bytes:
    """The bytes of the model.

    Args:
        checkpoints: Seeds of one model that reads actions, and histories, surround views or both.
        release: The release that they were trained on.
        scale: Quantiles of the training targets.
        profiles: Preferences by name.
        origin: What else the metadata name, such as the identity of the release.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: The models are none that can be ranked with.
    """
    with extra("export", of="`export`"):
        import onnx
        import onnxscript  # noqa: F401
    context = tuple(map(torch.from_numpy, _contexts_for(checkpoints, release, "train", 1)[0]))
    network: BankNetwork | CameraNetwork
    if reads_cameras(checkpoints):
        network = CameraNetwork(checkpoints, release).eval()
        inputs = (*_first_observation(network), *context[: len(network.reads)])
        names, outputs = [*CAMERA_INPUTS, *network.reads], [OUTPUT, STEPS]
    else:
        network, inputs = BankNetwork(checkpoints, release).eval(), context
        names, outputs = list(network.reads), [OUTPUT]
    _use_operators(network)
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # deprecations inside of the exporter
            program = torch.onnx.export(
                network, inputs, dynamo=True, opset_version=OPSET, input_names=names, output_names=outputs,
                verbose=False,
            )  # fmt: skip
    finally:
        log.setLevel(level)
    if program is None:
        raise BranchDriveError("torch exported nothing")
    model = program.model_proto
    about = _about(checkpoints, release, scale, profiles)
    about |= {f"branchdrive.{name}": value for name, value in (origin or {}).items()}
    for name, value in about.items():
        model.metadata_props.add(key=name, value=json.dumps(value, sort_keys=True, allow_nan=False))
    for node in (model, model.graph, *model.graph.node):
        node.doc_string = ""
    for node in model.graph.node:
        del node.metadata_props[:]  # lines of source and traces of the exporting machine
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


class _GruOperator(nn.Module):
    """A recurrence as the operator ``GRU``, whose gates are update, reset and new; those of torch begin with reset.

    onnxscript before 0.7.1 has other equations for what torch exports by itself.
    """

    weight: Tensor
    recurrence: Tensor
    bias: Tensor

    def __init__(self, recur: nn.GRU) -> None:
        super().__init__()
        self._width = recur.hidden_size
        weight, recurrence, *biases = (_update_first(gates) for gates in recur.parameters())
        self.register_buffer("weight", weight)
        self.register_buffer("recurrence", recurrence)
        self.register_buffer("bias", torch.cat(biases, dim=1))

    def forward(self, steps: Tensor) -> Sequence[Tensor]:
        """All states and the last one ``[1, 1, width]`` of one sequence ``[1, steps, features]``."""
        return torch.onnx.ops.symbolic_multi_out(
            "GRU", (steps.transpose(0, 1), self.weight, self.recurrence, self.bias),
            {"hidden_size": self._width, "linear_before_reset": 1}, dtypes=(steps.dtype, steps.dtype),
            shapes=((steps.shape[1], 1, 1, self._width), (1, 1, self._width)), version=OPSET,
        )  # fmt: skip


def _update_first(gates: Tensor) -> Tensor:
    reset, update, new = gates.detach().chunk(3)
    return torch.cat([update, reset, new])[None]


def _use_operators(network: nn.Module) -> None:
    for module in network.modules():
        if isinstance(module, SequenceEncoder):
            module.register_module("recur", _GruOperator(module.recur))


def export_locked(
    release: Release, protocol: BenchmarkProtocol, checkpoints: Sequence[Checkpoint]
) -> tuple[bytes, float]:
    """The model of locked checkpoints, with scale and profiles of the protocol, and its difference to torch on `val`.

    Raises:
        PlatformError: The extra is not installed.
        UsageError: The models are none that can be ranked with.
        BranchDriveError: The difference is larger than `TOLERANCE`.
    """
    content = export_selector(
        checkpoints,
        release.layer,
        scale=utility_scale(protocol, benchmark_data(release)),
        profiles=protocol.preferences,
        origin={"release": release.manifest.identity, "protocol": protocol.digest},
    )
    return content, check_equal(content, checkpoints, release.layer)


def check_equal(
    content: bytes, checkpoints: Sequence[Checkpoint], release: ModelLayer, partition: str = "val"
) -> float:
    """Largest difference between the model and plain torch over the contexts of a partition; see `TOLERANCE`.

    Raises:
        PlatformError: The extra is not installed.
        BranchDriveError: The difference is larger than `TOLERANCE`.
    """
    if reads_cameras(checkpoints):
        found = _largest_camera_difference(content, CameraNetwork(checkpoints, release).eval(), release, partition)
        return _equal(found)
    network = BankNetwork(checkpoints, release).eval()

    def predict(*context: NDArray[Any]) -> Array:
        with torch.inference_mode():
            return network(*map(torch.from_numpy, context)).numpy()  # type: ignore[no-any-return]

    contexts = _contexts_for(checkpoints, release, partition)
    return _equal(largest_difference(content, predict, contexts, names=network.reads))


def _equal(found: float) -> float:
    """A difference that is small enough."""
    if not found <= TOLERANCE:
        raise BranchDriveError(
            f"the exported selector differs from torch by {found:g}, at most {TOLERANCE:g} is allowed"
        )
    return found


def open_selector(content: bytes) -> Any:
    """The exported model as a session of ONNX Runtime on one thread of the CPU.

    Raises:
        PlatformError: The extra is not installed.
    """
    with extra("export", of="`export`"):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def largest_difference(
    content: bytes,
    predict: Callable[..., NDArray[Any]],
    contexts: Sequence[tuple[NDArray[Any], ...]],
    *,
    names: Sequence[str] = INPUTS,
) -> float:
    """Largest of ``|onnx - torch| / max(1, |torch|)`` over contexts.

    Args:
        content: The exported model.
        predict: Targets ``[A, 6]`` from the inputs of a context, as torch computes them.
        contexts: Inputs of each, in the order of `names`.
        names: Names of the inputs.

    Raises:
        PlatformError: The extra is not installed.
    """
    session, largest = open_selector(content), 0.0
    for context in contexts:
        (found,) = session.run([OUTPUT], dict(zip(names, context, strict=True)))
        expected = predict(*context)
        largest = max(largest, float((np.abs(found - expected) / np.maximum(1.0, np.abs(expected))).max()))
    return largest


def _largest_camera_difference(content: bytes, network: CameraNetwork, release: ModelLayer, partition: str) -> float:
    """The same over the observations of the contexts: one by one exported, all at once in torch."""
    encoders = {VIEWS: open_encoder(network.encoding)}
    images = image_arrays(release, partition, InputContract.SENSOR, encoders)
    session, largest = open_selector(content), 0.0
    for views, mask, context in zip(
        images[VIEWS], images[mask_of(VIEWS)], contexts_of(release, partition), strict=True
    ):
        history = dict(zip(network.reads, context, strict=False))
        past = np.zeros((len(network.blank_step()), HISTORY_OBSERVATIONS - 1, network.images.step_width), np.float32)
        for view, there in zip(views, mask, strict=True):
            given = dict(zip(CAMERA_INPUTS, (view, there, past), strict=True))
            found, past = session.run([OUTPUT, STEPS], given | history)
        with torch.inference_mode():
            steps = [network.images.encode_step(*map(torch.from_numpy, one)) for one in zip(views, mask, strict=True)]
            window = torch.stack(steps, dim=1)
            expected = network.rank(window, *map(torch.from_numpy, history.values())).numpy()
        largest = max(largest, float((np.abs(found - expected) / np.maximum(1.0, np.abs(expected))).max()))
    return largest


def _first_observation(network: CameraNetwork) -> tuple[Tensor, Tensor, Tensor]:
    """An observation without images after none."""
    about, blank = ENCODINGS[network.encoding], network.blank_step()
    views = torch.zeros((len(VIEW_CAMERAS), *about.shape), dtype=getattr(torch, about.dtype))
    past = torch.zeros((len(blank), HISTORY_OBSERVATIONS - 1, network.images.step_width))
    return views, torch.zeros(len(VIEW_CAMERAS), dtype=torch.bool), past


def contexts_of(release: ModelLayer, partition: str, most: int | None = None) -> list[tuple[Array, Array]]:
    """Contexts of a partition in physical units, float32: ``state [16, 21]`` and ``controls [80, 3]`` of each."""
    found = release.sensor_inputs(partition)
    pairs = zip(found.state[:most], found.controls[:most], strict=True)
    return [(np.array(state, np.float32), np.array(controls, np.float32)) for state, controls in pairs]


def _contexts_for(
    checkpoints: Sequence[Checkpoint], release: ModelLayer, partition: str, most: int | None = None
) -> list[tuple[NDArray[Any], ...]]:
    """What models take of the contexts of a partition: those of `contexts_of`, with objects where they read some."""
    found: list[tuple[NDArray[Any], ...]] = [*contexts_of(release, partition, most)]
    if any(checkpoint.configuration.model.objects for checkpoint in checkpoints):
        seen = release.objects_inputs(partition)
        pairs = zip(found, seen.objects, seen.objects_available, strict=False)
        found = [(*context, np.array(objects), np.array(mask)) for context, objects, mask in pairs]
    return found


def _about(
    checkpoints: Sequence[Checkpoint], release: ModelLayer, scale: Scale, profiles: Mapping[str, Profile]
) -> dict[str, Any]:
    images = checkpoints[0].configuration.model.images
    seen = {"cameras": list(VIEW_CAMERAS), "encoding": images[VIEWS].encoding} if VIEWS in images else None
    objects = checkpoints[0].configuration.model.objects is not None
    return {
        **({} if seen is None else {"branchdrive.views": seen}),
        **({"branchdrive.objects": [name for name, _ in OBJECT_FEATURES]} if objects else {}),
        "branchdrive.candidates": list(release.candidate_order),
        **{
            f"branchdrive.{name}": [{"name": one.name, "unit": one.unit} for one in HISTORIES[name].features]
            for name in ("state", "past_controls")
        },
        "branchdrive.targets": [{"name": target.name, "unit": target.unit} for target in TARGETS],
        "branchdrive.checkpoints": [
            {"model": one.provenance.model, "seed": one.provenance.seed, "sha256": one.sha256} for one in checkpoints
        ],
        "branchdrive.normalisation": checkpoints[0].provenance.normalisation_digest,
        "branchdrive.utility": {
            "formula": UTILITY,
            "weighed": list(WEIGHED),
            "reversed": [name for name, is_reversed in zip(WEIGHED, REVERSED, strict=True) if is_reversed],
            **{name: [float(v) if np.isfinite(v) else None for v in getattr(scale, name)] for name in ("q05", "q95")},
            "profiles": {name: profile.weights.tolist() for name, profile in profiles.items()},
            "near_m": {name: profile.near_m for name, profile in profiles.items() if profile.near_m is not None},
        },
    }
