"""The report as one page, and groups beyond its budget as pages beside it."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple
from urllib.parse import quote

from branchdrive.cli.formats.causes import CAUSES_HEAD, CauseText
from branchdrive.cli.formats.outcome import Failure, Level, Outcome, Place, files_text
from branchdrive.cli.funnel import LostGroups, funnel_table, lost_groups, lost_title
from branchdrive.contract.resources import rule_page_text
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.engine.finding import Finding
from branchdrive.engine.report import Report
from branchdrive_reference.report.facts import DatasetReport, scenes
from branchdrive_reference.report.fault import Faults
from branchdrive_reference.report.gallery import NO_FINDING, WITH_FINDINGS, Card, Gallery, played_group
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
_MOST_NAMES = 500
_FINDINGS_SHOWN = 3
_FINDINGS_LISTED = 50


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
    outcome = Outcome.of(report.validation, _FINDINGS_LISTED)
    style = asset("report.css") + ("" if bank is None else palette(bank))
    faults = Faults(report.validation)
    gallery = Gallery(report, None if folder is None else quote(os.fsencode(folder)), faults)
    cards = gallery.cards()
    context = {
        "title": _title(report),
        "opens": False,
        "head": _head(report, outcome),
        "not_shown": report.not_shown,
        "contents": [],
        "families": {} if bank is None else families(bank),
        "cards": cards,
        "cards_more": _more(len(report.groups) - len(cards)),
        "filters": _filters(cards),
        "played": gallery.played,
        "played_text": gallery.text,
        "shared": island(shared_data(bank, gallery.towns, faults.levels)),
        "sections": sections(report),
        "figures": [(label(key), _data_uri(content)) for key, content in report.figures.items()],
        **_validation_context(report.validation, outcome, gallery),
    }
    context["contents"] = _contents(context)
    page = rendered_page("report.html.j2", style, **context)
    beside = iter(()) if folder is None else _beside(report, gallery, style, f"../{quote(os.fsencode(name))}")
    return Pages(page, beside, len(gallery.played))


def _title(report: DatasetReport) -> str:
    facts = report.validation.dataset
    if facts.dataset_id is None:
        return "Dataset with an unusable descriptor"
    return f"{label(facts.dataset_id)} {label(str(facts.dataset_version))}"


def _head(report: DatasetReport, outcome: Outcome) -> dict[str, Any]:
    validation = report.validation
    facts, level = validation.dataset, outcome.level
    found = {
        "files": f"{files_text(validation)} in {counted(facts.num_shards, 'shard')}",
        "raw layer at": facts.raw_path or "",
        "identity": facts.identity or "",
        "content": facts.content_identity or "",
    }
    return {
        "verdict": validation.verdict,
        "meaning": outcome.headline.removeprefix(f"{validation.verdict} - ") + ".",
        "tone": "good" if validation.verdict == "valid" and level == "note" else level,
        "refusals": [*outcome.refusals, *outcome.cautions, *_contradiction(validation)],
        "errors": validation.errors,
        "conditions": validation.conditions,
        "sizes": outcome.sizes + outcome.companions,
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
    found = [("causes", CAUSES_HEAD)] if context["causes"] else []
    found += [("funnel", "Funnel"), ("findings", "Findings"), ("groups", "Groups")]
    found += [(section.name, section.title) for section in context["sections"]]
    return [*found, *([("rules", "Rules")] if context["rule_pages"] else [])]


def _more(count: int) -> str:
    return f"and {counted(count, 'more group')}; `branchdrive report --format json` lists all" if count > 0 else ""


def _validation_context(validation: Report, outcome: Outcome, gallery: Gallery) -> dict[str, Any]:
    """Funnel, lost groups, findings and rule pages; links into the player lead to the groups of the gallery."""
    lost = lost_groups(validation)
    named = {failure.info.id for *_, failures in outcome.sections for failure in failures}
    named |= {rule for same in lost for rule in (*same.rules, *same.further)}
    response = validation.response
    return {
        "funnel": None if validation.funnel is None else funnel_bars(validation.funnel),
        "funnel_table": None if validation.funnel is None else funnel_table(validation.funnel),
        "lost": [_lost(same, gallery) for same in lost[:_MOST_LOST]],
        "most_groups": _MOST_NAMES,
        "lost_more": _more(sum(len(same.names) for same in lost[_MOST_LOST:])),
        "lost_title": lost_title(validation),
        "causes_head": CAUSES_HEAD,
        "causes": [_cause(cause, gallery) for cause in outcome.causes],
        "findings": [
            (head, [_failure(level, one, gallery) for one in failures]) for level, head, failures in outcome.sections
        ],
        "unjudged": outcome.unjudged,
        "waivers": [f"{waiver.rule} at {label(waiver.location)}: {use}" for waiver, use in outcome.waivers],
        "forest": None if response is None or not response.actions else forest(response),
        "rule_pages": [(rule, CATALOGUE[rule].title, _rule_text(rule)) for rule in sorted(named)],
    }


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _cause(cause: CauseText, gallery: Gallery) -> dict[str, Any]:
    info = cause.info
    return {
        "id": info.id,
        "title": cause.title,
        "tone": "error" if info.decides else "warning" if info.level == "MUST" else "note",
        "where": cause.where,
        "found": [(text, finding and gallery.href(finding)) for text, finding in cause.found],
        "follows": _sentence(cause.follows),
        "remedy": cause.remedy,
    }


def _failure(level: Level, failure: Failure, gallery: Gallery) -> dict[str, Any]:
    places, left = failure.places, failure.num_left
    return {
        "id": failure.info.id,
        "title": failure.info.title if failure.is_error else failure.info.broken,
        "kind": failure.info.kind,
        "tone": level,
        "summary": failure.summary,
        "follows": _sentence(failure.follows),
        "shown": [_place(place, gallery) for place in places[:_FINDINGS_SHOWN]],
        "further_text": counted(len(places) - _FINDINGS_SHOWN, "more place"),
        "further": [_place(place, gallery) for place in places[_FINDINGS_SHOWN:]],
        "left": f"and {left:,} more violations elsewhere" if left > 0 else "",
        "remedy": failure.remedy,
    }


def _lost(same: LostGroups, gallery: Gallery) -> dict[str, Any]:
    return same._asdict() | {"names": [(name, gallery.group_href(name)) for name in same.names]}


def _place(place: Place, gallery: Gallery) -> dict[str, Any]:
    first: dict[str, Finding] = {}
    for finding in place.findings:
        if finding.group_id is not None:
            first.setdefault(finding.group_id, finding)
    groups = [(label(name), gallery.href(finding)) for name, finding in first.items()]
    return {
        "where": place.where + place.more,
        "expected": place.expected,
        "found": place.found,
        "href": gallery.href(place.findings[0]),
        "groups": groups if len(groups) > 1 else [],
    }


@cache
def _rule_text(rule_id: str) -> Any:
    """The page of a rule below its table of facts."""
    from markdown_it import MarkdownIt
    from markupsafe import Markup

    rendered = MarkdownIt("commonmark", {"html": False}).render(rule_page_text(rule_id))
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
    if rules := sorted({rule for card in cards for rule in card.rules}):
        found.append(("rules", "Findings", [WITH_FINDINGS, NO_FINDING, *rules]))
    return [entry for entry in found if entry[2]]


def _beside(report: DatasetReport, gallery: Gallery, style: str, back: str) -> Iterator[tuple[str, bytes]]:
    """Pages of groups that the report has no room for, which lead back to an address."""
    if report.dataset is None:
        return
    facts = {group.group_id: group for group in gallery.beside}
    bank = report.dataset.descriptor.action_bank
    known = Roads(report.dataset.descriptor)
    for seen in scenes(report.dataset, frozenset(facts), gallery.faults):
        known.collect(seen.rows)
        group_id = seen.scene.group_id
        if not group_id:
            continue
        group = facts[group_id]
        _, document, _ = played_group(group, seen, known, report.dataset.descriptor, _IMAGE_BYTES_BESIDE)
        elements = known.around(group.town, seen.scene) if seen.scene.futures else []
        towns = {group.town: packed_roads(elements)} if elements else {}
        shared = island(shared_data(bank, towns, gallery.faults.levels, report=back))
        page = rendered_page(
            "group.html.j2", style, title=label(group_id), back=back, shared=shared, played=[island(document)],
            opens=True,
        )  # fmt: skip
        yield f"{group_id}.html", page
