"""The groups of a report as cards, and the data of those that open in its page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from branchdrive.contract.columns import PATTERNS
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.text import counted, printable
from branchdrive.engine.finding import Finding
from branchdrive.engine.group_result import GroupResult
from branchdrive.text.brief import brief
from branchdrive_reference.report.encode import encoded_scene
from branchdrive_reference.report.facts import DatasetReport, GroupFacts, Seen, scenes
from branchdrive_reference.report.fault import Fault, Faults
from branchdrive_reference.report.images import camera_images
from branchdrive_reference.report.roads import Roads
from branchdrive_reference.report.template import island
from branchdrive_reference.report.thumbnail import Thumbnail, thumbnail
from branchdrive_reference.study.label import label

__all__ = ["NO_FINDING", "WITH_FINDINGS", "Card", "Gallery", "played_group"]

PLAYED_BYTES = 5_600_000
"""Data of groups that open in the page itself, without images."""

IMAGE_BYTES = 2_000_000
"""Of all camera images of the page."""

PAGE_BYTES = 10_000_000
"""What a whole page aims at; where figures and cards are many, fewer groups open in it."""

_TEXT_BYTES = 1_000_000
_CARD_BYTES = 2_900
"""What tables, findings and scripts of a page take, and a card with its drawing."""

WITH_FINDINGS, NO_FINDING = "with findings", "no finding"
"""What groups are filtered by, beside single rules."""

_MOST_CARDS = 1000


class Card(NamedTuple):
    """A group of the gallery."""

    group_id: str
    scenario_type: str
    town: str
    partition: str
    outcome: str
    tone: str
    contact: str
    contact_text: str
    rules: Sequence[str]
    picture: Thumbnail | None
    remark: str
    place: int | None
    href: str | None

    @property
    def findings(self) -> list[str]:
        """What it is filtered by: whether there are findings, and of which rules."""
        return [WITH_FINDINGS, *self.rules] if self.rules else [NO_FINDING]


class Gallery:
    """Groups of a report as cards, and the data of those that its page plays.

    Args:
        report: The report.
        folder: Address of the folder of pages of single groups; ``None`` where there are none.
        faults: What is wrong in single groups.
    """

    def __init__(self, report: DatasetReport, folder: str | None, faults: Faults) -> None:
        self.folder = folder
        self.faults = faults
        self.played: list[Any] = []
        self.towns: dict[str, Any] = {}
        self.beside: list[GroupFacts] = []
        self._report = report
        self._places: dict[str, int] = {}
        self._found: dict[str, tuple[Thumbnail | None, Any, str]] = {}
        self._links: dict[str, str] = {}
        self._spots: dict[tuple[str, str], list[Finding]] = {}

    def cards(self) -> list[Card]:
        """Cards of the first groups, each with its drawing."""
        report, dataset = self._report, self._report.dataset
        if dataset is None:
            return []
        facts = {group.group_id: group for group in report.groups}
        order = _mixed(report.groups, self.faults)[:_MOST_CARDS]
        roads = Roads(dataset.descriptor)
        share = IMAGE_BYTES // max(len(order), 1)
        for seen in scenes(dataset, frozenset(group.group_id for group in order), self.faults):
            roads.collect(seen.rows)
            if group_id := seen.scene.group_id:
                picture, document, contact = played_group(facts[group_id], seen, roads, dataset.descriptor, share)
                self._found[group_id] = picture, island(document), contact
                self._note(group_id, seen.faults)
        self._choose(order)
        self.towns = roads.packed()
        shown = {group.group_id for group in order}
        return [self._card(group) for group in report.groups if group.group_id in shown]

    def href(self, finding: Finding) -> str | None:
        """Where the player shows the place of a finding; ``None`` where no group of it opens."""
        name = str(finding.group_id)
        if name not in self._links:
            return None
        spots = self._spots.get((name, finding.rule), [])
        same = (i for i, spot in enumerate(spots) if _place(spot) == _place(finding))
        first = next(same, 0)
        return f"{self._links[name]}-{finding.rule}-{first}" if spots else self._links[name]

    def group_href(self, name: str) -> str | None:
        """Where the player shows a group, named safe to print; ``None`` where it does not open."""
        return self._links.get(name)

    def _note(self, group_id: str, faults: Sequence[Fault]) -> None:
        name = printable(group_id[:128])
        for fault in faults:
            self._spots[name, fault.info.id] = [spot.finding for spot in fault.spots]

    @property
    def text(self) -> str:
        """How many groups open, and what became of the others."""
        num, played = len(self._report.groups), len(self.played)
        text = f"{counted(num, 'group')}; {'all open' if played == num else f'{played:,} open'} in the player."
        if played < num and self.folder is not None:
            text += " The others open in pages of their own beside this file."
        elif played < num:
            text += " A file of bounded size has no room for the others, or they hold nothing that can be drawn."
        return text

    def _choose(self, order: Sequence[GroupFacts]) -> None:
        """Keep the data of as many groups as there is room for, in the order of the dataset."""
        figures = sum(4 * len(content) // 3 for content in self._report.figures.values())
        beside = _TEXT_BYTES + _CARD_BYTES * len(order) + figures
        room, kept = min(PLAYED_BYTES + IMAGE_BYTES, max(PAGE_BYTES - beside, 0)), set()
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
                self._links[printable(group.group_id[:128])] = f"#play-{len(self.played)}"
                self.played.append(self._found[group.group_id][1])
            elif self.folder is not None and re.fullmatch(PATTERNS["id"], group.group_id):
                self.beside.append(group)
                self._links[group.group_id] = f"{self.folder}/{group.group_id}.html#play-0"

    def _card(self, group: GroupFacts) -> Card:
        picture, _, contact = self._found.get(group.group_id, (None, "", "unknown"))
        place = self._places.get(group.group_id)
        is_beside = self.folder is not None and place is None and re.fullmatch(PATTERNS["id"], group.group_id)
        result = group.result
        tone = "note" if result is None else "good" if result.qualifies else "warning"
        return Card(
            label(group.group_id), label(group.scenario_type), label(group.town), group.partition, group.outcome, tone,
            contact, _CONTACTS[contact], self.faults.rules_of(group.group_id), picture,
            "" if picture else "Nothing of this group can be drawn.", place,
            f"{self.folder}/{group.group_id}.html" if is_beside else None,
        )  # fmt: skip


_CONTACTS = {
    "nominal touches": "The nominal drive touches something.",
    "an intervention touches": "Some intervention touches something.",
    "none touches": "No candidate touches anything.",
    "unknown": "Contacts are unknown.",
}


def _place(finding: Finding) -> list[Any]:
    return [finding.location.get(part) for part in ("rollout_id", "tick", "actor_id", "table", "column")]


def _mixed(groups: Sequence[GroupFacts], faults: Faults) -> list[GroupFacts]:
    """Groups in the order in which they get room: one of all that fail alike and have one type after the other."""
    kinds: dict[tuple[str, ...], list[GroupFacts]] = {}
    for group in groups:
        alike = group.outcome, group.scenario_type, *faults.rules_of(group.group_id)
        kinds.setdefault(alike, []).append(group)
    turns = max(map(len, kinds.values()), default=0)
    return [members[turn] for turn in range(turns) for members in kinds.values() if turn < len(members)]


def played_group(
    group: GroupFacts,
    seen: Seen,
    roads: Roads,
    descriptor: Descriptor,
    image_bytes: int,
) -> tuple[Thumbnail | None, dict[str, Any], str]:
    """Drawing, data for the player and contacts of a group."""
    scene, rows = seen.scene, seen.rows
    remarks = list(scene.remarks)
    branch = "" if scene.branch_tick is None else f"branch at tick {scene.branch_tick}"
    about = [label(group.scenario_type), label(group.town), group.partition, group.outcome, branch]
    document: dict[str, Any] = {
        "name": label(group.group_id), "town": group.town,
        "about": " · ".join(text for text in about if text),
    }  # fmt: skip
    if group.result is not None and not group.result.qualifies:
        remarks.insert(0, _why_lost(group.result))
    if not seen.is_judged:
        remarks.append("Rules on rows did not run here; what is wrong with the files is in the report.")
    picture, contact = None, "unknown"
    if scene.futures:
        elements = roads.around(group.town, scene)
        if not elements:
            remarks.append(f"There is no map of {label(group.town)} around this group.")
        picture = thumbnail(scene, elements)
        images = camera_images(rows, scene, descriptor, image_bytes)
        remarks += images.remarks
        document |= {**encoded_scene(scene), "at": list(scene.origin[:2])}
        if images.text:
            document |= {"images": images.found, "image_text": images.text}
        if "evidence" in rows.streams:
            contact = "none touches"
            if any(len(future.contacts) for future in scene.futures[1:]):
                contact = "an intervention touches"
            if len(scene.futures[0].contacts):
                contact = "nominal touches"
    document["remarks"] = remarks
    document["faults"] = [fault.to_json() for fault in seen.faults]
    document["judged"] = group.result is not None
    return picture, document, contact


def _why_lost(result: GroupResult) -> str:
    """Why a group does not qualify, in a sentence or two."""
    hint, _, title = result.reason.removesuffix(result.detail).rpartition("does not hold: ")
    if not result.detail and not title:
        return f"This group does not qualify: {result.reason}."
    (detail,) = brief(result.detail)
    said = f": {hint.rstrip('; ')}" if hint else ""
    return f"This group does not qualify{said}. What it breaks is “{title}”{detail}."
