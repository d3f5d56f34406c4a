"""What the guards promise, and what they do not: texts that every report prints word for word.

The numbers are those of `calibration.ALPHA`, `calibration.DELTA` and `path.TOLERANCE_M`; with others, or where
`calibration.Calibration.refusal` says why nothing was judged, the texts do not hold.
"""

from __future__ import annotations

__all__ = ["GLOBAL_MARGIN", "GUARANTEE", "LEARN_THEN_TEST"]

GUARANTEE = (
    "Assume that the calibration route clusters and the cluster of a new group are exchangeable, and that predictor, "
    "risk scores, utility, tolerance and price grid were fixed before any calibration outcome was read. Then the "
    "probability, over the calibration data and a group drawn at random from the new cluster among those with every "
    "separation available, that the guarded selector takes an action of the fixed bank other than nominal whose "
    "recorded minimum separation is more than 0.25 m below the recorded nominal one is at most 0.05. This holds on "
    "average only: not for a given calibration set, scenario or action, and not given that the selector intervenes. "
    "It says nothing about collisions, about actions outside of the bank, about closed-loop driving, about groups "
    "without a recorded separation, or about another simulator or a road."
)
"""Guarantee of `calibration.conformal` with its limits."""

LEARN_THEN_TEST = (
    "Assume that the calibration route clusters are independent and distributed like the cluster of a new group, and "
    "that everything else was fixed as above. Then with probability at least 0.9 over calibration draws the rate of "
    "such selections in new clusters is at most 0.05. The other limits are the same."
)
"""Guarantee of `calibration.learn_then_test`, printed after `GUARANTEE`."""

GLOBAL_MARGIN = (
    "The global margin is an empirical quantile of its calibration groups, with the rank the paper uses. "
    "It comes without a finite-sample guarantee; its coverage figures describe the groups they were counted on."
)
"""What the paper's guard promises."""
