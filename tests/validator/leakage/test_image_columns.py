"""Images before the branch in a leakage audit: a mark in one corner for one action is found, noise is not."""

from __future__ import annotations

import itertools

import numpy as np
from tests import synthetic
from tests.synthetic import BRANCH_TICK
from tests.validator.leakage.samples import exchangeable

from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.timing import HISTORY_OFFSETS
from branchdrive.leakage.gate import Gate, leakage_gate
from branchdrive.leakage.protocol import GateProtocol
from branchdrive.leakage.recording import has_all_images, recorded_numbers
from branchdrive.leakage.streams import DIFFERENT, StreamColumn, Streams, examined_cameras, ranked, stream_columns
from branchdrive.leakage.text import leakage_sentences
from branchdrive.raw.media.image_numbers import NAMES, image_numbers
from branchdrive.raw.media.images import Images
from branchdrive.raw.shard_view import ShardView
from branchdrive.testing.media import media_document

QUICK = GateProtocol(alpha=0.03, num_permutations=199, num_frequencies=8, offsets_sd=(), sparse_offsets_sd=())
NUM_GROUPS, NUM_ACTIONS = 46, 6
HEIGHT, WIDTH = 90, 160
NUMBERS = tuple(StreamColumn("frames", f"front {name}", 0) for name in NAMES)


def cameras_with_noise(seed: int) -> np.ndarray:
    """Images of one moment ``[groups, actions, rows, columns, 3]``: a scene of each group, and noise of the camera."""
    rng = np.random.default_rng(seed)
    scenes = rng.integers(40, 200, (NUM_GROUPS, 1, HEIGHT, WIDTH, 3), dtype=np.int16)
    noise = rng.integers(-8, 9, (NUM_GROUPS, NUM_ACTIONS, HEIGHT, WIDTH, 3), dtype=np.int16)
    return (scenes + noise).astype(np.uint8)


def gate_on(images: np.ndarray) -> Gate:
    numbers = np.array([[image_numbers(image) for image in group] for group in images], np.float64)
    x = exchangeable(NUM_GROUPS, NUM_ACTIONS, 3, seed=4)
    return leakage_gate(x, seed=1, protocol=QUICK, streams=Streams(NUMBERS, *ranked(numbers)))


def test_noise_of_cameras_passes_and_a_mark_in_one_corner_for_one_action_does_not() -> None:
    images = cameras_with_noise(seed=5)
    assert gate_on(images).verdict == "pass"
    images[:, 3, -6:, -6:] = 255
    gate = gate_on(images)
    assert gate.verdict == "fail"
    corner = {3 + place for place, name in enumerate(NAMES) if name.startswith("3.3")}  # after three features
    assert {code.columns[0] for code in gate.codes[:3]} == corner


def test_a_pixel_that_moves_within_its_cell_by_action_is_found() -> None:
    images = cameras_with_noise(seed=6)
    for action in range(NUM_ACTIONS):
        images[:, action, 30, 41 + 7 * action] = 255
    gate = gate_on(images)
    assert gate.verdict == "fail"
    assert gate.codes[0].columns == (3 + NAMES.index("1.1 right"),)


def test_numbers_are_means_and_moments_of_the_parts_of_an_image() -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 11, 3), dtype=np.uint8)
    rows, columns = [0, 2, 4, 6, 9], [0, 2, 5, 8, 11]
    cells = [
        image[top:bottom, left:right].astype(float)
        for top, bottom in itertools.pairwise(rows)
        for left, right in itertools.pairwise(columns)
    ]
    down = [(cell * (2 * np.arange(len(cell)) - len(cell) + 1)[:, None, None]).mean() for cell in cells]
    right = [(cell * (2 * np.arange(cell.shape[1]) - cell.shape[1] + 1)[:, None]).mean() for cell in cells]
    wanted = np.array([*(cell.mean() for cell in cells), *down, *right], np.float32)
    np.testing.assert_allclose(image_numbers(image), wanted, rtol=1e-6, atol=1e-6)


def test_a_small_image_is_one_cell() -> None:
    image = np.array([[0, 10], [20, 90]], np.uint8)
    assert image_numbers(image).reshape(3, 16).tolist() == [[30.0] * 16, [25.0] * 16, [20.0] * 16]


def _view() -> ShardView:
    view = ShardView(
        synthetic.media_tables()["raw/shard-00000"], Descriptor.model_validate(synthetic.media_descriptor())
    )
    view.images = Images.none(len(view.stream("frames")))
    view.images.numbers = view.images.numbers.copy()
    return view


def test_cells_stand_at_their_camera_cell_and_time() -> None:
    view = _view()
    assert view.images is not None
    brake = view.rollout_ids.index("g0.brake_0.50.a1")
    frames = view.stream("frames")
    (row,) = np.flatnonzero(
        (frames.rollout == brake) & (frames.tick == BRANCH_TICK - 5) & frames.equals("camera", "rear")
    )
    view.images.numbers[frames.position[row]] = np.arange(len(NAMES))
    columns = stream_columns(view.descriptor.tables, examined_cameras(view.descriptor))
    numbers = dict(zip(columns, recorded_numbers(view, np.array([brake]))[0].tolist(), strict=True))
    assert {column: numbers["frames", f"rear {column}", -5] for column in NAMES} == {
        name: float(place) for place, name in enumerate(NAMES)
    }
    assert np.isnan(numbers["frames", f"rear {NAMES[0]}", -10])
    assert numbers["frames", "rear size_bytes", -5] == frames["size_bytes"][row]
    history = (frames.rollout == brake) & frames.equals("camera", "rear")
    history &= np.isin(frames.tick - BRANCH_TICK, HISTORY_OFFSETS)
    assert numbers["frames", f"rear {DIFFERENT}", None] == len(set(frames["checksum"][history].tolist()))


def test_no_attempt_has_no_row_of_numbers() -> None:
    view = _view()
    num_columns = len(stream_columns(view.descriptor.tables, examined_cameras(view.descriptor)))
    assert recorded_numbers(view, np.array([], np.int64)).shape == (0, num_columns)


def test_all_images_are_needed_where_models_may_read_them() -> None:
    view = _view()
    assert view.images is not None
    assert has_all_images(view)
    view.images.unjudged = "images were not decoded"
    assert not has_all_images(view)
    view.descriptor = Descriptor.model_validate(media_document(synthetic.descriptor(), "rgb_top_down"))
    assert has_all_images(view)


def sentences(*streams: str) -> str:
    """What is said of an audit that saw these recorded columns."""
    shape = {"groups": 1, "actions": 1, "features": 1, "columns": 1}
    gate = {"verdict": "pass", "reason": "", "shape": shape, "bit_identical": True, "minimum_detectable_effect": None}
    inputs = {"variables": {"streams": ["controls/applied_steer", *streams]}}
    return " ".join(leakage_sentences({"gate": gate, "inputs": inputs, "battery": {"ways": []}, "not_run": []}))


def test_sentences_say_which_cameras_were_examined() -> None:
    text = sentences("frames/front 0.0", "frames/front 0.1 down", "frames/rear_left 3.3")
    assert "Images before the branch were examined by" in text
    assert "in the cells of a grid: front, rear_left." in text
    assert "Not examined by the gate: what of an image none of these numbers shows, which actor" in text


def test_sentences_on_a_dataset_without_cameras_do_not_call_them_unexamined() -> None:
    assert "No images that models may read were recorded. Not examined by the gate: which actor" in sentences()
