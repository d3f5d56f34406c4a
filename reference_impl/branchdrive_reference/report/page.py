"""The report as one page, and groups beyond its budget as pages beside it.

Text of a dataset reaches the page in two ways alone: through templates, which escape it, and as JSON whose brackets
are escaped. The policy of the page names its own style and script by digest, so that nothing else runs, and forbids
every connection.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
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
from branchdrive.contract.bank import ActionBank
from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.resources import rule_page
from branchdrive.contract.rule import CATALOGUE
from branchdrive.contract.text import counted
from branchdrive.engine.finding import Finding, location_text
from branchdrive.engine.report import Report
from branchdrive.engine.tally import Tally
from branchdrive.engine.verdict import is_waived
from branchdrive_reference.drawing.palette import Rgb, candidate_colours
from branchdrive_reference.report.encode import STEPS, encoded_scene
from branchdrive_reference.report.facts import DatasetReport, GroupFacts, scenes
from branchdrive_reference.report.images import camera_images
from branchdrive_reference.report.picture import forest, funnel_bars
from branchdrive_reference.report.roads import STEP_M, Roads, packed_roads
from branchdrive_reference.report.scene import Scene
from branchdrive_reference.report.section import sections
from branchdrive_reference.report.thumbnail import Thumbnail, thumbnail
from branchdrive_reference.study.label import label

__all__ = ["Pages", "render_pages"]

PLAYED_BYTES = 6_000_000
"""Data of groups that open in the page itself."""

IMAGE_BYTES = 2_000_000
"""Of all camera images of the page."""

_IMAGE_BYTES_BESIDE = 6_000_000
"""Of the camera images of a page beside it."""

_MOST_CARDS = 1000
_MOST_LOST = 2000
_FINDINGS_SHOWN = 3
_FINDINGS_LISTED = 50

_SCRIPTS = ("decode.js", "theme.js", "gallery.js", "map.js", "chart.js", "player.js")
"""In the order in which they run."""

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


class _Card(NamedTuple):
    """A group of the gallery."""

    group_id: str
    scenario_type: str
    town: str
    partition: str
    outcome: str
    tone: str
    contact: str
    contact_text: str
    picture: Thumbnail | None
    remark: str
    place: int | None
    href: str | None


@cache
def _asset(name: str) -> str:
    return files(__package__).joinpath("assets", name).read_text("utf-8")


@cache
def _environment() -> Any:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    found = Environment(
        loader=FunctionLoader(_asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters["ticked"] = _ticked
    return found


def _ticked(text: str) -> Any:
    """Text with what stands in back-ticks as code; everything is escaped."""
    from markupsafe import Markup, escape

    parts = text.split("`")
    if len(parts) % 2 == 0:  # one is left over
        return escape(text)
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if place % 2 else part for place, part in enumerate(parts))


def _island(document: Any) -> Any:
    """A document as the content of a script element that no browser runs: no bracket of it can end the element."""
    from markupsafe import Markup

    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))  # noqa: S704


def _page(template: str, style: str, **values: Any) -> bytes:
    from markupsafe import Markup

    script = "\n".join(["'use strict';", *map(_asset, _SCRIPTS)])
    allowed = {name: base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
               for name, text in (("script", script), ("style", style))}  # fmt: skip
    policy = (
        "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'; "
        f"script-src 'sha256-{allowed['script']}'; style-src 'sha256-{allowed['style']}'"
    )
    values |= {"policy": policy, "style": Markup(style), "script": Markup(script)}  # noqa: S704  (our own)
    text: str = _environment().get_template(template).render(values)
    return text.encode()


def _hex(colour: Rgb) -> str:
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


def _for_dark(colour: Rgb) -> Rgb:
    """The colour on dark ground: the darker, the more it is lightened."""
    red, green, blue = colour
    light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    share = min(max(0.72 - light, 0.0), 0.9) if max(colour) - min(colour) > 0.1 else 0.95
    return red + share * (1 - red), green + share * (1 - green), blue + share * (1 - blue)


def _palette(bank: ActionBank) -> str:
    """Colours of candidates and families as a style sheet: hue by family, darker with magnitude."""
    colours = candidate_colours(bank)
    lines, family_lines = [], []
    names = _families(bank)
    for index, policy in enumerate(bank.policies):
        colour = colours[policy.key]
        lines.append(f"--c{index}: light-dark({_hex(colour)}, {_hex(_for_dark(colour))});")
        family_lines.append(f".c{index} {{ stroke: var(--c{index}); }}")
    for name, index in names.items():
        members = [i for i, policy in enumerate(bank.policies) if policy.family == name]
        family_lines.append(f".f{index} {{ stroke: var(--c{members[len(members) // 2]}); }}")
    actors = [f".{name} {{ fill: var(--{name}); }}" for name in ("vehicle", "cycle", "pedestrian", "static", "other")]
    return "\n".join([":root {", *lines, "}", *family_lines, *actors])


def _families(bank: ActionBank) -> dict[str, int]:
    """Number of every family, the nominal's first."""
    names = dict.fromkeys([bank.nominal.family, *(policy.family for policy in bank.policies)])
    return {name: index for index, name in enumerate(names)}


