"""Images before the branch in a leakage audit: a mark in one corner for one action is found, noise is not."""

from __future__ import annotations

import itertools

import numpy as np
from tests import synthetic
from tests.synthetic import BRANCH_TICK
from tests.validator.leakage.samples import exchangeable

from branchdrive.contract.descriptor import Descriptor
from branchdrive.leakage.gate import Gate, leakage_gate
from branchdrive.leakage.protocol import Protocol
from branchdrive.leakage.recording import has_all_images, recorded_numbers
from branchdrive.leakage.streams import StreamColumn, Streams, examined_cameras, ranked, stream_columns
from branchdrive.leakage.text import leakage_sentences
from branchdrive.raw.images import GRID, Images, cell_means
from branchdrive.raw.shard_view import ShardView
from branchdrive.testing.media import media_document

QUICK = Protocol(alpha=0.03, num_permutations=199, num_frequencies=8, offsets_sd=(), sparse_offsets_sd=())
NUM_GROUPS, NUM_ACTIONS = 46, 6
HEIGHT, WIDTH = 90, 160
CELLS = tuple(StreamColumn("frames", f"front {row}.{column}", 0) for row, column in np.ndindex(GRID, GRID))


def cameras_with_noise(seed: int) -> np.ndarray:
    """Images of one moment ``[groups, actions, rows, columns, 3]``: a scene of each group, and noise of the camera."""
    rng = np.random.default_rng(seed)
    scenes = rng.integers(40, 200, (NUM_GROUPS, 1, HEIGHT, WIDTH, 3), dtype=np.int16)
    noise = rng.integers(-8, 9, (NUM_GROUPS, NUM_ACTIONS, HEIGHT, WIDTH, 3), dtype=np.int16)
    return (scenes + noise).astype(np.uint8)


def gate_on(images: np.ndarray) -> Gate:
    cells = np.array([[cell_means(image) for image in group] for group in images], np.float64)
    x = exchangeable(NUM_GROUPS, NUM_ACTIONS, 3, seed=4)
    return leakage_gate(x, seed=1, protocol=QUICK, streams=Streams(CELLS, *ranked(cells)))


def test_noise_of_cameras_passes_and_a_mark_in_one_corner_for_one_action_does_not() -> None:
    images = cameras_with_noise(seed=5)
    assert gate_on(images).verdict == "pass"
    images[:, 3, -6:, -6:] = 255
    gate = gate_on(images)
    assert gate.verdict == "fail"
    assert gate.codes[0].columns == (3 + len(CELLS) - 1,)  # the lower right corner, after three features


def test_cell_means_are_those_of_the_parts_of_an_image() -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 11, 3), dtype=np.uint8)
    rows, columns = [0, 2, 4, 6, 9], [0, 2, 5, 8, 11]
    wanted = [
        image[top:bottom, left:right].mean()
        for top, bottom in itertools.pairwise(rows)
        for left, right in itertools.pairwise(columns)
    ]
    assert cell_means(image).tolist() == np.array(wanted, np.float32).tolist()
    assert cell_means(image[:3, :, 0]).tolist() == [np.float32(image[:3, :, 0].mean())] * GRID**2


def _view() -> ShardView:
    view = ShardView(
        synthetic.media_tables()["raw/shard-00000"], Descriptor.model_validate(synthetic.media_descriptor())
    )
    view.images = Images.none(len(view.stream("frames")))
    return view


def test_cells_stand_at_their_camera_cell_and_time() -> None:
    view = _view()
    assert view.images is not None
    brake = view.rollout_ids.index("g0.brake_0.50.a1")
    frames = view.stream("frames")
    (row,) = np.flatnonzero(
        (frames.rollout == brake) & (frames.tick == BRANCH_TICK - 5) & frames.equals("camera", "rear")
    )
    view.images.cells[frames.position[row]] = np.arange(GRID**2)
    columns = stream_columns(view.descriptor.tables, examined_cameras(view.descriptor))
    numbers = dict(zip(columns, recorded_numbers(view, np.array([brake]))[0].tolist(), strict=True))
    assert {column: numbers[column] for column in columns if column.table == "frames" and numbers[column] >= 0} == {
        StreamColumn("frames", f"rear {row}.{column}", -5): 4.0 * row + column for row, column in np.ndindex(GRID, GRID)
    }


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


def test_sentences_say_which_cameras_were_examined() -> None:
    variables = {"streams": ["controls/applied_steer", "frames/front 0.0", "frames/front 0.1", "frames/rear_left 3.3"]}
    shape = {"groups": 1, "actions": 1, "features": 1, "columns": 1}
    gate = {"verdict": "pass", "reason": "", "shape": shape, "bit_identical": True, "minimum_detectable_effect": None}
    leakage = {"gate": gate, "inputs": {"variables": variables}, "battery": {"ways": []}, "not_run": []}
    text = " ".join(leakage_sentences(leakage))
    assert "Images before the branch were examined by the means of 4 x 4 cells: front, rear_left." in text
    assert "Not examined by the gate: what of a camera frame no mean of a cell shows, which actor" in text
    variables["streams"] = variables["streams"][:1]
    assert "Not examined by the gate: camera frames, which actor" in " ".join(leakage_sentences(leakage))
