"""Tables of results, printed as Markdown, `TABLES.md`; a terminal shows `branchdrive.benchmark.headline`.

They are a pure function of the document `results.json`, and of `latency.json` where it exists, in the layout of the
paper. Whatever prints them puts the warnings of the results below each title, so that none can be quoted without them,
and so the Markdown says of every table of intervals and tests where nothing can be concluded from them.
Tables print the number of groups, never of trajectories.

Source: paper, tables of "Experiments"; spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from branchdrive.benchmark.cell import Document
from branchdrive.benchmark.guard.table import guard_sections, noise_tables
from branchdrive.benchmark.latency import latency_table
from branchdrive.benchmark.prediction.table import prediction_tables
from branchdrive.benchmark.ranking.table import ranking_sections
from branchdrive.benchmark.shortage import inconclusive_sentence
from branchdrive.text.markdown import section_lines
from branchdrive.text.table import Passage, Table

__all__ = ["render_tables", "result_sections"]


def result_sections(results: Document) -> list[Table | Passage]:
    """All tables, with what stands between them.

    Args:
        results: Document ``results.json``, which conforms to its schema.
    """
    return [
        *prediction_tables(results),
        *ranking_sections(results),
        *guard_sections(results),
        *noise_tables(results),
    ]


def render_tables(results: Document, latency: Document | None = None) -> str:
    """The tables as Markdown.

    Args:
        results: Document ``results.json``, which conforms to its schema.
        latency: Document ``latency.json``, if there is one.
    """
    protocol, population = results["protocol"], results["population"]
    warning = inconclusive_sentence(population["groups"], population["clusters"])
    short = ["Nothing can be concluded: too few route clusters."] if warning else []
    head = [
        "# Benchmark results",
        "",
        *([warning, ""] if warning else []),
        f"Protocol `{protocol['name']}` {protocol['version']}, digest `{protocol['digest']}`.",
        "Values are means over seeds, and what follows ± is their standard deviation over seeds unless a table says "
        "otherwise. Intervals of 95 % resample whole route clusters; those that resample groups stand beside them.",
        "Of errors and regret less is better, of correlations, utility and what selectors capture more. "
        "What is not defined is -.",
    ]
    timed = [] if latency is None else [latency_table(latency)]
    found = [*result_sections(results), *timed]
    sections = [
        head,
        *(
            section_lines(
                section,
                [*results["warnings"], *(short if isinstance(section, Table) and section.has_intervals else ())],
            )
            for section in found
        ),
    ]
    return "\n\n".join("\n".join(section) for section in sections) + "\n"
