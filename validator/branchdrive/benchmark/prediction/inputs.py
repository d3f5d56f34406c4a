"""What results are computed from, with what all their sections take from it, each computed once.

Source: spec/14-benchmark.md#results.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from branchdrive.benchmark.prediction.data import BenchmarkData, Part
from branchdrive.benchmark.prediction.metric.outcome import Predictions
from branchdrive.benchmark.prediction.metric.scale import Scale, target_scale
from branchdrive.benchmark.prediction.prediction_set import PredictionSet
from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol
from branchdrive.driving.utility import Scale as UtilityScale
from branchdrive.driving.utility import fit_scale
from branchdrive.statistics.bootstrap import Design, design

__all__ = ["ResultInputs", "utility_scale"]


def utility_scale(protocol: BenchmarkProtocol, data: BenchmarkData) -> UtilityScale:
    """Quantiles of the targets on the partition that models are fitted on.

    Raises:
        DatasetError: The partition has no group.
    """
    return fit_scale(data.part(protocol.partitions.fit).targets)


@dataclass(frozen=True, eq=False)
class ResultInputs:
    """Protocol, model layer and predictions, and what follows from them.

    Attributes:
        protocol: What is compared, and how.
        data: The model layer.
        predictions: Of declared models and of others.
        fitted: The partition that models are fitted on.
        scale: Scales of its targets.
        utility_scale: Quantiles of its targets.
        reported: The partition that results are about.
        judged: Predictions of it by model and seed, of the models that predict it.
        resampling: Resamples of its groups and of their route clusters.
        seed: Of intervals and tests.
    """

    protocol: BenchmarkProtocol
    data: BenchmarkData
    predictions: PredictionSet
    fitted: Part
    scale: Scale
    utility_scale: UtilityScale
    reported: Part
    judged: Mapping[str, Mapping[int, Predictions]]
    resampling: Design
    seed: int

    @classmethod
    def of(cls, protocol: BenchmarkProtocol, data: BenchmarkData, predictions: PredictionSet) -> ResultInputs:
        """Inputs of the results of a protocol.

        Raises:
            DatasetError: The model layer has no group in the partition that is fitted on or reported.
        """
        partitions, seed = protocol.partitions, int(protocol.statistics.seed)
        fitted = data.part(partitions.fit)
        scale = target_scale(fitted.outcomes.scalars, fitted.outcomes.available)
        quantiles = utility_scale(protocol, data)
        reported = data.part(partitions.report)
        return cls(
            protocol=protocol,
            data=data,
            predictions=predictions,
            fitted=fitted,
            scale=scale,
            utility_scale=quantiles,
            reported=reported,
            judged=predictions.of(partitions.report),
            resampling=design(reported.clusters, seed=seed, num_resamples=int(protocol.statistics.resamples)),
            seed=seed,
        )

    def __repr__(self) -> str:
        return f"ResultInputs({self.protocol.name!r}, {self.data!r}, {self.predictions!r})"