def _words(key: str) -> str:
    return label(key).replace("_", " ")


def _shared(bank: ActionBank | None, towns: Mapping[str, Any]) -> dict[str, Any]:
    """What all groups of a page have in common."""
    families = {} if bank is None else _families(bank)
    return {
        "bank": []
        if bank is None
        else [
            {"key": policy.key, "label": _words(policy.key), "family": families[policy.family]}
            for policy in bank.policies
        ],
        "families": [_words(name) for name in families],
        "steps": {**STEPS, "road_m": STEP_M},
        "towns": dict(towns),
    }


def render_pages(report: DatasetReport, *, name: str, folder: str | None) -> Pages:
    """The report, and where groups get pages of their own those.

    Args:
        report: What it says.
        name: File name of the report, to which pages of groups lead back.
        folder: Name of the folder of such pages; ``None`` where groups beyond the budget stay small drawings.
    """
    bank = None if report.descriptor is None else report.descriptor.action_bank
    style = _asset("report.css") + ("" if bank is None else _palette(bank))
    gallery = _Gallery(report, folder)
    cards = gallery.cards()
    context = {
        "title": _title(report),
        "opens": False,
        "head": _head(report),
        "not_shown": report.not_shown,
        "contents": [],
        "families": {} if bank is None else _families(bank),
        "cards": cards,
        "cards_more": _more(len(report.groups) - len(cards), "group"),
        "filters": _filters(cards),
        "played": gallery.played,
        "played_text": _played_text(report, gallery),
        "shared": _island(_shared(bank, gallery.towns)),
        "sections": sections(report),
        "figures": [(label(key), _data_uri(content)) for key, content in report.figures.items()],
        **_validation_context(report.validation),
    }
    context["contents"] = _contents(context)
    page = _page("report.html.j2", style, **context)
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
        "shards, files": f"{facts.num_shards:,}, {facts.num_files:,}",
        "raw layer at": facts.raw_path or "",
        "identity": facts.identity or "",
        "content": facts.content_identity or "",
    }
    return {
        "verdict": validation.verdict,
        "meaning": headline(validation).removeprefix(f"{validation.verdict} - ") + ".",
        "tone": "good" if validation.verdict == "valid" and level == "note" else _TONES[level],
        "refusals": refusals(validation),
        "errors": validation.errors,
        "conditions": validation.conditions,
        "sizes": sizes(validation) + with_companions(validation),
        "path": facts.path,
        "facts": [fact for fact in found.items() if fact[1]],
        "version": validation.validator_version,
    }


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


def _filters(cards: Iterable[_Card]) -> list[tuple[str, str, list[str]]]:
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


def _played_text(report: DatasetReport, gallery: _Gallery) -> str:
    num, played = len(report.groups), len(gallery.played)
    text = f"{counted(num, 'group')}; {'all open' if played == num else f'{played:,} open'} in the player."
    if played < num and gallery.folder is not None:
        text += " The others open in pages of their own beside this file."
    elif played < num:
        text += " A file of bounded size has no room for the others, or they hold nothing that can be drawn."
    return text


