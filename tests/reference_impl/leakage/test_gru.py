"""The recurrent classifier: what it learns, that it repeats itself, and that it leaves torch as it was."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.validator.leakage.replays import changed, replay_inputs

from branchdrive.leakage.audit import SeenInputs, audit_of
from branchdrive.leakage.classifier import SequenceTask, Unavailable, sequence_classifier
from branchdrive.leakage.draw import KeptHere
from branchdrive.leakage.protocol import SEQUENCE_TESTS, AuditProtocol, BatteryProtocol, GateProtocol
from branchdrive.leakage.score import held_out_score

torch = pytest.importorskip("torch")
gru_module = pytest.importorskip("branchdrive_reference.leakage.gru")

SMALL = gru_module.GruClassifier(hidden=8, learning_rate=1e-2, max_epochs=8)


def task(offset: float = 0.0, *, seed: int = 0) -> SequenceTask:
    rng = np.random.default_rng(seed)

    def part(num_groups: int) -> NDArray[np.float64]:
        rows = rng.normal(size=(num_groups, 4, 16, 3))
        rows[:, :, 9:, 1] += offset * np.linspace(-1, 1, 4)[:, None]
        return rows

    return SequenceTask(part(48), part(16), part(16))


def p_log_likelihood(scores: NDArray[np.float64]) -> float:
    return held_out_score(scores, seed=1, num_permutations=999, num_resamples=50, atol=1e-9).p_log_likelihood


def test_it_finds_what_a_sequence_tells() -> None:
    found = SMALL(task(0.8), seed=1)
    assert p_log_likelihood(found.log_probability) == 0.001
    assert 1 <= found.best_epoch <= found.num_epochs <= 8


def test_it_finds_nothing_in_noise() -> None:
    assert p_log_likelihood(SMALL(task(), seed=1).log_probability) > 0.01


def test_scores_are_log_probabilities() -> None:
    scores = SMALL(task(), seed=1).log_probability
    assert scores.shape == (16, 4, 4)
    assert scores.dtype == np.float64
    np.testing.assert_allclose(np.exp(scores).sum(axis=2), 1.0)


def test_the_seed_decides() -> None:
    first, again, other = (SMALL(task(), seed=seed).log_probability for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_equal_rows_have_equal_scores() -> None:
    same = SequenceTask(*(np.repeat(part[:, :1], 4, axis=1) for part in task()))
    scores = SMALL(same, seed=1).log_probability
    assert held_out_score(scores, seed=1, num_permutations=9, num_resamples=9, atol=1e-9).identical


def test_it_stops_when_validation_does_not_improve() -> None:
    patient = gru_module.GruClassifier(hidden=4, learning_rate=0.05, max_epochs=50, patience=2)
    found = patient(task(), seed=1)
    assert found.num_epochs == found.best_epoch + 2 < 50


def test_torch_is_left_as_it_was() -> None:
    torch.manual_seed(5)
    before = torch.get_rng_state().clone()
    threads, deterministic = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    SMALL(task(), seed=1)
    assert torch.equal(torch.get_rng_state(), before)
    assert (torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()) == (threads, deterministic)


def test_its_settings_are_known_without_torch() -> None:
    code = (
        "import json, sys\n"
        "from branchdrive.leakage.classifier import sequence_classifier\n"
        "print(json.dumps([dict(sequence_classifier().settings), 'torch' in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [gru_module.gru.settings, False]
    assert gru_module.gru.settings["torch"] == str(torch.__version__)


def test_without_torch_it_is_missed_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, gru_module.__name__)
    assert sequence_classifier() == Unavailable("needs the package `torch`, which the extra `models` brings")


def test_the_audit_finds_it_and_runs_it() -> None:
    classifier = sequence_classifier()
    assert classifier == gru_module.gru
    inputs = replay_inputs(40, seed=1)
    ego = np.array(inputs.ego)
    ego[:, :, 8:, 3] += np.linspace(-1, 1, 5)[:, None]
    inputs = changed(inputs, ego=ego)
    document = audit_of(
        KeptHere(inputs),
        SeenInputs.of(inputs),
        seed=1,
        protocol=AuditProtocol(
            GateProtocol(num_permutations=9, num_frequencies=4, offsets_sd=()), BatteryProtocol(num_permutations=4_999)
        ),
        sequence_classifier=gru_module.GruClassifier(hidden=8, learning_rate=1e-2, max_epochs=15),
    )
    for way in document["battery"]["ways"]:
        found = {test["name"]: test["status"] for test in way["tests"] if test["name"] in SEQUENCE_TESTS}
        assert found == {"ego": "fail", "controls": "pass", "ego_controls": "fail"}
    assert document["protocol"]["sequence_classifier"]["torch"] == str(torch.__version__)
    assert document["not_run"] == []
