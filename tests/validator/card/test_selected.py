"""The card's section on contacts of selections: there with a benchmark that reports them, and with its warnings."""

from __future__ import annotations

from typing import Any

from branchdrive.card.selected import selected_section

NOTHING = {"value": 0.0, "low": None, "high": None}


def entry(selector: str, contact: float, avoidable: float) -> dict[str, Any]:
    rates = {
        "contact": {"value": contact, "low": 0.01, "high": 0.5},
        "avoidable_contact": {**NOTHING, "value": avoidable},
    }
    return {"selector": selector, "outcomes": {"targets": [], **rates}}


def results(*profiles: dict[str, Any], **ranking: Any) -> dict[str, Any]:
    return {"warnings": ["Look out."], "ranking": {"contact_m": 0.0, "profiles": list(profiles), **ranking}}


BALANCED = {
    "profile": "balanced",
    "num_ranked": 222,
    "entries": [entry("nominal", 0.0, 0.0), entry("oracle", 0.12, 0.1)],
}
NEAR = {"profile": "near_range", "num_ranked": 222, "entries": [entry("nominal", 0.0, 0.0), entry("oracle", 0.0, 0.0)]}


def test_contacts_of_every_selector_and_profile_are_told() -> None:
    lines = selected_section(results(BALANCED, NEAR))
    assert lines[:4] == ["## Contacts of selections", "", "> **Warning.** Look out.", ""]
    assert "| Selector | balanced | near_range |" in lines
    assert "| oracle | 12.0% [1.0%, 50.0%] | 0.0% [1.0%, 50.0%] |" in lines
    assert any("at most 0 m, in 222 groups of the test partition" in line for line in lines)
    (said,) = [line for line in lines if line.startswith("Under ")]
    assert said == (
        "Under `balanced`: A contact is selected although a candidate without one exists: the oracle in 10.0% of "
        "groups, where this utility prefers it."
    )


def test_without_declared_outcomes_a_card_is_as_it_was() -> None:
    undeclared = results(BALANCED)
    del undeclared["ranking"]["contact_m"]
    assert selected_section(None) == selected_section(undeclared) == selected_section(results()) == []
