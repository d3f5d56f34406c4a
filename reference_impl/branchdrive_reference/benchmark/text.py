"""Results of a benchmark on a terminal: the headline tables, each with the warnings of the results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from io import StringIO
from typing import Any, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from branchdrive.benchmark.promise import UNGUARDED, noise_floor, promises
from branchdrive.benchmark.table.comparison import comparison_notes
from branchdrive.contract.text import printable
from branchdrive.statistics.sign_flip import p_text

__all__ = ["render_results"]

_PLAIN_WIDTH, _GAP = 120, 2
_METRICS = (("macro_nmae", "macro NMAE"), ("ade_m", "ADE m"), ("fde_m", "FDE m"), ("heading_mae_deg", "heading deg"),
            ("speed_mae_mps", "speed m/s"))  # fmt: skip
_SHARES = (
    ("violation", "violation %"),
    ("violation_of_clusters", "of clusters %"),
    ("intervention", "intervention %"),
    ("retained_gain", "retained gain %"),
)
_NONE = "-"


def render_results(results: Mapping[str, Any], stdout: TextIO) -> str:
    """Prediction, comparisons, ranking and guard as text, coloured if `stdout` is a terminal."""
    buffer = StringIO()
    terminal = stdout.isatty()
    width = Console(file=stdout).width if terminal else _PLAIN_WIDTH
    console = Console(file=buffer, force_terminal=terminal, width=width, highlight=False, emoji=False)
    said = results["warnings"]
    _print(console, "Prediction, test partition", said, *_prediction(results))
    if results["prediction"]["comparisons"]:
        _print(console, "Comparisons of models", said, *_comparisons(results["prediction"]))
    for profile in results["ranking"]["profiles"]:
        _print(console, f"Ranking, profile {profile['profile']}", said, *_ranking(profile))
    if results["ranking"]["comparisons"]:
        _print(console, "Comparisons of selectors", said, *_comparisons(results["ranking"]))
    for profile in results["guard"]["profiles"]:
        _print(console, f"Guard, profile {profile['profile']}", said, *_guard(profile))
    for paragraph in promises(results):
        console.print(Text(paragraph))
        console.print()
    if not results["guard"]["profiles"]:
        console.print(Text(f"Guard: not judged. {printable(results['guard']['reason'])}"))
    console.print(Text(_noise(results)))
    return "\n".join(line.rstrip(" ") for line in buffer.getvalue().split("\n"))


def _print(
    console: Console,
    title: str,
    said: Sequence[str],
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    note: str = "",
) -> None:
    console.print(Text(title, style="bold"))
    for sentence in said:
        console.print(Text(f"Warning: {printable(sentence)}", style="yellow"))
    console.print(_table(header, [*rows], console.width))
    if note:
        console.print(Text(note, style="dim"))
    console.print()


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Table:
    """A table whose words stay whole; where they do not fit side by side, one line for each cell."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    widths = _widths(list(zip(header, *rows, strict=True)), width)
    if widths is None:
        table.show_header = False
        for _ in range(2):
            table.add_column(overflow="fold")
        for row in rows:
            for name, cell in zip(header, row, strict=True):
                if cell:
                    table.add_row(Text(name, style="dim"), Text(cell))
            table.add_row("", "")
        return table
    for place, (name, found) in enumerate(zip(header, widths, strict=True)):
        table.add_column(name, justify="right" if place else "left", width=found)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def _widths(columns: Sequence[Sequence[str]], width: int) -> list[int] | None:
    """Widths of columns, the widest narrowed first and none below its longest word; ``None`` where that is too wide."""
    words = [max(len(word) for cell in column for word in cell.split() or [""]) for column in columns]
    widths = [max(map(len, column)) for column in columns]
    room = width - _GAP * (len(columns) - 1)
    if sum(words) > room:
        return None
    while sum(widths) > room:
        place = max((i for i in range(len(widths)) if widths[i] > words[i]), key=widths.__getitem__)
        widths[place] -= 1
    return widths


def _spread(value: float | None, sd: float | None, digits: int = 3) -> str:
    if value is None:
        return _NONE
    return f"{value:.{digits}f}" if sd is None else f"{value:.{digits}f} ± {sd:.{digits}f}"


def _ends(found: Mapping[str, Any], low: str = "low", high: str = "high") -> str:
    return _NONE if found[low] is None else f"[{found[low]:.3f}, {found[high]:.3f}]"


