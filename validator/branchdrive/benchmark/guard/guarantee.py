"""What the guards promise, and what they do not: texts that a report prints word for word where they are claimed.

The numbers are those of `calibration.ALPHA`, `calibration.DELTA` and `path.TOLERANCE_M`; with others, or where
`calibration.Calibration.refusal` says why nothing was judged, the texts do not hold.
"""

from __future__ import annotations

__all__ = ["CONDITIONAL", "GLOBAL_MARGIN", "GUARANTEE", "LEARN_THEN_TEST"]

GUARANTEE = (
    "Assume that the calibration route clusters and the cluster of a new group are exchangeable, and that predictor, "
    "risk scores, utility, tolerance and price grid were fixed before any calibration outcome was read. Then the "
    "probability, over the calibration data and a group drawn at random from the new cluster among those in which "
    "every candidate has its separation and its utility, that the guarded selector takes an action of the fixed bank "
    "other than nominal whose recorded minimum separation is more than 0.25 m below the recorded nominal one is at "
    "most 0.05. This holds on average only: not for a given calibration set, scenario or action, and not given that "
    "the selector intervenes; given one calibration set the rate can exceed 0.05. Every profile is calibrated by "
    "itself, and a choice among profiles after their results is not covered. The guarantee says nothing about "
    "collisions, about actions outside of the bank, about closed-loop driving, about groups without a recorded "
    "separation or utility, or about another simulator or a road."
)
"""Guarantee of `calibration.conformal` with its limits."""

CONDITIONAL = (
    "The rate given one calibration set can exceed 0.05: in simulations with 48 to 65 calibration clusters it did for "
    "19 to 28 % of the calibration sets, with a mean of 0.033 to 0.039 over all of them."
)
"""What the average of `GUARANTEE` leaves open, printed after it.

Clusters of 1 to 7 groups, normal latent risks with a correlation of 0, 0.4 and 0.8 within clusters, 30 or 100 prices
along which the true rate of the envelope rises evenly from 0 to 0.2 or 0.5; 1,500 draws each.
"""

LEARN_THEN_TEST = (
    "Assume that the calibration route clusters are independent and distributed like the cluster of a new group, and "
    "that predictor, risk scores, utility, tolerance and price grid were fixed before any calibration outcome was "
    "read. Then with probability at least 0.9 over calibration draws the rate of such selections by learn then test in "
    "new clusters is at most 0.05. The other limits are the same."
)
"""Guarantee of `calibration.learn_then_test`, printed after `GUARANTEE`."""

GLOBAL_MARGIN = (
    "The global margin is an empirical quantile of its calibration groups, with the rank the paper uses. "
    "It comes without a finite-sample guarantee; its coverage figures describe the groups they were counted on."
)
"""What the paper's guard promises."""
