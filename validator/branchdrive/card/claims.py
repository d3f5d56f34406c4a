"""What a release is made for, and what must not be concluded from it: the same in every dataset card.

Source: paper, "Scope" and "Intended Use"; spec/10-layers.md#card.
"""

from __future__ import annotations

from branchdrive.contract.timing import ACTIVE_TICKS, TICK_S

__all__ = ["EXCLUDED_CLAIMS", "INTENDED_USES"]

INTENDED_USES = (
    "predict short-horizon outcomes and ego trajectories of candidate actions from a shared history",
    "compare and rank the candidates of the bank offline, each with its own observed outcome",
    "validate world models, estimate uncertainty, and analyse where decision models fail",
    "study how recordings are made: the raw layer keeps retries, partial attempts and what was excluded",
)
"""What the data are made for, each after "use it to"."""

EXCLUDED_CLAIMS = (
    (
        "No closed-loop claim.",
        "Recorded candidates are compared offline. Nothing here shows that a policy drives better or more safely when "
        "it acts on its own predictions, certifies a vehicle, or justifies use on a road.",
    ),
    (
        "The best candidate is not the best action.",
        "The oracle of the bank is the best of the recorded candidates. A planner that makes its own trajectories may "
        "beat all of them.",
    ),
    (
        "Trajectories are not independent samples.",
        "All candidates of a group share one history. The group is the statistical unit: report numbers of groups, and "
        "resample, permute and split whole groups.",
    ),
    (
        "No binary safety labels.",
        "A threshold on time to collision or separation is no validated label of safe and unsafe. Such labels need a "
        "protocol of their own, with its own validation.",
    ),
    (
        "An unavailable time to collision is not a safe one.",
        "It means that no relevant actor was closing. Keep the mask; do not fill in a large number.",
    ),
    (
        "Matched replays are not restored states.",
        "Branches are replayed from the start of the route, and what then differs is measured and bounded, not absent. "
        "Differences between candidates are comparisons of matched runs, not exact causal effects.",
    ),
    (
        "Privileged inputs are not sensors.",
        "Surrounding actors, semantic maps, the expert's own signals and the reason why a decision point was chosen "
        "are known to a simulator only. Never present them as what a vehicle perceives.",
    ),
    (
        "One simulator's traffic.",
        "Sensing, dynamics and the behaviour of others are those of one simulator and the routes, towns and scenario "
        "types that it was run on. Transfer to others, or to real roads, is not shown.",
    ),
    (
        "Decision points were chosen in hindsight.",
        "A group exists where the expert's own future shows a manoeuvre. Results hold for such moments, not for "
        "driving in general.",
    ),
    (
        "Actions are whole manoeuvres.",
        "Families differ in steering, throttle and brake together. A difference between them is no effect of a single "
        "actuator. Describe a candidate by family, magnitude, duration and control semantics, not by its index.",
    ),
    (
        f"The horizon is {ACTIVE_TICKS * TICK_S:g} s.",
        "Then the expert recovers. What happens later depends on the recovery, and actions that pay off late look "
        "worse than they are.",
    ),
    (
        "No support for unrestricted reinforcement learning.",
        "Each decision point has a few actions, no arbitrary ones, and there are no transitions between such points.",
    ),
    (
        "No leakage found is not no leakage.",
        "The audit says which differences its tests could have found, at the effect stated above.",
    ),
    (
        "A test partition serves once.",
        "Every further choice made after looking at it needs new groups on other routes.",
    ),
)
"""Claims that the data do not support, each with its reason."""
