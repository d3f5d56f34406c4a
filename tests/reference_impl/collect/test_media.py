"""`branchdrive collect --media`: a finished collection gets the media of a later rendering, once."""

from __future__ import annotations

import shutil
from io import StringIO
from pathlib import Path

import pytest
from tests.reference_impl.collect.kept_collection import kept_collection
from tests.reference_impl.rendering.small import SMALL

from branchdrive.cli.main import run
from branchdrive_reference.collect.campaign import collection_descriptor
from branchdrive_reference.collect.media import default_media, is_being_rendered
from branchdrive_reference.rendering.dataset import render_dataset
from branchdrive_reference.rendering.plan import MediaPlan

SEED = 5


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A finished collection of one group; its media are small."""
    monkeypatch.setattr("branchdrive_reference.collect.media.default_media", lambda: MediaPlan((SMALL,)))
    return kept_collection(tmp_path / "collected", num_groups=1, seed=SEED)


def collect(root: Path, *options: object) -> tuple[int, str, str]:
    stdout, stderr = StringIO(), StringIO()
    arguments = ["collect", root, "--groups", 1, "--seed", SEED, "--media", *options]
    return run([*map(str, arguments)], stdout, stderr), stdout.getvalue(), stderr.getvalue()


def files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_media_are_those_of_a_later_rendering(root: Path, tmp_path: Path) -> None:
    later = Path(shutil.copytree(root, tmp_path / "later"))
    rendered = render_dataset(later, MediaPlan((SMALL,)))
    for _ in range(2):  # the second finds everything
        code, out, err = collect(root)
        assert (code, err) == (0, "")
        assert f"images    {rendered.num_images:,} in " in out
        assert f"identity  {rendered.identity}\n" in out
        assert files(root) == files(later)


def test_an_interrupted_rendering_is_gone_on_with(root: Path) -> None:
    def interrupt(num_done: int, _: int) -> None:
        if num_done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(root, MediaPlan((SMALL,)), watch=interrupt)
    assert is_being_rendered(root, collection_descriptor(SEED), 1)
    assert collect(root)[0] == 0


def test_what_a_benchmark_takes_is_said_before_images_are_drawn(root: Path) -> None:
    stdout = StringIO()
    options = ("--streams", "semantic_bev", "--width", "16", "--height", "16")
    assert run(["render", str(root), *options], stdout, StringIO()) == 0
    assert stdout.getvalue().startswith("routes    1 route cluster in 1 branched group; a release parts whole clusters")


def test_what_has_media_keeps_its_version(root: Path) -> None:
    assert collect(root)[0] == 0
    code, _, err = collect(root, "--groups", 2)
    assert (code, err.count("\n")) == (2, 1)
    assert "is finished with 1 groups and has media" in err
    code, _, err = collect(root, "--seed", SEED + 1)
    assert code == 2
    assert "holds a dataset with another descriptor" in err


def test_a_collection_gets_every_camera() -> None:
    assert [camera.stream for camera in default_media().cameras] == ["rgb_surround"] * 6 + [
        "rgb_top_down",
        "semantic_bev",
    ]
