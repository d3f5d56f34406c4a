"""Results as Markdown, `TABLES.md`: a pure function of the document `results.json`, in the layout of the paper.

Every table carries the warnings of the results below its title, so that none can be quoted without them. Tables
print the number of groups, never of trajectories.

Source: paper, tables of V and VI; spec/14-benchmark.md#tables.
"""

from __future__ import annotations

from branchdrive.benchmark.table.guard import guard_tables, noise_tables
from branchdrive.benchmark.table.markdown import Document
from branchdrive.benchmark.table.prediction import prediction_tables
from branchdrive.benchmark.table.ranking import ranking_tables

__all__ = ["render_tables"]


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
        "Of errors and regret less is better, of correlations, utility and what selectors capture more. "
        "What is not defined is -.",
    ]
    sections = (head, *prediction_tables(results), *ranking_tables(results), *guard_tables(results))
    return "\n\n".join("\n".join(section) for section in (*sections, *noise_tables(results))) + "\n"
