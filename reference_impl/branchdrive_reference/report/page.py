"""The report as one page, and groups beyond its budget as pages beside it."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from branchdrive.cli.formats.causes import causes
from branchdrive.cli.formats.outcome import (
    Level,
    also_in,
    failures,
    folded,
    headline,
    refusals,
    sizes,
    summary,
    unjudged,
    verdict_level,
    waiver_text,
    with_companions,
)  # fmt: skip
from branchdrive.cli.funnel import funnel_table
from branchdrive.contract.resources import rule_page
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import is_waived
from branchdrive_reference.report.facts import DatasetReport, scenes
from branchdrive_reference.report.gallery import Card, Gallery, played_group
from branchdrive_reference.report.picture import forest, funnel_bars
from branchdrive_reference.report.roads import Roads, packed_roads
from branchdrive_reference.report.section import sections
from branchdrive_reference.report.style import families, palette, shared_data
from branchdrive_reference.report.template import asset, island, rendered_page
from branchdrive_reference.study.label import label

__all__ = ["Pages", "render_pages"]

_IMAGE_BYTES_BESIDE = 6_000_000
"""Of the camera images of a page beside it."""

_MOST_LOST = 2000
_FINDINGS_SHOWN = 3
_FINDINGS_LISTED = 50

_HEADS: Mapping[Level, str] = {
    "error": "What is wrong",
    "warning": "What is not as recommended",
    "note": "Why attempts and groups do not qualify, and what is waived",
}
_TONES: Mapping[str, str] = {"error": "error", "warning": "warning", "note": "note"}


class Pages(NamedTuple):
    """What is written.

    Attributes:
        report: The page.
        beside: Pages of groups beyond its budget, by file name; none unless they are asked for.
        num_played: Groups that open in the page.
    """

    report: bytes
    beside: Iterator[tuple[str, bytes]]
    num_played: int


def render_pages(report: DatasetReport, *, name: str, folder: str | None) -> Pages:
    """The report, and where groups get pages of their own those.

    Args:
        report: What it says.
        name: File name of the report, to which pages of groups lead back.
        folder: Name of the folder of such pages; ``None`` where groups beyond the budget stay small drawings.
    """
    bank = None if report.descriptor is None else report.descriptor.action_bank
    style = asset("report.css") + ("" if bank is None else palette(bank))
    gallery = Gallery(report, folder)
    cards = gallery.cards()
    context = {
        "title": _title(report),
        "opens": False,
        "head": _head(report),
        "not_shown": report.not_shown,
        "contents": [],
        "families": {} if bank is None else families(bank),
        "cards": cards,
        "cards_more": _more(len(report.groups) - len(cards), "group"),
        "filters": _filters(cards),
        "played": gallery.played,
        "played_text": gallery.text,
        "shared": island(shared_data(bank, gallery.towns)),
        "sections": sections(report),
        "figures": [(label(key), _data_uri(content)) for key, content in report.figures.items()],
        **_validation_context(report.validation),
    }
    context["contents"] = _contents(context)
    page = rendered_page("report.html.j2", style, **context)
    beside = iter(()) if folder is None else _beside(report, gallery, style, name)
    return Pages(page, beside, len(gallery.played))


def _title(report: DatasetReport) -> str:
    facts = report.validation.dataset
    if facts.dataset_id is None:
        return "Dataset with an unusable descriptor"
    return f"{label(facts.dataset_id)} {label(str(facts.dataset_version))}"


def _head(report: DatasetReport) -> dict[str, Any]:
    validation = report.validation
    facts, level = validation.dataset, verdict_level(validation)
    found = {
        "files": f"{counted(facts.num_files, 'file')} in {counted(facts.num_shards, 'shard')}",
        "raw layer at": facts.raw_path or "",
        "identity": facts.identity or "",
        "content": facts.content_identity or "",
    }
    return {
        "verdict": validation.verdict,
        "meaning": headline(validation).removeprefix(f"{validation.verdict} - ") + ".",
        "tone": "good" if validation.verdict == "valid" and level == "note" else _TONES[level],
        "refusals": [*refusals(validation), *_contradiction(validation)],
        "errors": validation.errors,
        "conditions": validation.conditions,
        "sizes": sizes(validation) + with_companions(validation),
        "path": facts.path,
        "facts": [fact for fact in found.items() if fact[1]],
        "version": validation.validator_version,
    }


def _contradiction(validation: Report) -> list[str]:
    """What to make of a release that claims another population than its raw layer gives; nothing where it does not."""
    funnel, claimed = validation.funnel, validation.num_qualified
    if funnel is None or validation.population is None or claimed == funnel.qualified:
        return []
    return [
        f"The release claims {counted(int(claimed or 0), 'group')}; of its raw layer, as it is now, "
        f"{funnel.qualified:,} are structurally eligible."
    ]


def _contents(context: Mapping[str, Any]) -> list[tuple[str, str]]:
    found = [("funnel", "Funnel"), ("findings", "Findings"), ("groups", "Groups")]
    found += [(section.name, section.title) for section in context["sections"]]
    return [*found, *([("rules", "Rules")] if context["rule_pages"] else [])]


def _more(count: int, noun: str) -> str:
    return f"and {counted(count, f'more {noun}')}; `branchdrive report --format json` lists all" if count > 0 else ""


def _validation_context(validation: Report) -> dict[str, Any]:
    """Funnel, lost groups, findings and rule pages."""
    lost = [group for group in validation.groups or () if not group.qualifies]
    grouped: dict[Level, list[dict[str, Any]]] = {}
    named = set()
    for level, tally in failures(validation):
        named.add(tally.rule_id)
        grouped.setdefault(level, []).append(_tally(level, tally, validation))
    named |= {rule for group in lost for rule in group.rules}
    response = validation.response
    return {
        "funnel": None if validation.funnel is None else funnel_bars(validation.funnel),
        "funnel_table": None if validation.funnel is None else funnel_table(validation.funnel),
        "lost": lost[:_MOST_LOST],
        "lost_more": _more(len(lost) - _MOST_LOST, "group"),
        "lost_title": f"Groups that do not qualify: {len(lost):,} of {len(validation.groups or ()):,}",
        "findings": [(_HEADS[level], grouped[level]) for level in _HEADS if level in grouped],
        "unjudged": unjudged(validation),
        "waivers": [
            f"{outcome.waiver.rule} at {label(outcome.waiver.location)}: {waiver_text(outcome, validation)}"
            for outcome in validation.waivers
        ],
        "forest": None if response is None or not response.actions else forest(response),
        "rule_pages": [(rule, CATALOGUE[rule].title, _rule_text(rule)) for rule in sorted(named)],
    }


def _tally(level: Level, tally: Tally, validation: Report) -> dict[str, Any]:
    parts = folded(tally.findings)
    listed = parts[:_FINDINGS_LISTED]
    left = tally.num_findings - sum(map(tally.places, listed))
    return {
        "id": tally.rule_id,
        "title": tally.info.title,
        "kind": tally.info.kind,
        "tone": _TONES[level],
        "summary": summary(tally),
        "page": True,
        "causes": causes(tally, validation) if tally.status == "fail" else [],
        "shown": [_place(part) for part in listed[:_FINDINGS_SHOWN]],
        "further_text": counted(len(listed) - _FINDINGS_SHOWN, "more place"),
        "further": [_place(part) for part in listed[_FINDINGS_SHOWN:]],
        "left": f"and {left:,} more violations" if left > 0 and tally.findings else "",
        "remedy": tally.info.remedy if tally.status == "fail" and not is_waived(tally) else "",
    }


def _place(part: Sequence[Finding]) -> dict[str, str]:
    finding = part[0]
    more = (f" ({finding.count:,} places)" if finding.count > 1 else "") + also_in(part)
    return {
        "where": location_text(finding.location) + more, "expected": finding.expected, "found": finding.found,
    }  # fmt: skip


@cache
def _rule_text(rule_id: str) -> Any:
    """The page of a rule below its table of facts, without targets of links, which are files of the repository."""
    from markdown_it import MarkdownIt
    from markupsafe import Markup

    page = rule_page(rule_id)
    text = re.sub(r"\[([^\[\]]+)\]\([^)]+\)", r"\1", page[page.index("## ") : page.index("<!-- end")])
    rendered = MarkdownIt("commonmark", {"html": False}).render(text)
    return Markup(re.sub(r"(</?h)2>", r"\g<1>3>", rendered))  # noqa: S704  (our own)


def _data_uri(content: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"


def _filters(cards: Iterable[Card]) -> list[tuple[str, str, list[str]]]:
    cards = list(cards)
    titles = {
        "type": ("scenario_type", "Scenario type"), "town": ("town", "Town"), "partition": ("partition", "Partition"),
        "outcome": ("outcome", "Outcome"), "contact": ("contact", "Contacts"),
    }  # fmt: skip
    found = [
        (name, title, sorted({getattr(card, column) for card in cards} - {""}))
        for name, (column, title) in titles.items()
    ]
    return [entry for entry in found if entry[2]]


def _beside(report: DatasetReport, gallery: Gallery, style: str, name: str) -> Iterator[tuple[str, bytes]]:
    """Pages of groups that the report has no room for."""
    if report.dataset is None:
        return
    facts = {group.group_id: group for group in gallery.beside}
    bank = report.dataset.descriptor.action_bank
    known = Roads(report.dataset.descriptor)
    for rows, group_id, scene in scenes(report.dataset, frozenset(facts)):
        known.collect(rows)
        if not group_id:
            continue
        group = facts[group_id]
        _, document, _ = played_group(group, scene, known, rows, report.dataset.descriptor, _IMAGE_BYTES_BESIDE)
        elements = known.around(group.town, scene) if scene.futures else []
        towns = {group.town: packed_roads(elements)} if elements else {}
        shared = island(shared_data(bank, towns))
        page = rendered_page(
            "group.html.j2", style, title=label(group_id), back=f"../{name}", shared=shared, played=[island(document)],
            opens=True,
        )  # fmt: skip
        yield f"{group_id}.html", page
