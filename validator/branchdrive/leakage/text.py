"""What a leakage audit says, as plain sentences that the card and the reports share. Source: spec/10-layers.md#card."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from branchdrive.leakage.streams import IMAGES

__all__ = ["leakage_sentences"]

_PLACES_SHOWN = 3


_PATTERNS = {
    "one": "in one feature of one action",
    "dense": "as a dose over all actions on a quarter of the features",
    "tenth": "as such a dose in one group of ten",
    "thirtieth": "as such a dose in one group of thirty",
}


_VERDICTS = {
    "pass": "passes: its tests found nothing before the branch that tells the actions apart",
    "fail": "fails: replays before the branch tell actions apart, so results on this release cannot be trusted",
    "inconclusive": "is inconclusive, which is no pass",
}


_NOT_EXAMINED = (
    "Not examined by the gate: {images}which actor is which, spreads of recorded columns that are no features, "
    "digits below the noise, relations between columns other than products of two commands, relations between "
    "actions, orders of actions that groups do not share, and a code in fewer than one group of thirty that hides in "
    "noise. A smaller effect, or one of another form, may be there; in one column of few groups it takes more than in "
    "a quarter of the features."
)


_STATUSES = {"pass": "pass", "fail": "fail", "inconclusive": "inconclusive", "not_run": "not run"}


def leakage_sentences(leakage: Mapping[str, Any] | None) -> list[str]:
    """Verdict of the leakage gate, its reason, the minimum detectable effect, and the diagnostic battery.

    Args:
        leakage: Document ``leakage.json``; None where leakage was not audited.
    """
    if leakage is None:
        return ["Leakage was not audited: nothing is known about whether inputs tell the action that follows."]
    gate = leakage["gate"]
    shape = gate["shape"]
    seen = (
        f"{shape['groups']:,} groups, {shape['actions']:,} actions, {shape['features']:,} features and "
        f"{shape['columns']:,} recorded columns before the branch"
    )
    sentences = [f"The leakage gate {_VERDICTS[gate['verdict']]} ({seen}).", _sentence(gate["reason"])]
    if gate["verdict"] == "fail":
        sentences += [_place_sentence(place) for place in gate["places"][:_PLACES_SHOWN]]
        alpha = leakage["protocol"]["gate"]["alpha"]
        sentences += [_code_sentence(code) for code in gate["codes"] if code["p"] <= alpha][:_PLACES_SHOWN]
    sentences += [*_effect(gate), *_images(leakage), *_battery(leakage)]
    return [sentence for sentence in sentences if sentence]


def _images(leakage: Mapping[str, Any]) -> list[str]:
    """What the gate saw of images, and what it did not examine."""
    columns = [name for name in leakage["inputs"]["variables"]["streams"] if name.startswith(f"{IMAGES}/")]
    if not columns:
        return ["No images that models may read were recorded.", _NOT_EXAMINED.format(images="")]
    cameras = dict.fromkeys(name.removeprefix(f"{IMAGES}/").partition(" ")[0] for name in columns)
    seen = (
        "Images before the branch were examined by their sizes, by how many differ, and by brightness and its place "
        f"in the cells of a grid: {', '.join(cameras)}."
    )
    return [seen, _NOT_EXAMINED.format(images="what of an image none of these numbers shows, ")]


def _battery(leakage: Mapping[str, Any]) -> list[str]:
    """What the tests of the diagnostic battery came to, and why some did not run."""
    counts = Counter(test["status"] for way in leakage["battery"]["ways"] for test in way["tests"])
    if not counts:
        return []
    counts_text = ", ".join(f"{counts[status]} {title}" for status, title in _STATUSES.items() if counts[status])
    reasons = dict.fromkeys(_sentence(entry["reason"]) for entry in leakage["not_run"])
    return [f"The battery of classifiers, a diagnostic beside the gate: {counts_text}.", *reasons]


def _place_sentence(place: Mapping[str, Any]) -> str:
    at = f"{place['source']} {place['variable']}{_ticks(place['offset_ticks'])}"
    return f"Action {place['action']} differs in {at} by {place['difference']:.3g} (adjusted p {place['p']:.2g})."


def _code_sentence(code: Mapping[str, Any]) -> str:
    columns = " and ".join(
        f"{column['source'].replace('_', ' ')} {column['variable']}{_ticks(column['offset_ticks'])}"
        for column in code["columns"]
    )
    found = (
        "Groups put their actions in one order in"
        if code["statistic"] == "concordance"
        else "A product tells the actions apart:"
    )
    return f"{found} {columns} ({code['groups']:,} groups, adjusted p {code['p']:.2g})."


def _effect(gate: Mapping[str, Any]) -> list[str]:
    effect = gate["minimum_detectable_effect"]
    if effect is None:
        why = "replays are bit-identical" if gate["bit_identical"] else "no feature has a value to move"
        return [f"Minimum detectable effect: not applicable, {why}."]
    sentences = []
    for pattern, where in _PATTERNS.items():
        offsets = sorted(found["offset_sd"] for found in effect["detections"] if found["pattern"] == pattern)
        smallest = effect["smallest_sd"].get(pattern)
        if smallest is not None:
            least = "at most " if offsets and smallest == offsets[0] else ""
            found = f"{least}{smallest:g} standard deviations"
        else:
            found = f"above {offsets[-1]:g} standard deviations" if offsets else "unknown"
        sentences.append(f"Minimum detectable effect {where}: {found}.")
    return sentences


def _ticks(span: list[int] | None) -> str:
    if span is None:
        return ""
    return f" at tick {span[0]}" if span[0] == span[-1] else f" at ticks {span[0]} to {span[-1]}"


def _sentence(text: str) -> str:
    text = text.strip()
    return text if not text or text.endswith(".") else f"{text}."
