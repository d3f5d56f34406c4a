"""How far outcomes move when nominal is merely repeated, and which selected differences go beyond that.

For target ``t`` with nominal outcome ``y_g`` and repeated outcomes ``y_gr`` of the training groups::

    n_g = max over repeats r of |y_gr - y_g|         tolerance = 95 % quantile of n_g, numpy method 'higher'
    rms = sqrt(mean over g of mean over r of (y_gr - y_g)^2)

A selected difference ``y_selected - y_nominal`` is beyond noise where its absolute value exceeds the tolerance by more
than 1e-9, which bounds one group. A mean of ``N`` selected differences, of which ``K`` are not nominal itself, has the
standard error ``rms sqrt(K) / N`` from repetition alone: a selected outcome is taken to move as much as a repeated
nominal one does, and by itself in every group.

A repeat whose separation is more than the guard's tolerance and 1e-9 m below that of nominal would be a violation if it
were a selection: its rate is the floor below which no rate of violations says anything about a selector.

A repeat that has the target where nominal has not, or lacks it where nominal has it, is counted and left out.

Source: this project's choice; the paper has no repeated nominal outcomes ("Conservative Calibration and Deployment
Boundary") and leaves materiality open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.driving.target import TARGETS, Targets
from branchdrive.driving.utility import TIE
from branchdrive.statistics.rounding import numbers

__all__ = [
    "QUANTILE", "OutcomeNoise", "RepeatLosses", "SelectedDifferences", "noise_of", "noise_record", "outcome_noise",
    "selected_differences", "worse_beyond",
]  # fmt: skip

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

QUANTILE = 0.95
"""Share of groups whose repeats stay within the tolerance."""

_LESS_IS_WORSE = np.array([target.name in ("min_ttc_s", "min_separation_m", "displacement_m") for target in TARGETS])


class RepeatLosses(NamedTuple):
    """How often a repeated nominal would be a violation.

    Attributes:
        num_groups: Groups in which nominal and a repeat have a separation.
        num_groups_losing: Those of them in which a repeat loses more than the guard's tolerance.
        num_repeats: Repeats with a separation, of groups whose nominal has one.
        num_repeats_losing: Those of them that lose more.
    """

    num_groups: int
    num_groups_losing: int
    num_repeats: int
    num_repeats_losing: int


class OutcomeNoise(NamedTuple):
    """Noise of every target, arrays ``[6]`` in the order of `target.TARGETS`.

    Attributes:
        tolerance: In the units of the targets; NaN where no group has a repeated value. 0 means that repeats are
            identical and that every difference is beyond noise.
        rms: Root mean square of the differences, as groups weigh the same; NaN as above.
        num_groups: Groups with a repeated value.
        num_one_sided: Groups in which only one of nominal and a repeat has the target.
        losses: Of separation.
        further_losses: The same at further tolerances, by the tolerance in metres.
    """

    tolerance: Array
    rms: Array
    num_groups: Counts
    num_one_sided: Counts
    losses: RepeatLosses
    further_losses: Mapping[float, RepeatLosses] = MappingProxyType({})


class SelectedDifferences(NamedTuple):
    """Differences of the chosen candidates against nominal.

    Attributes:
        difference: In the units of the targets ``[groups, 6]``; NaN where either side is unavailable.
        worse: Whether the difference exceeds the tolerance, for the worse ``[groups, 6]``; false where it is NaN.
        better: The same for the better.
        standard_error: What repetition alone gives the mean of the differences ``[6]``; NaN where it is unknown.
    """

    difference: Array
    worse: Mask
    better: Mask
    standard_error: Array

    @property
    def num_compared(self) -> Counts:
        """Groups that have a difference ``[6]``."""
        return np.asarray(np.isfinite(self.difference).sum(axis=0))


def outcome_noise(
    nominal: Targets,
    repeats: Targets,
    group_of: NDArray[np.intp],
    *,
    tolerance_m: float,
    quantile: float = QUANTILE,
    further_m: Sequence[float] = (),
) -> OutcomeNoise:
    """Noise from training groups.

    Args:
        nominal: Outcomes of the nominal rollouts ``[groups, 6]``.
        repeats: Outcomes of their replays ``[repeats, 6]``.
        group_of: Group of every replay ``[repeats]``.
        tolerance_m: Of a violation, metres.
        quantile: In ``(0, 1]``.
        further_m: Further tolerances.

    Raises:
        ValueError: Shapes do not match.
    """
    if nominal.values.ndim != 2 or repeats.values.shape != (len(group_of), nominal.values.shape[1]):
        raise ValueError(
            f"nominal {list(nominal.values.shape)}, repeats {list(repeats.values.shape)} and their {len(group_of)} "
            "groups do not match: [groups, targets], [repeats, targets] and [repeats]"
        )
    has_nominal = nominal.available[group_of]
    both = has_nominal & repeats.available
    moved = np.where(both, repeats.values, 0.0) - np.where(both, nominal.values[group_of], 0.0)
    # In ascending order the sums of squares do not depend on the order of the repeats.
    order = np.lexsort((*np.abs(moved).T, group_of))
    group_of, both, has_nominal, moved = group_of[order], both[order], has_nominal[order], moved[order]
    available = repeats.available[order]
    num_of, num_one_sided = _sums(both, group_of, nominal), _sums(has_nominal ^ available, group_of, nominal)
    most, squares = np.zeros(nominal.values.shape), _sums(moved**2, group_of, nominal)
    np.maximum.at(most, group_of, np.abs(moved))
    has = num_of > 0
    tolerance, rms = np.full((2, has.shape[1]), np.nan)
    for target in np.flatnonzero(has.any(axis=0)):
        of_target = has[:, target]
        tolerance[target] = np.quantile(most[of_target, target], quantile, method="higher")
        rms[target] = np.sqrt(np.sort(squares[of_target, target] / num_of[of_target, target]).mean())

    def losses(tolerance_m: float) -> RepeatLosses:
        losing = both[:, SEPARATION] & (moved[:, SEPARATION] < -tolerance_m - TIE)
        return RepeatLosses(
            int(has[:, SEPARATION].sum()),
            len(np.unique(group_of[losing])),
            int(both[:, SEPARATION].sum()),
            int(losing.sum()),
        )

    further = {further: losses(further) for further in further_m}
    num_sided = (num_one_sided > 0).sum(axis=0)
    return OutcomeNoise(tolerance, rms, has.sum(axis=0), num_sided, losses(tolerance_m), further)


def _sums(values: NDArray[np.generic], group_of: NDArray[np.intp], nominal: Targets) -> Array:
    """Sums over the repeats of every group ``[groups, 6]``."""
    found = np.zeros(nominal.values.shape)
    np.add.at(found, group_of, values)
    return found


def selected_differences(
    outcomes: Targets, selection: NDArray[np.intp], noise: OutcomeNoise, *, nominal: int
) -> SelectedDifferences:
    """Differences of a selection ``[groups]`` on outcomes ``[groups, candidates, 6]``."""
    chosen = outcomes.values[np.arange(len(selection)), selection]
    difference = chosen - outcomes.values[:, nominal]
    there = np.isfinite(difference)
    moved, num_compared = (there & (selection != nominal)[:, None]).sum(axis=0), there.sum(axis=0)
    error = np.divide(noise.rms * np.sqrt(moved), num_compared, out=np.full(len(moved), np.nan), where=num_compared > 0)
    worse, better = (worse_beyond(sign * difference, noise.tolerance) for sign in (1, -1))
    return SelectedDifferences(difference, worse, better, error)


def worse_beyond(difference: Array, tolerance: Array) -> Mask:
    """Whether differences ``[..., 6]`` go beyond the tolerance ``[6]`` for the worse; false where either is NaN."""
    return np.asarray((np.abs(difference) > tolerance + TIE) & ((difference < 0) == _LESS_IS_WORSE))


def noise_record(noise: OutcomeNoise) -> dict[str, Any]:
    """Noise as JSON data, as the ranking lock has them."""
    return {
        "tolerance": numbers(noise.tolerance.tolist()),
        "rms": numbers(noise.rms.tolist()),
        "num_groups": noise.num_groups.tolist(),
        "num_one_sided": noise.num_one_sided.tolist(),
        "losses": noise.losses._asdict(),
        **(
            {
                "further_losses": [
                    {"tolerance_m": tolerance_m, **losses._asdict()}
                    for tolerance_m, losses in noise.further_losses.items()
                ]
            }
            if noise.further_losses
            else {}
        ),
    }


def noise_of(record: Mapping[str, Any]) -> OutcomeNoise:
    """Noise of a record."""
    tolerance, rms = (
        np.array([np.nan if value is None else float(value) for value in record[name]]) for name in ("tolerance", "rms")
    )
    num_groups, num_one_sided = (np.array(record[name], np.int64) for name in ("num_groups", "num_one_sided"))
    further = {each["tolerance_m"]: _losses_of(each) for each in record.get("further_losses", ())}
    return OutcomeNoise(tolerance, rms, num_groups, num_one_sided, _losses_of(record["losses"]), further)


def _losses_of(record: Mapping[str, Any]) -> RepeatLosses:
    return RepeatLosses(*(int(record[name]) for name in RepeatLosses._fields))
