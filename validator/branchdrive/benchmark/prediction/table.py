"""Tables of predictions: population, errors with intervals, every target, spread and shuffled inputs."""

from __future__ import annotations

from collections.abc import Mapping

from branchdrive.benchmark.cell import BCA, BY_CLUSTERS, Document, ends_of, number, spread_over_seeds
from branchdrive.benchmark.prediction.comparison import comparison_table
from branchdrive.benchmark.prediction.description import description_tables, parameter_texts
from branchdrive.benchmark.prediction.metric.metric import HEADLINES, METRICS_OF_TARGETS
from branchdrive.contract.metric import DeclaredMetric
from branchdrive.driving.target import TARGETS
from branchdrive.quality.text import PARTITION_TITLES
from branchdrive.text.table import Column, Passage, Table

__all__ = ["headline_tables", "prediction_tables"]

_INTERVALS = (("route clusters", BY_CLUSTERS), ("groups", ("low", "high")), ("groups, BCa", BCA))
_DAGGER = "†"
_PRIVILEGED = (
    f"{_DAGGER} reads what no sensor of the vehicle tells, and is compared with nothing but what families declare: it "
    "shows how much a context can be worth, not what a vehicle reaches."
)
_SYMBOLS = ", ".join(f"{target.symbol} is `{target.name}`" for target in TARGETS)


def prediction_tables(results: Document) -> list[Table | Passage]:
    """Population, errors, comparisons and diagnostics."""
    return [
        _population(results),
        *description_tables(results),
        *headline_tables(results),
        _intervals(results),
        *(_of_targets(results, metric) for metric in METRICS_OF_TARGETS),
        comparison_table("Comparisons of models", results["prediction"]),
        _spread(results),
        _shuffles(results),
    ]


def _population(results: Document) -> Table:
    about = results["population"]
    names = [name for name in PARTITION_TITLES if name in about["groups"]]
    rows = [[PARTITION_TITLES[name], f"{about['groups'][name]:,}", f"{about['clusters'][name]:,}"] for name in names]
    columns = [Column.name("Partition"), Column("Groups"), Column("Route clusters")]
    return Table("Population", columns, rows)


def _estimates(results: Document) -> dict[tuple[str, str], Document]:
    return {(found["model"], found["metric"]): found for found in results["prediction"]["estimates"]}


def _titles(results: Document) -> dict[str, str]:
    return {
        model["id"]: f"{model['id']}{_DAGGER if _is_apart(model) else ''} "
        f"{model['title'] if model['declared'] else '(not declared)'}"
        for model in results["models"]
    }


def _is_apart(model: Document) -> bool:
    return "reported_apart" in model


def headline_tables(results: Document) -> list[Table]:
    """The paper's table; models that are reported apart have one of their own behind it."""
    apart = {model["id"] for model in results["models"] if _is_apart(model)}
    titles = _titles(results)
    judged = {model: title for model, title in titles.items() if model not in apart}
    tables = [_headline_table(results, "Prediction", judged)]
    if apart:
        alone = {model: titles[model] for model in titles if model in apart}
        tables.append(_headline_table(results, "Prediction, privileged", alone, _PRIVILEGED))
    return tables


def _headline_table(results: Document, heading: str, titles: Mapping[str, str], *notes: str) -> Table:
    found, sizes = _estimates(results), parameter_texts(results)
    rows = []
    for model, title in titles.items():
        values = [found[model, metric.name] for metric in HEADLINES]
        groups = min(value["num_groups"] for value in values)
        size = [] if sizes is None else [sizes[model]]
        rows.append([title, *size, *(spread_over_seeds(v["value"], v["seed_sd"]) for v in values), str(groups)])
    params = [] if sizes is None else [Column("Params, M")]
    columns = [Column.name("Model"), *params, *(Column(metric.heading) for metric in HEADLINES), Column("N groups")]
    return Table(heading, columns, rows, notes)


def _intervals(results: Document) -> Table:
    found = _estimates(results)
    rows = [
        [title, kind, *(ends_of(found[model, metric.name]["interval"], *ends) for metric in HEADLINES)]
        for model, title in _titles(results).items()
        for kind, ends in _INTERVALS
    ]
    columns = [Column.name("Model"), Column.name("Resampled"), *(Column(metric.heading) for metric in HEADLINES)]
    return Table("Prediction: intervals of 95 %", columns, rows, has_intervals=True)


def _of_targets(results: Document, metric: DeclaredMetric) -> Table:
    found = _estimates(results)
    rows = []
    for model, title in _titles(results).items():
        values = [found[model, name] for name in metric.names(target.name for target in TARGETS)]
        rows.append([title, *(spread_over_seeds(v["value"], v["seed_sd"]) for v in values)])
    headings = [f"{t.symbol}, {t.unit}" if metric.unit == "target" else t.symbol for t in TARGETS]
    notes = [f"{_SYMBOLS}."] if metric is METRICS_OF_TARGETS[0] else []
    return Table(metric.title, [Column.name("Model"), *map(Column, headings)], rows, notes)


def _spread(results: Document) -> Table:
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
    columns = [Column.name("Model"), Column("Median sd ratio"), Column("Median variance ratio"), Column("Ratios")]
    return Table("Spread of predictions over candidates", columns, rows, [note])


def _shuffles(results: Document) -> Table:
    titles = _titles(results)
    rows = [
        [
            titles[found["model"]],
            found["kind"],
            found["metric"],
            number(found["value"]),
            spread_over_seeds(found["shuffled"], found["shuffle_sd"]),
            number(found["increase"]),
            ends_of(found, *BY_CLUSTERS),
            str(found["num_shuffles"]),
        ]
        for found in results["diagnostics"]["shuffles"]
    ]
    note = "What follows ± is the standard deviation over shuffles, of means over seeds; intervals are of the increase."
    columns = [
        Column.name("Model"),
        Column.name("Input"),
        Column.name("Metric", is_code=True),
        *map(Column, ("As it is", "Shuffled", "Increase", "95 %, clusters", "Shuffles")),
    ]
    return Table("Shuffled inputs", columns, rows, [note], has_intervals=True)
