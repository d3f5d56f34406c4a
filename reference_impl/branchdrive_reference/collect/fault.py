"""Faults that a collection can inject, each with a rate that its descriptor declares.

They are the failures that the paper reports of its own collection, and what a validator must find.
An attempt has one fault at most: the first of its own whose draw succeeds, in the order below.
Source: paper, "Research Questions and Experimental Protocol" (population table) and
"Collection Integrity, Replay Fidelity, and Leakage".
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from branchdrive_reference.rendering.fault import ImageFault
from branchdrive_reference.share_list import ShareList

__all__ = ["ATTEMPT_FAULTS", "DESCRIPTIONS", "FAILURES", "FAULT_RATES", "Fault"]


class Fault(StrEnum):
    """Name of a fault, as the descriptor has it."""

    PARTIAL = "partial"
    QUARANTINED = "quarantined"
    EARLY_BRANCH = "early_branch"
    LATE_BRANCH = "late_branch"
    WRONG_DURATION = "wrong_duration"
    TRUNCATED_LOG = "truncated_log"
    DROPPED_FRAME = "dropped_frame"
    UNRETRIED = "unretried"
    DUPLICATE = "duplicate"
    ABANDONED = "abandoned"
    SEED_DISAGREEMENT = "seed_disagreement"
    ONLINE_STEERING = "online_steering"


DESCRIPTIONS: Mapping[Fault, str] = {
    Fault.PARTIAL: "per attempt: the simulator dies, and the attempt is partial",
    Fault.QUARANTINED: "per attempt: it runs to its end, and the collector distrusts it",
    Fault.EARLY_BRANCH: "per intervention attempt: the treatment begins 1 to 10 ticks before the recorded branch",
    Fault.LATE_BRANCH: "per intervention attempt: the treatment begins 1 to 10 ticks after the recorded branch",
    Fault.WRONG_DURATION: "per intervention attempt: the treatment lasts 1 to 5 ticks more or less than recorded",
    Fault.TRUNCATED_LOG: "per intervention attempt: the recorded tables stop inside the treatment",
    Fault.DROPPED_FRAME: "per intervention attempt: one saved observation of the windows is missing",
    Fault.UNRETRIED: "per partial or quarantined attempt: it is not repeated; otherwise it is, up to the third",
    Fault.DUPLICATE: "per policy: its first complete attempt is executed once more",
    Fault.ABANDONED: "per group: the collection of the group stops before its bank is complete",
    Fault.SEED_DISAGREEMENT: "per group: one intervention is executed and recorded with another seed",
    Fault.ONLINE_STEERING: "per group: acceleration keeps the online expert's steering",
}
"""What a rate counts, and what the fault does."""

FAILURES = (Fault.PARTIAL, Fault.QUARANTINED)
"""Faults after which an attempt is not complete; they happen in every role."""

ATTEMPT_FAULTS = (
    *FAILURES,
    Fault.EARLY_BRANCH,
    Fault.LATE_BRANCH,
    Fault.WRONG_DURATION,
    Fault.TRUNCATED_LOG,
    Fault.DROPPED_FRAME,
)
"""Faults of one attempt, in the order in which they are drawn."""


FAULT_RATES = ShareList("--faults", (*Fault, *ImageFault), "rate", "is no fault", "NAME=RATE,... with the names")
"""The option that names faults, each with its rate."""
