"""Findings in a real browser: their places on map, time and in the charts, and the ways there and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
from tests.reference_impl.report.browser import drawn, opened, violations, visits
from tests.reference_impl.report.reading import Page, made
from tests.reference_impl.report.samples import every, written
from tests.synthetic import BRANCH_TICK


def test_what_of_a_damaged_group_is_drawn_and_what_is_not_is_said(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path, width=390, scheme="dark") as visit:
        assert violations(visit.page) == []
        opened(visit)
        said = visit.page.locator("#player-remarks").text_content()
        assert "no attempt is recorded" in said
        for mode in "123":
            visit.press(mode, "ArrowRight")
            assert visit.state("dialog.scrollWidth <= dialog.clientWidth")
        assert "brake 0.30, attempt 1 (not drawn)" in visit.page.locator("#fault-list").text_content()
        assert violations(visit.page) == []
        visit.press("n")
        assert visit.page.locator("#player-whole").is_hidden()
        assert "Floating-point values are finite" in visit.page.locator("#fault-list").text_content()
        assert visit.page.locator("#fault-list button").count() == 0
        assert violations(visit.page) == []
        visit.press("n")
        assert "No rule finds anything" in visit.page.locator("#faults").text_content()


def test_the_example_of_a_finding_leads_to_its_place_in_the_player_and_back(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path) as visit:
        example = visit.page.locator("#BD-VAL-002 a.play[href='#play-0-BD-VAL-002-0']")
        example.focus()
        visit.press("Enter")
        shown = visit.state("[player.group.name, nameOf(chosenFutures()[0]), player.tick]")
        assert shown == ["g0", "accelerate 0.50", 20]
        assert "yaw_rad of actors" in visit.page.locator("#spot-text").text_content()
        pressed = visit.page.locator("#fault-list button[aria-pressed=true]")
        assert pressed.text_content() == f"accelerate 0.50, actor 1, at tick {BRANCH_TICK + 20}, +1.00 s"
        assert visit.state("location.hash") == "#play-0-BD-VAL-002-0"
        assert violations(visit.page) == []
        visit.press("Space")
        visit.until("player.tick > 20")
        visit.press("Space", "Escape")
        visit.until("location.hash === ''")
        assert visit.state("document.activeElement.hash") == "#play-0-BD-VAL-002-0"
        visit.press("Enter")
        visit.page.locator("#fault-list a", has_text="BD-VAL-002").focus()
        visit.press("Enter")
        assert not visit.state("dialog.open")
        assert visit.state("document.activeElement.closest('article').id") == "BD-VAL-002"


def test_the_page_of_a_rule_is_open_where_a_link_leads_to_it(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path) as visit:
        assert not visit.state("document.getElementById('page-BD-VAL-002').open")
        visit.page.locator("#BD-VAL-002 a[href='#page-BD-VAL-002']").click()
        visit.until("document.getElementById('page-BD-VAL-002').open")


def test_the_way_back_from_the_page_of_a_rule_is_the_way_of_the_browser(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path) as visit:
        visit.page.locator("#BD-VAL-002 a.play").first.click()
        visit.press("f")
        place = visit.state("location.hash")
        visit.page.locator("#fault-list a", has_text="about this rule").first.click()
        assert not visit.state("dialog.open")
        assert visit.state("location.hash").startswith("#page-BD-")
        visit.page.go_back()
        visit.until("dialog.open")
        assert visit.state("location.hash") == place
        visit.page.go_back()
        visit.until("!dialog.open")


def test_places_of_findings_are_marked_on_time_and_map_and_reached_by_keys(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path, fragment="#play-0-BD-VAL-002-0") as visit:
        marks = "[...document.querySelectorAll('#time-marks span')].map((one) => one.textContent + one.className)"
        assert sorted(visit.state(marks)) == ["▼chosen", "▽"]
        (left,) = visit.state("[...document.querySelectorAll('#time-marks .chosen')].map((one) => one.offsetLeft)")
        thumb = visit.state("(() => { const one = byId('time'); return 8 + (one.clientWidth - 16) * 120 / 230; })()")
        assert abs(left - thumb) < 2
        figures = ("#map-a", "#chart-speed")
        with_marks = {figure: drawn(visit, figure) for figure in figures}
        visit.state("player.group.spots = []; redraw()")
        assert all(drawn(visit, figure) != with_marks[figure] for figure in figures)
    with visits(browser, damaged_page.path, fragment="#play-0") as visit:
        ticks, number = [], visit.state("player.group.spots.length")
        for place in range(number):
            visit.press("f")
            ticks.append(visit.state("player.spot.tick ?? 1e9"))
            assert visit.page.locator("#spot-text").text_content().startswith(f"Place {place + 1} of {number}: ")
            assert visit.page.locator("#fault-list [aria-pressed=true]").count() == 1
        assert ticks == sorted(ticks)
        visit.press("f", "Shift+F", "Shift+F")
        assert visit.page.locator("#spot-text").text_content().startswith(f"Place {number - 1} of {number}: ")
        visit.press("Shift+F")
        visit.page.locator("#fault-list button").first.focus()
        visit.press("f")
        assert visit.state("document.activeElement.getAttribute('aria-pressed')") == "true"


def test_a_place_before_the_history_is_shown_with_its_candidate_and_the_nominal(
    browser: Any, damaged_page: Page
) -> None:
    with visits(browser, damaged_page.path, fragment="#play-0-BD-VAL-002-1") as visit:
        assert visit.state("[player.tick, time.first, byId('time').min]") == [-100, -100, "-100"]
        shown = "Object.fromEntries(player.group.futures.map((one) => [one.key, one.tick[0]]))"
        begins = visit.state(shown)
        assert begins["nominal"] == -BRANCH_TICK
        assert begins["brake_0.50"] <= -BRANCH_TICK + 5  # its first place is no number
        assert set(begins.values()) <= {-BRANCH_TICK, -BRANCH_TICK + 5, -80}
        of = "[one.tick, one.x, one.gap, one.commandTick, one.commands[2]].map((two) => two.length)"
        lengths = visit.state(f"player.group.futures.map((one) => {of})")
        assert all(a == b == c and d == e for a, b, c, d, e in lengths)
        assert "(fails 3 rules)" in visit.page.locator("#candidate-a option:checked").text_content()


def test_a_speed_that_a_finding_doubts_stands_beside_that_of_the_positions(browser: Any, tmp_path: Path) -> None:
    made(written(tmp_path / "d", {"observations": every("speed_mps", 30.0)}), tmp_path / "report.html")
    with visits(browser, tmp_path / "report.html", fragment="#play-0") as visit:
        visit.press("f")
        said = visit.page.locator("#chart-speed figcaption").text_content()
        assert "30.0 m/s, of the positions " in said
        assert "of the positions 30.0" not in said


def test_outcomes_of_every_candidate_that_findings_doubt_say_so(browser: Any, tmp_path: Path) -> None:
    """Findings of thirteen candidates, of which no two say the same."""

    def scaled(table: pa.Table) -> pa.Table:
        names = table["rollout_id"].to_pylist()
        share = {name: 0.5 + 0.02 * place for place, name in enumerate(dict.fromkeys(names))}
        values = table["separation_m"].to_pylist()
        found = [None if v is None else v * share[name] for name, v in zip(names, values, strict=True)]
        return table.set_column(table.column_names.index("separation_m"), table.field("separation_m"), [found])

    made(written(tmp_path / "d", {"evidence": scaled}), tmp_path / "report.html")
    with visits(browser, tmp_path / "report.html", fragment="#play-0") as visit:
        rows = [row.locator("td").all_text_contents() for row in visit.page.locator("#outcomes tr").all()]
        assert len(rows) == 13
        assert all(gap.endswith(" in doubt") for gap, *_ in rows)
        assert not any("in doubt" in speed for _, speed, *_ in rows)


def test_groups_with_findings_are_filtered(browser: Any, damaged_page: Page) -> None:
    with visits(browser, damaged_page.path) as visit:
        findings = visit.page.locator("select[data-filter=rules]")
        for value, names in (("with findings", ["g0", "g1"]), ("no finding", ["g2"]), ("BD-VAL-002", ["g0"])):
            findings.select_option(value)
            assert visit.page.locator(".card:visible h3").all_text_contents() == names
