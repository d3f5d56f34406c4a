"""Tables of predictions: population, errors with intervals, every target, spread and shuffled inputs."""

from __future__ import annotations

from branchdrive.benchmark.table.comparison import comparisons
from branchdrive.benchmark.table.markdown import (
    BCA,
    BY_CLUSTERS,
    Document,
    Rows,
    ends_of,
    number,
    plain,
    spread_over_seeds,
    table,
)
from branchdrive.driving.target import TARGETS
from branchdrive.quality.text import PARTITION_TITLES

__all__ = ["prediction_tables"]

_MAIN = (
    ("macro_nmae", "Macro NMAE"),
    ("macro_nmae_sd", "Macro NMAE (sd)"),
    ("ade_m", "ADE, m"),
    ("fde_m", "FDE, m"),
    ("heading_mae_deg", "Heading, deg"),
    ("speed_mae_mps", "Speed, m/s"),
)
_KINDS = (
    ("nmae", "NMAE of targets"),
    ("nmae_sd", "MAE by training standard deviation"),
    ("mae", "MAE of targets, in their units"),
    ("rmse", "RMSE of targets, in their units"),
    ("spearman", "Spearman correlation, pooled"),
    ("bank_spearman", "Spearman correlation within banks"),
)
_INTERVALS = (("route clusters", BY_CLUSTERS), ("groups", ("low", "high")), ("groups, BCa", BCA))
_SYMBOLS = ", ".join(f"{target.symbol} is `{target.name}`" for target in TARGETS)


def prediction_tables(results: Document) -> list[list[str]]:
    """Sections of lines."""
    return [
        table("Population", results, *_population(results)),
        table("Prediction", results, *_main(results)),
        table("Prediction: intervals of 95 %", results, *_intervals(results)),
        *(table(title, results, *_of_targets(results, kind)) for kind, title in _KINDS),
        table("Comparisons of models", results, *comparisons(results["prediction"])),
        table("Spread of predictions over candidates", results, *_spread(results)),
        table("Shuffled inputs", results, *_shuffles(results)),
    ]


def _population(results: Document) -> tuple[list[str], Rows]:
    about = results["population"]
    names = [name for name in PARTITION_TITLES if name in about["groups"]]
    rows = [[PARTITION_TITLES[name], f"{about['groups'][name]:,}", f"{about['clusters'][name]:,}"] for name in names]
    return ["Partition", "Groups", "Route clusters"], rows


def _estimates(results: Document) -> dict[tuple[str, str], Document]:
    return {(found["model"], found["metric"]): found for found in results["prediction"]["estimates"]}


def _titles(results: Document) -> dict[str, str]:
    return {model["id"]: _title(model) for model in results["models"]}


def _title(model: Document) -> str:
    return f"{model['id']} {plain(model['title'])}" if model["declared"] else f"{model['id']} (not declared)"


def _main(results: Document) -> tuple[list[str], Rows]:
    found = _estimates(results)
    rows = []
    for model, title in _titles(results).items():
        values = [found[model, metric] for metric, _ in _MAIN]
        groups = min(value["num_groups"] for value in values)
        rows.append([title, *(spread_over_seeds(v["value"], v["seed_sd"]) for v in values), str(groups)])
    return ["Model", *(title for _, title in _MAIN), "N groups"], rows


def _intervals(results: Document) -> tuple[list[str], Rows, list[str], int]:
    found = _estimates(results)
    rows = [
        [title, kind, *(ends_of(found[model, metric]["interval"], *ends) for metric, _ in _MAIN)]
        for model, title in _titles(results).items()
        for kind, ends in _INTERVALS
    ]
    return ["Model", "Resampled", *(title for _, title in _MAIN)], rows, [], 2


def _of_targets(results: Document, kind: str) -> tuple[list[str], Rows, list[str]]:
    found = _estimates(results)
    rows = []
    for model, title in _titles(results).items():
        values = [found[model, f"{kind}.{target.name}"] for target in TARGETS]
        rows.append([title, *(spread_over_seeds(v["value"], v["seed_sd"]) for v in values)])
    has_unit = kind in ("mae", "rmse")
    header = ["Model", *(f"{t.symbol}, {t.unit}" if has_unit else t.symbol for t in TARGETS)]
    return header, rows, [f"{_SYMBOLS}."] if kind == _KINDS[0][0] else []


def _spread(results: Document) -> tuple[list[str], Rows, list[str]]:
    titles = _titles(results)
    rows = [
        [
            titles[found["model"]],
            number(found["sd_ratio"]),
            number(found["variance_ratio"]),
            str(found["num_ratios"]),
        ]
        for found in results["diagnostics"]["spread"]
    ]
    note = (
        "Spread over the bank as predicted, divided by that as recorded: at 1 candidates differ as they did, at 0 not "
        "at all. There is a ratio for each group and target in which candidates differ."
    )
    return ["Model", "Median sd ratio", "Median variance ratio", "Ratios"], rows, [note]


def _shuffles(results: Document) -> tuple[list[str], Rows, list[str], int]:
    titles = _titles(results)
    rows = [
        [
            titles[found["model"]],
            found["kind"],
            f"`{found['metric']}`",
            number(found["value"]),
            spread_over_seeds(found["shuffled"], found["shuffle_sd"]),
            number(found["increase"]),
            ends_of(found, *BY_CLUSTERS),
            str(found["num_shuffles"]),
        ]
        for found in results["diagnostics"]["shuffles"]
    ]
    note = "What follows ± is the standard deviation over shuffles, of means over seeds; intervals are of the increase."
    header = ["Model", "Input", "Metric", "As it is", "Shuffled", "Increase", "95 %, clusters", "Shuffles"]
    return header, rows, [note], 3
