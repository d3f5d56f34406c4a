"""Results as Markdown, `TABLES.md`: a pure function of the document `results.json`, in the layout of the paper.

Every table carries the warnings of the results below its title, so that none can be quoted without them. Tables
print the number of groups, never of trajectories.

Source: paper, tables of V and VI; spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from branchdrive.derive.benchmark.promise import UNGUARDED, noise_floor, promises
from branchdrive.derive.layer.wording import PARTITION_TITLES
from branchdrive.derive.metric.sign_flip import p_text
from branchdrive.derive.ranking.ranking import SEPARATION
from branchdrive.derive.target import TARGETS

__all__ = ["JUDGED_BY_CLUSTERS", "render_tables"]

Document = Mapping[str, Any]
Rows = list[list[str]]

JUDGED_BY_CLUSTERS = (
    "Claims are judged by route clusters: groups of one cluster are alike, so that tests and intervals by groups are "
    "too sure of themselves. Those by groups stand for parity with the paper."
)
"""Below every table of comparisons."""

_NONE = "-"
_BY_CLUSTERS = ("cluster_low", "cluster_high")
_BCA = ("bca_low", "bca_high")
_INTERVALS = (("route clusters", _BY_CLUSTERS), ("groups", ("low", "high")), ("groups, BCa", _BCA))
_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;"})
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
_FIGURES = (
    ("coverage", "Coverage"),
    ("violation", "Violation"),
    ("violation_of_clusters", "Violation, clusters"),
    ("violation_of_interventions", "Violation, interventions"),
    ("intervention", "Intervention"),
    ("gain", "Gain"),
    ("retained_gain", "Retained gain"),
    ("separation_difference_m", "Separation, m"),
)


def render_tables(results: Document) -> str:
    """The tables as Markdown.

    Args:
        results: Document ``results.json``, which conforms to its schema.
    """
    protocol = results["protocol"]
    head = [
        "# Benchmark results",
        "",
        f"Protocol `{protocol['name']}` {protocol['version']}, digest `{protocol['digest']}`.",
        "Values are means over seeds, and what follows ± is their standard deviation over seeds unless a table says "
        "otherwise. Intervals of 95 % resample whole route clusters; those that resample groups stand beside them.",
    ]
    sections = [
        _table("Population", results, *_population(results)),
        _table("Prediction", results, *_main(results)),
        _table("Prediction: intervals of 95 %", results, *_intervals(results)),
        *(_table(title, results, *_of_targets(results, kind)) for kind, title in _KINDS),
        _table("Comparisons of models", results, *_comparisons(results["prediction"])),
        _table("Spread of predictions over candidates", results, *_spread(results)),
        _table("Shuffled inputs", results, *_shuffles(results)),
        *_ranking(results),
        *_guard(results),
        *_noise(results),
    ]
    return "\n\n".join("\n".join(section) for section in (head, *sections)) + "\n"


def _table(
    title: str, results: Document, header: Sequence[str], rows: Rows, notes: Sequence[str] = (), left: int = 1
) -> list[str]:
    """A titled table with the warnings of the results; the first `left` columns are texts."""
    lines = [f"## {title}", ""]
    for warning in results["warnings"]:
        lines += [f"> **Warning.** {_plain(warning)}", ""]
    rule = ["---"] * left + ["--:"] * (len(header) - left)
    lines += [_line(header), _line(rule), *(_line(row) for row in rows)]
    return [*lines, *(line for note in notes for line in ("", note))]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(text: str) -> str:
    """Text of others, which the schema keeps on one line, without a cell or a tag of its own."""
    return text.translate(_ESCAPED)


def _number(value: float | None, digits: int = 3) -> str:
    return _NONE if value is None else f"{value:.{digits}f}"


def _spread_over_seeds(value: float | None, seed_sd: float | None) -> str:
    return _number(value) if seed_sd is None or value is None else f"{value:.3f} ± {seed_sd:.3f}"


def _ends(interval: Document, low: str = "low", high: str = "high") -> str:
    if interval[low] is None or interval[high] is None:
        return _NONE
    return f"[{interval[low]:.3f}, {interval[high]:.3f}]"


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
    return f"{model['id']} {_plain(model['title'])}" if model["declared"] else f"{model['id']} (not declared)"


def _main(results: Document) -> tuple[list[str], Rows]:
    found = _estimates(results)
    rows = []
    for model, title in _titles(results).items():
        values = [found[model, metric] for metric, _ in _MAIN]
        groups = min(value["num_groups"] for value in values)
        rows.append([title, *(_spread_over_seeds(v["value"], v["seed_sd"]) for v in values), str(groups)])
    return ["Model", *(title for _, title in _MAIN), "N groups"], rows


def _intervals(results: Document) -> tuple[list[str], Rows, list[str], int]:
    found = _estimates(results)
    rows = [
        [title, kind, *(_ends(found[model, metric]["interval"], *ends) for metric, _ in _MAIN)]
        for model, title in _titles(results).items()
        for kind, ends in _INTERVALS
    ]
    return ["Model", "Resampled", *(title for _, title in _MAIN)], rows, [], 2


def _of_targets(results: Document, kind: str) -> tuple[list[str], Rows]:
    found = _estimates(results)
    rows = []
    for model, title in _titles(results).items():
        values = [found[model, f"{kind}.{target.name}"] for target in TARGETS]
        rows.append([title, *(_spread_over_seeds(v["value"], v["seed_sd"]) for v in values)])
    has_unit = kind in ("mae", "rmse")
    return ["Model", *(f"{t.symbol}, {t.unit}" if has_unit else t.symbol for t in TARGETS)], rows


def _comparisons(section: Document) -> tuple[list[str], Rows, list[str], int]:
    """Two rows for each comparison: by route clusters, and by groups."""
    families = section["families"]
    adjusted = {family["name"]: {m["name"]: m for m in family["members"]} for family in families}
    rows = []
    for found in section["comparisons"]:
        members = [adjusted[family["name"]].get(found["name"]) for family in families]
        about = [f"`{found['name']}`", _number(found["difference"], 4)]
        rows += [
            [
                *about,
                "route clusters",
                str(found["num_clusters"]),
                _ends(found["interval"], *_BY_CLUSTERS),
                _NONE,
                p_text(found["p_clusters"], found["is_bound_clusters"]),
                *(_NONE if m is None else p_text(m["p_holm_clusters"], m["is_bound_clusters"]) for m in members),
                _NONE,
                _number(found["intra_cluster_correlation"], 2),
            ],
            [
                *about,
                "groups",
                str(found["num_groups"]),
                _ends(found["interval"]),
                _ends(found["interval"], *_BCA),
                p_text(found["p"], found["is_bound"]),
                *(_NONE if m is None else p_text(m["p_holm"], m["is_bound"]) for m in members),
                p_text(found["studentised_p"], found["is_bound_studentised"]),
                _NONE,
            ],
        ]
    header = ["Comparison", "Difference", "By", "N", "Percentile", "BCa", "p"]
    header += [*(f"p Holm, {f['name']}" for f in families), "p studentised", "Correlation within clusters"]
    notes = [JUDGED_BY_CLUSTERS] if rows else []
    notes += [
        f"Family `{family['name']}`: {family['num_evaluated']} of {family['num_declared']} declared tests were "
        "evaluated; the others count with p = 1, so that adjusted p-values are upper bounds."
        for family in families
        if family["num_evaluated"] < family["num_declared"]
    ]
    return header, rows, notes, 3


def _spread(results: Document) -> tuple[list[str], Rows]:
    titles = _titles(results)
    rows = [
        [
            titles[found["model"]],
            _number(found["sd_ratio"]),
            _number(found["variance_ratio"]),
            str(found["num_ratios"]),
        ]
        for found in results["diagnostics"]["spread"]
    ]
    return ["Model", "Median sd ratio", "Median variance ratio", "Ratios"], rows


def _shuffles(results: Document) -> tuple[list[str], Rows, list[str], int]:
    titles = _titles(results)
    rows = [
        [
            titles[found["model"]],
            found["kind"],
            f"`{found['metric']}`",
            _number(found["value"]),
            _spread_over_seeds(found["shuffled"], found["shuffle_sd"]),
            _number(found["increase"]),
            _ends(found, *_BY_CLUSTERS),
            str(found["num_shuffles"]),
        ]
        for found in results["diagnostics"]["shuffles"]
    ]
    note = "What follows ± is the standard deviation over shuffles, of means over seeds; intervals are of the increase."
    header = ["Model", "Input", "Metric", "As it is", "Shuffled", "Increase", "95 %, clusters", "Shuffles"]
    return header, rows, [note], 3


def _ranking(results: Document) -> list[list[str]]:
    ranking = results["ranking"]
    sections = [
        _table(f"Ranking, profile {profile['profile']}", results, *_profile(profile)) for profile in ranking["profiles"]
    ]
    sections += [
        [f"## Ranking, profile {out['profile']}", "", f"Not judged: {_plain(out['reason'])}."]
        for out in ranking["left_out"]
    ]
    return [*sections, _table("Comparisons of selectors", results, *_comparisons(ranking))]


def _profile(profile: Document) -> tuple[list[str], Rows, list[str]]:
    rows = [
        [
            entry["selector"],
            _spread_over_seeds(entry["value"], entry["seed_sd"]["value"]),
            _ends(entry["intervals"]["value"], *_BY_CLUSTERS),
            f"{entry['difference']:+.3f}",
            _spread_over_seeds(entry["regret"], entry["seed_sd"]["regret"]),
            _number(entry["concordance"]),
            _number(entry["ndcg"]),
            _number(entry["top_1"]),
            _number(entry["agreement"]),
            _number(entry["captured"]),
            " to ".join(str(n) for n in sorted({min(entry["num_actions"]), max(entry["num_actions"])})),
            _gate(entry["gate"]),
        ]
        for entry in profile["entries"]
    ]
    header = [
        "Selector", "Value", "95 %, clusters", "To nominal", "Regret", "Concordance", "NDCG", "Top-1", "Seed agreement",
        "Captured", "Actions", "Non-worsening",
    ]  # fmt: skip
    fixed = "there is no fixed brake" if profile["fixed_brake"] is None else f"fixed brake `{profile['fixed_brake']}`"
    note = (
        f"N = {profile['num_ranked']} groups; {profile['num_without_separation']} left for want of a separation, "
        f"{profile['num_without_other']} for want of another target; {profile['num_without_range']} without any range. "
        f"ActionPrior takes `{profile['action_prior']}`, {fixed}. The interval of the non-worsening gate resamples "
        "route clusters."
    )
    return header, rows, [note]


def _gate(gate: Document) -> str:
    ends = "" if gate["low"] is None else f" {_ends(gate)}"
    return f"{'pass' if gate['passed'] else 'fail'} ({gate['mean_m']:+.3f} m{ends})"


def _guard(results: Document) -> list[list[str]]:
    guard = results["guard"]
    if not guard["profiles"]:
        return [["## Guard", "", f"Not judged: {_plain(guard['reason'])}"]]
    sections = [
        _table(f"Guard, profile {p['profile']}", results, *_guard_profile(p, results)) for p in guard["profiles"]
    ]
    promise = ["## What the guards promise", *(line for text in promises(results) for line in ("", text))]
    return [*sections, promise]


def _guard_profile(profile: Document, results: Document) -> tuple[list[str], Rows, list[str]]:
    rows = []
    for selection in profile["selections"]:
        figures = [selection["figures"][name] for name, _ in _FIGURES]
        cells = [
            _NONE if found["value"] is None else f"{_number(found['value'])} {_ends(found)}".removesuffix(f" {_NONE}")
            for found in figures
        ]
        rows.append([selection["selection"], *cells, str(selection["num_actions"])])
    margin = profile["global_margin"]
    test = margin["test"]
    notes = [
        f"N = {profile['num_groups']} groups. Global margin {margin['margin_m']:.3f} m, order statistic "
        f"{margin['rank']} of {margin['num_groups']}; on test it covers {test['covered_candidates']:.3f} of candidates "
        f"and {test['covered_groups']:.3f} of groups, and accepts {test['acceptance']:.3f} of interventions."
    ]
    if test["vacuous"]:
        notes.append("The global margin is vacuous: it accepts no intervention in any group.")
    for name, title in (("conformal", "Selection-path conformal"), ("learn_then_test", "Learn then test")):
        found = profile[name]
        price = "nominal alone" if found["price"] is None else f"price {found['price']:.4g}"
        refused = "" if found["refusal"] is None else f" Not judged: {_plain(found['refusal'])}."
        size = f"{found['num_groups']} groups in {found['num_clusters']} clusters"
        notes.append(f"{title}: {price}, calibrated on {size}.{refused}")
    notes.append(UNGUARDED)
    if (floor := noise_floor(results)) is not None:
        notes.append(floor)
    return ["Selection", *(title for _, title in _FIGURES), "Actions"], rows, notes


def _noise(results: Document) -> list[list[str]]:
    noise = results["noise"]
    if noise is None:
        return []
    rows = [
        [f"{t.symbol}, {t.unit}", _number(noise["tolerance"][i], 4), _number(noise["rms"][i], 4),
         str(noise["num_groups"][i])]
        for i, t in enumerate(TARGETS)
    ]  # fmt: skip
    header = ["Target", "Tolerance", "Root mean square", "N groups, training"]
    floor = noise_floor(results)
    sections = [_table("Noise of outcomes", results, header, rows, [] if floor is None else [floor])]
    selections = [
        (profile["profile"], selection)
        for profile in results["guard"]["profiles"]
        for selection in profile["selections"]
        if selection["beyond_noise"] is not None
    ]
    if selections:
        counted = [
            [profile, found["selection"], *_beyond(found["beyond_noise"]), _separation(found)]
            for profile, found in selections
        ]
        header = ["Profile", "Selection", *(target.symbol for target in TARGETS), "Mean D_min, m"]
        note = (
            "Groups whose selected difference to nominal exceeds the tolerance, for the worse and for the better, of "
            "those that have one. The tolerance is that of one group; the mean difference of separation stands beside "
            "the standard error that repetition alone gives it."
        )
        sections.append(_table("Selected differences beyond noise", results, header, counted, [note], 2))
    return sections


def _beyond(found: Document) -> list[str]:
    counts = zip(found["num_worse"], found["num_better"], found["num_compared"], strict=True)
    return [f"{worse} + {better} / {compared}" for worse, better, compared in counts]


def _separation(found: Document) -> str:
    """Mean difference of separation with the standard error from repetition."""
    error = found["beyond_noise"]["standard_error"][SEPARATION]
    mean = _number(found["figures"]["separation_difference_m"]["value"])
    return mean if error is None else f"{mean} (noise {error:.3f})"