class _Gallery:
    """Groups of a report as cards, and the data of those that its page plays."""

    def __init__(self, report: DatasetReport, folder: str | None) -> None:
        self.folder = folder
        self.played: list[Any] = []
        self.towns: dict[str, Any] = {}
        self.beside: list[GroupFacts] = []
        self._report = report
        self._places: dict[str, int] = {}
        self._found: dict[str, tuple[Thumbnail | None, Any, str]] = {}

    def cards(self) -> list[_Card]:
        """Cards of the first groups, each with its drawing."""
        report, dataset = self._report, self._report.dataset
        if dataset is None:
            return []
        facts = {group.group_id: group for group in report.groups}
        order = _mixed(report.groups)[:_MOST_CARDS]
        roads = Roads(dataset.descriptor)
        share = IMAGE_BYTES // max(len(order), 1)
        for rows, group_id, scene in scenes(dataset, frozenset(group.group_id for group in order)):
            roads.collect(rows)
            if group_id:
                picture, document, contact = _played(facts[group_id], scene, roads, rows, dataset.descriptor, share)
                self._found[group_id] = picture, _island(document), contact
        self._choose(order)
        self.towns = roads.packed()
        shown = {group.group_id for group in order}
        return [self._card(group) for group in report.groups if group.group_id in shown]

    def _choose(self, order: Sequence[GroupFacts]) -> None:
        """Keep the data of as many groups as there is room for, in the order of the dataset."""
        room, kept = PLAYED_BYTES + IMAGE_BYTES, set()
        for group in order:
            if group.group_id in self._found:
                size = len(self._found[group.group_id][1])
                if size > room:
                    continue
                room -= size
                kept.add(group.group_id)
        for group in self._report.groups:
            if group.group_id in kept:
                self._places[group.group_id] = len(self.played)
                self.played.append(self._found[group.group_id][1])
            elif self.folder is not None and re.fullmatch(PATTERNS["id"], group.group_id):
                self.beside.append(group)

    def _card(self, group: GroupFacts) -> _Card:
        picture, _, contact = self._found.get(group.group_id, (None, "", "unknown"))
        place = self._places.get(group.group_id)
        is_beside = self.folder is not None and place is None and re.fullmatch(PATTERNS["id"], group.group_id)
        result = group.result
        tone = "note" if result is None else "good" if result.qualifies else "warning"
        return _Card(
            label(group.group_id), label(group.scenario_type), label(group.town), group.partition, group.outcome, tone,
            contact, _CONTACTS[contact], picture, "" if picture else "Nothing of this group can be drawn.", place,
            f"{self.folder}/{group.group_id}.html" if is_beside else None,
        )  # fmt: skip


_CONTACTS = {
    "nominal touches": "The nominal drive touches something.",
    "an intervention touches": "Some intervention touches something.",
    "none touches": "No candidate touches anything.",
    "unknown": "Contacts are unknown.",
}


def _mixed(groups: Sequence[GroupFacts]) -> list[GroupFacts]:
    """Groups in the order in which they get room: one of every outcome and scenario type after the other."""
    kinds: dict[tuple[str, str], list[GroupFacts]] = {}
    for group in groups:
        kinds.setdefault((group.outcome, group.scenario_type), []).append(group)
    turns = max(map(len, kinds.values()), default=0)
    return [members[turn] for turn in range(turns) for members in kinds.values() if turn < len(members)]


def _played(
    group: GroupFacts, scene: Scene, roads: Roads, rows: Any, descriptor: Descriptor, image_bytes: int
) -> tuple[Thumbnail | None, dict[str, Any], str]:
    """Drawing, data for the player and contacts of a group."""
    remarks = list(scene.remarks)
    about = [label(group.scenario_type), label(group.town), group.partition, group.outcome]
    document: dict[str, Any] = {
        "name": label(group.group_id), "town": group.town,
        "about": " · ".join(text for text in about if text),
    }  # fmt: skip
    if group.result is not None and not group.result.qualifies:
        remarks.insert(0, f"It does not qualify, {group.outcome}: {group.result.reason}.")
    picture, contact = None, "unknown"
    if scene.futures:
        elements = roads.around(group.town, scene)
        if not elements:
            remarks.append(f"There is no map of {label(group.town)} around this group.")
        picture = thumbnail(scene, elements)
        images, missing = camera_images(rows, scene, descriptor, image_bytes)
        remarks += missing
        document |= {**encoded_scene(scene), "at": list(scene.origin[:2])}
        if images:
            document["images"] = images
        if "evidence" in rows.streams:
            contact = "none touches"
            if any(len(future.contacts) for future in scene.futures[1:]):
                contact = "an intervention touches"
            if len(scene.futures[0].contacts):
                contact = "nominal touches"
    document["remarks"] = remarks
    return picture, document, contact


def _beside(report: DatasetReport, gallery: _Gallery, style: str, name: str) -> Iterator[tuple[str, bytes]]:
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
        _, document, _ = _played(group, scene, known, rows, report.dataset.descriptor, _IMAGE_BYTES_BESIDE)
        elements = known.around(group.town, scene) if scene.futures else []
        towns = {group.town: packed_roads(elements)} if elements else {}
        shared = _island(_shared(bank, towns))
        page = _page(
            "group.html.j2", style, title=label(group_id), back=f"../{name}", shared=shared, played=[_island(document)],
            opens=True,
        )  # fmt: skip
        yield f"{group_id}.html", page