def _prediction(results: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    found = {(row["model"], row["metric"]): row for row in results["prediction"]["estimates"]}
    rows = []
    for model in results["models"]:
        cells = [found[model["id"], metric] for metric, _ in _METRICS]
        name = printable(f"{model['id']} {model['title']}") if model["declared"] else model["id"]
        rows.append([name, *(_spread(cell["value"], cell["seed_sd"]) for cell in cells), str(cells[0]["num_groups"])])
    return ["model", *(title for _, title in _METRICS), "groups"], rows


def _comparisons(section: Mapping[str, Any]) -> tuple[list[str], list[list[str]], str]:
    """Two rows for each comparison: by route clusters, and by groups."""
    families = section["families"]
    adjusted = {family["name"]: {row["name"]: row for row in family["members"]} for family in families}
    rows = []
    for row in section["comparisons"]:
        cells = [adjusted[family["name"]].get(row["name"]) for family in families]
        rows += [
            [
                row["name"],
                _NONE if row["difference"] is None else f"{row['difference']:+.4f}",
                "clusters",
                str(row["num_clusters"]),
                _ends(row["interval"], "cluster_low", "cluster_high"),
                p_text(row["p_clusters"], row["is_bound_clusters"]),
                *(_NONE if c is None else p_text(c["p_holm_clusters"], c["is_bound_clusters"]) for c in cells),
            ],
            [
                "",
                "",
                "groups",
                str(row["num_groups"]),
                _ends(row["interval"]),
                p_text(row["p"], row["is_bound"]),
                *(_NONE if c is None else p_text(c["p_holm"], c["is_bound"]) for c in cells),
            ],
        ]
    sizes = ", ".join(f"{_short(f)} {f['num_evaluated']} of {f['num_declared']}" for f in families)
    note = " ".join(comparison_notes(section))
    if families:
        note += f" Evaluated tests of each family: {sizes}; the others count with p = 1."
    header = ["comparison", "difference", "by", "N", "95 %", "p", *(f"Holm {_short(family)}" for family in families)]
    return header, rows, note


def _short(family: Mapping[str, Any]) -> str:
    return str(family["name"]).removeprefix("ranking_")


def _ranking(profile: Mapping[str, Any]) -> tuple[list[str], list[list[str]], str]:
    rows = [
        [
            entry["selector"],
            _spread(entry["value"], entry["seed_sd"]["value"]),
            f"{entry['difference']:+.3f}",
            _spread(entry["regret"], entry["seed_sd"]["regret"]),
            _spread(entry["concordance"], None),
            _spread(entry["ndcg"], None),
            _spread(entry["top_1"], None),
            _spread(entry["captured"], None),
            _gate(entry["gate"]),
        ]
        for entry in profile["entries"]
    ]
    header = ["selector", "value", "to nominal", "regret", "concord.", "NDCG", "top-1", "captured", "non-worsening, m"]
    brake = profile["fixed_brake"] or "none"
    note = f"{profile['num_ranked']} groups; ActionPrior takes {profile['action_prior']}, the fixed brake is {brake}."
    return header, rows, note


def _gate(gate: Mapping[str, Any]) -> str:
    found = f"{'pass' if gate['passed'] else 'fail'} {gate['mean_m']:+.3f} {_ends(gate)}"
    return found.removesuffix(f" {_NONE}")


def _guard(profile: Mapping[str, Any]) -> tuple[list[str], list[list[str]], str]:
    rows = []
    for selection in profile["selections"]:
        figures, gain = selection["figures"], selection["figures"]["gain"]
        cells = [_share(figures[name]) for name, _ in _SHARES]
        cells.insert(
            -1, _NONE if gain["value"] is None else f"{gain['value']:.3f} {_ends(gain)}".removesuffix(f" {_NONE}")
        )
        rows.append([selection["selection"], *cells])
    margin, notes = profile["global_margin"], []
    vacuous = "vacuous: it accepts no intervention" if margin["test"]["vacuous"] else "not vacuous"
    notes.append(f"{profile['num_groups']} groups. Global margin {margin['margin_m']:.3f} m, {vacuous}.")
    for name in ("conformal", "learn_then_test"):
        refusal = profile[name]["refusal"]
        price = "nominal alone" if profile[name]["price"] is None else f"price {profile[name]['price']:.4g}"
        notes.append(f"{name}: {price}{'' if refusal is None else f', not judged: {refusal}'}.")
    titles = [title for _, title in _SHARES]
    notes.append(UNGUARDED)
    return ["selection", *titles[:-1], "gain", titles[-1]], rows, " ".join(notes)


def _share(found: Mapping[str, Any]) -> str:
    if found["value"] is None:
        return _NONE
    ends = "" if found["low"] is None else f" [{100 * found['low']:.1f}, {100 * found['high']:.1f}]"
    return f"{100 * found['value']:.1f}{ends}"


def _noise(results: Mapping[str, Any]) -> str:
    if results["noise"] is None:
        return "Noise of outcomes: unknown; the ranking lock holds none, which takes nominal replays in the raw layer."
    counts = max(results["noise"]["num_groups"], default=0)
    floor = noise_floor(results)
    return (
        f"Noise of outcomes: from repeated nominals of {counts} training groups; see the tables for what exceeds it."
        f"{'' if floor is None else f' {floor}'}"
    )
