"""Training: the same weights from the same beginning, however often it is interrupted; validation alone ends it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import torch
from tests.model_release import make_frames, write_release
from tests.reference_impl.learning.small_models import DECLARED, MEAN, SMALL, make_release, small
from tests.sampling import sampled

from branchdrive import DatasetError, UsageError, open_model
from branchdrive_reference.learning import training
from branchdrive_reference.learning.adam import AdamW
from branchdrive_reference.learning.checkpoint import Checkpoint, checkpoint_path, read_checkpoint
from branchdrive_reference.learning.configuration import Configuration
from branchdrive_reference.learning.execution import deterministic
from branchdrive_reference.learning.groups import BranchGroupDataset
from branchdrive_reference.learning.loss import loss_terms
from branchdrive_reference.learning.network import build_network, initialise
from branchdrive_reference.learning.training import EpochReport, train_model
from branchdrive_reference.learning.training_state import state_path


class StoppedError(Exception):
    """Somebody stopped the training."""


class Watch:
    """Counts epochs, and stops after one of them."""

    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after = stop_after
        self.reports: list[EpochReport] = []

    def __call__(self, report: EpochReport) -> None:
        self.reports.append(report)
        if report.epoch == self.stop_after:
            raise StoppedError


@pytest.fixture(scope="module")
def whole(release: Path, tmp_path_factory: pytest.TempPathFactory) -> Checkpoint:
    """What a training of M3 without interruption comes to."""
    return train_model(release, tmp_path_factory.mktemp("whole"), SMALL["M3"], seed=11)


@pytest.mark.parametrize("name", sampled(SMALL, every=2))
def test_the_same_seed_gives_the_same_bytes(release: Path, tmp_path: Path, name: str) -> None:
    torch.manual_seed(1)
    first = train_model(release, tmp_path / "first", SMALL[name], seed=11)
    torch.manual_seed(2)
    second = train_model(open_model(release), tmp_path / "second", SMALL[name], seed=11)
    other = train_model(release, tmp_path / "first", SMALL[name], seed=23)
    assert first.sha256 == second.sha256
    assert not torch.equal(first.weights["decoder.bias"], other.weights["decoder.bias"])
    assert first.curve.val[0] != other.curve.val[0]


@pytest.mark.parametrize("stop_after", sampled([1, 3, 8, 5], every=2))
def test_an_interrupted_training_comes_to_the_same_bytes(
    release: Path, whole: Checkpoint, tmp_path: Path, stop_after: int
) -> None:
    path = checkpoint_path(tmp_path / "parts", "M3", 11)
    with pytest.raises(StoppedError):
        train_model(release, path.parent, SMALL["M3"], seed=11, on_epoch=Watch(stop_after))
    assert state_path(path).is_file()
    assert not path.exists()
    watch = Watch()
    resumed = train_model(release, path.parent, SMALL["M3"], seed=11, on_epoch=watch)
    assert [report.epoch for report in watch.reports] == list(range(stop_after + 1, 9))
    assert resumed.sha256 == whole.sha256
    assert [found.name for found in path.parent.iterdir()] == [path.name]


def test_a_killed_training_goes_on_from_its_last_state(release: Path, whole: Checkpoint, tmp_path: Path) -> None:
    path = checkpoint_path(tmp_path / "killed", "M3", 11)

    now_s = 0.0

    def keep(report: EpochReport) -> None:
        nonlocal now_s
        now_s = {4: training.SAVE_EVERY_S, 5: 2 * training.SAVE_EVERY_S - 1.0}.get(report.epoch, now_s)
        if report.epoch == 4:
            assert not state_path(path).exists()
        if report.epoch == 7:
            shutil.copyfile(state_path(path), tmp_path / "kept")

    train_model(release, path.parent, SMALL["M3"], seed=11, on_epoch=keep, clock=lambda: now_s)
    path.unlink()
    shutil.copyfile(tmp_path / "kept", state_path(path))
    watch = Watch()
    assert train_model(release, path.parent, SMALL["M3"], seed=11, on_epoch=watch).sha256 == whole.sha256
    assert watch.reports[0].epoch == 6


def test_the_best_epoch_is_kept_and_patience_ends(release: Path, tmp_path: Path) -> None:
    watch = Watch()
    configuration = small(max_epochs=60, patience=4, learning_rate=0.05)
    found = train_model(release, tmp_path, configuration, seed=11, on_epoch=watch)
    val = [report.val_loss for report in watch.reports]
    best = found.curve.best_epoch
    assert (found.curve.val, found.curve.train) == (tuple(val), tuple(r.train_loss for r in watch.reports))
    assert val[best - 1] == min(val)
    assert len(val) == best + 4 < 60
    assert watch.reports[-1] == ("M3", 11, len(val), 60, found.curve.train[-1], val[-1], True, None)
    data = BranchGroupDataset(release, "val").tensors
    with deterministic(), torch.no_grad():
        outcome = found.network()(data, num_groups=1, num_candidates=13)
        loss = loss_terms(outcome, data["scalars"], data["mask"], data["trajectory"], configuration.training).total
    assert float(loss) == min(val)


def test_other_partitions_are_not_read(whole: Checkpoint, tmp_path: Path) -> None:
    frames = make_frames()
    for name in ("scalars", "trajectories", "state"):
        frame = frames[name]
        rows = frame["group_id"] == "g4"
        column = {"scalars": "displacement_m", "trajectories": "x_m", "state": "speed_mps"}[name]
        frame[column] = frame[column].copy()
        frame[column][rows] += 1.0
    changed = write_release(tmp_path / "changed", frames)
    assert train_model(changed, tmp_path / "out", SMALL["M3"], seed=11).sha256 == whole.sha256


def test_a_checkpoint_that_is_there_is_taken(release: Path, tmp_path: Path) -> None:
    first, watch = train_model(release, tmp_path, SMALL["M1"], seed=11), Watch()
    assert train_model(release, tmp_path, SMALL["M1"], seed=11, on_epoch=watch).sha256 == first.sha256
    assert watch.reports == []


@pytest.mark.parametrize("name", ["checkpoint", "state"])
def test_what_another_training_left_is_refused(release: Path, tmp_path: Path, name: str) -> None:
    other = make_release(tmp_path / "other", seed=5)
    watch = Watch(2 if name == "state" else None)
    try:
        train_model(release, tmp_path, SMALL["M1"], seed=11, on_epoch=watch)
    except StoppedError:
        assert name == "state"
    before = {path.name: path.read_bytes() for path in tmp_path.glob("M1*")}
    for root, configuration in ((release, small("M1", max_epochs=9)), (other, SMALL["M1"])):
        with pytest.raises((UsageError, DatasetError), match="another configuration, release"):
            train_model(root, tmp_path, configuration, seed=11)
    assert {path.name: path.read_bytes() for path in tmp_path.glob("M1*")} == before


def test_a_damaged_state_is_refused(release: Path, tmp_path: Path) -> None:
    with pytest.raises(StoppedError):
        train_model(release, tmp_path, SMALL["M1"], seed=11, on_epoch=Watch(2))
    path = state_path(checkpoint_path(tmp_path, "M1", 11))
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="changed after it was written"):
        train_model(release, tmp_path, SMALL["M1"], seed=11)


def test_the_mean_is_that_of_the_training_rows(release: Path, tmp_path: Path) -> None:
    found, watch = train_model(release, tmp_path, MEAN, seed=0, on_epoch=Watch()), Watch()
    assert watch.reports == []
    assert (found.curve.val, found.curve.best_epoch) == ((), 0)
    targets = open_model(release).targets("train", normalised=True)
    mean = torch.tensor([targets.scalars[..., t][targets.scalars_available[..., t]].mean() for t in range(6)])
    torch.testing.assert_close(found.weights["scalars"], mean.double(), rtol=0, atol=1e-6)


def test_the_provenance_is_that_of_the_release(release: Path, tmp_path: Path) -> None:
    origin = train_model(release, tmp_path, SMALL["M2"], seed=37).provenance
    assert (origin.model, origin.seed, origin.config_digest) == ("M2", 37, SMALL["M2"].digest)
    assert origin.split_digest == open_model(release).scalings().state.split_digest
    assert read_checkpoint(checkpoint_path(tmp_path, "M2", 37)).provenance == origin


@pytest.mark.parametrize("name", ["M1", "M2", "M3"])
def test_a_loss_that_is_no_number_ends_a_training(release: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=rf"{name}, seed 11: the loss of epoch \d is not a number; `learning_rate` is"):
        train_model(release, tmp_path, small(name, learning_rate=1e38, warmup_epochs=1), seed=11)


def test_one_batch_can_be_learnt_by_heart(release: Path) -> None:
    configuration = DECLARED["M3"]
    data = BranchGroupDataset(release, "train").tensors
    network = build_network(configuration.model, 29)
    initialise(network, seed=11)
    optimizer = AdamW(network.parameters())
    losses = []
    with deterministic():
        for _ in range(120):
            outcome = network(data, num_groups=3, num_candidates=13)
            loss = loss_terms(outcome, data["scalars"], data["mask"], data["trajectory"], configuration.training).total
            optimizer.descend(loss, 2e-3)
            losses.append(float(loss.detach()))
    assert losses[-1] < 0.05 * losses[0]


@pytest.mark.parametrize(
    ("configuration", "seed", "device", "message"),
    [
        (SMALL["M1"], -1, "cpu", "the seed is -1"),
        (SMALL["M1"], 11, "tpu", "no device 'tpu'; there are cpu, cuda, auto"),
    ],
)
def test_wrong_calls_are_refused(
    release: Path, tmp_path: Path, configuration: Configuration, seed: int, device: str, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        train_model(release, tmp_path, configuration, seed=seed, device=device)


def test_cuda_must_be_there(release: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(UsageError, match="no CUDA device is here"):
        train_model(release, tmp_path, SMALL["M1"], seed=11, device="cuda")
    assert train_model(release, tmp_path, SMALL["M1"], seed=11, device="auto").environment["device"] == "cpu"


def test_a_model_of_actions_needs_their_encoding(tmp_path: Path) -> None:
    bare = write_release(tmp_path / "release", make_frames(bare=True), bare=True)
    with pytest.raises(UsageError, match="declares no encoding of its action bank"):
        train_model(bare, tmp_path / "out", SMALL["M3"], seed=11)
    assert train_model(bare, tmp_path / "out", SMALL["M2"], seed=11).num_action_features == 0


def test_settings_of_torch_are_as_before(release: Path, tmp_path: Path) -> None:
    threads = torch.get_num_threads()
    train_model(release, tmp_path, SMALL["M1"], seed=11)
    assert torch.get_num_threads() == threads
    assert not torch.are_deterministic_algorithms_enabled()
