"""Defects and limits of images against those of the nominal, where replays are exact."""

from __future__ import annotations

from tests.synthetic import BRANCH_TICK, STRIDE
from tests.validator.engine.rules.case import BRAKE, REPLAY, boundary, mutant
from tests.validator.engine.rules.cases.media import replace_image, unseen
from tests.validator.engine.rules.cases.replays import repeat_exactly
from tests.validator.engine.rules.draft import Draft


def _exact(d: Draft) -> None:
    """Let every replay repeat the drive of its nominal, and nominal replays have its images."""
    repeat_exactly(d)
    for group in ("g0", "g1", "g2"):
        for attempt in (1, 2):
            replay = f"{group}.nominal_replay.a{attempt}"
            d.drop("frames", rollout_id=replay)
            d.duplicate("frames", {"rollout_id": replay}, rollout_id=f"{group}.nominal.a1")


# BD-RPN-004


@mutant("BD-RPN-004", base="media", at={"rollout_id": BRAKE, "tick": BRANCH_TICK, "camera": "front"})
def image_before_the_branch_differs(d: Draft) -> None:
    _exact(d)
    replace_image(d, unseen(), rollout_id=BRAKE, camera="front", tick=BRANCH_TICK)


@boundary("BD-RPN-004", base="media")
def image_after_the_branch_differs(d: Draft) -> None:
    _exact(d)
    replace_image(d, unseen(), rollout_id=BRAKE, camera="front", tick=BRANCH_TICK + STRIDE)


# BD-RPN-006


@mutant("BD-RPN-006", base="media", at={"rollout_id": REPLAY, "tick": BRANCH_TICK + STRIDE, "camera": "front"})
def image_of_a_replay_differs(d: Draft) -> None:
    _exact(d)
    replace_image(d, unseen(), rollout_id=REPLAY, camera="front", tick=BRANCH_TICK + STRIDE)


@mutant("BD-RPN-006", base="media", at={"rollout_id": REPLAY, "tick": BRANCH_TICK + STRIDE})
def images_that_a_replay_and_an_intervention_have_exchanged(d: Draft) -> None:
    _exact(d)
    d.set("frames", "rollout_id", lambda name: BRAKE if name == REPLAY else REPLAY, rollout_id=[REPLAY, BRAKE])


@boundary("BD-RPN-006", base="media")
def images_of_exact_replays(d: Draft) -> None:
    _exact(d)
