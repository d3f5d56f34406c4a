"""The report in a real browser: nothing on the console, no request, every control by keyboard, no violation of axe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.reference_impl.report.browser import drawn, opened, violations, visits
from tests.reference_impl.report.reading import made
from tests.reference_impl.report.samples import HOSTILE, every, written
from tests.sampling import THOROUGH
from tests.synthetic import BRANCH_TICK


@pytest.fixture(scope="module")
def path(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("browser") / "report.html"
    made(dataset, output)
    return output


@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (1280, "light"),
        (390, "dark"),
        pytest.param(1280, "dark", marks=THOROUGH),
        pytest.param(390, "light", marks=THOROUGH),
    ],
)
def test_axe_finds_nothing_and_nothing_runs_over(scheme: str, width: int, browser: Any, path: Path) -> None:
    with visits(browser, path, width=width, scheme=scheme) as visit:
        assert violations(visit.page) == []
        assert visit.state("document.documentElement.scrollWidth") == width
        opened(visit)
        for mode in "132":
            visit.press(mode)
            assert visit.state("dialog.scrollWidth <= dialog.clientWidth")
        over = "(one) => one.getBoundingClientRect().right > innerWidth || one.scrollWidth > one.clientWidth + 1"
        assert not visit.state(f"[...dialog.querySelectorAll('.outcomes, button')].some({over})")
        assert violations(visit.page) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_theme_follows_the_system_until_it_is_chosen(scheme: str, browser: Any, path: Path) -> None:
    with visits(browser, path, scheme=scheme) as visit:
        paper = "getComputedStyle(document.body).backgroundColor"
        before = visit.state(paper)
        assert visit.state("isDark()") == (scheme == "dark")
        visit.page.locator("#theme").focus()
        visit.press("Enter")
        assert visit.state("isDark()") == (scheme == "light")
        assert visit.state(paper) != before


def test_filters_leave_the_groups_that_were_asked_for(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        town = visit.page.locator("select[data-filter=town]")
        town.focus()
        town.select_option("Town13")
        shown = visit.page.locator(".card:visible")
        assert shown.count() == 1
        assert visit.page.locator("#shown-groups").text_content() == "1 of 3 groups"
        visit.page.locator("#reset-filters").click()
        assert shown.count() == 3
        assert visit.page.locator("#reset-filters").is_hidden()


def test_every_control_of_the_player_is_reached_by_tab_and_has_a_name(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        visit.press("2")
        reached = set()
        for _ in range(60):
            visit.press("Tab")
            reached.add(visit.state("document.activeElement.id || document.activeElement.value"))
        controls = {
            "close-player", "next-group", "player-theme", "candidate-a", "candidate-b", "play", "time", "pace",
            "zoom-in", "zoom-out", "follow", "two",
        }  # fmt: skip
        assert controls <= reached
        assert visit.page.locator("#families input").count() == 5
        names = visit.state(
            "[...dialog.querySelectorAll('button, input, select')].filter((one) => !(one.ariaLabel"
            " || one.textContent.trim() || one.labels?.length)).length"
        )
        assert names == 0


def test_keys_move_time_choose_modes_and_leave(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        visit.press("ArrowRight", "ArrowRight")
        assert visit.state("player.tick") == 10
        assert visit.page.locator("#time-text").text_content() == f"tick {BRANCH_TICK + 10}, +0.50 s, intervention"
        assert f"branch at tick {BRANCH_TICK}" in visit.page.locator("#player-facts").text_content()
        assert visit.state("[time.first, byId('time').min]") == [-80, "-80"]
        visit.press("ArrowLeft")
        assert visit.state("player.tick") == 5
        visit.press("Home")
        assert visit.state("player.tick") == 0
        for key, mode in (("2", "two"), ("3", "all"), ("1", "one")):
            visit.press(key)
            assert visit.state("player.mode") == mode
            assert visit.page.locator("#map-b").is_visible() == (mode == "two")
        visit.press("+", "+", "-")
        assert visit.state("player.zoom") > 1
        visit.press("n")
        assert visit.page.locator("#player-title").text_content() == "g1"
        visit.press("p")
        assert visit.page.locator("#player-title").text_content() == "g0"
        visit.press("?")
        assert visit.page.locator("#keys").is_visible()
        visit.press("?")
        assert visit.page.locator("#keys").is_hidden()
        visit.press("Escape")
        assert not visit.state("dialog.open")
        assert visit.state("document.activeElement.dataset.place") == "0"


def test_space_plays_whatever_was_clicked_before(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        for control in (
            "#next-group",
            "#player-theme",
            "#zoom-in",
            "#follow",
            "input[value=two]",
            "#time",
            "#previous-group",
        ):
            visit.page.locator(f"#player {control}").click()
            visit.press("Space")
            assert visit.state("player.isPlaying"), control
            visit.press("Space")
            assert not visit.state("player.isPlaying"), control
        assert visit.state("[player.place, player.mode, player.follow]") == [0, "two", True]
        visit.page.locator("#next-group").focus()
        visit.press("Enter")
        assert visit.state("player.place") == 1


def test_keys_work_after_a_choice_in_a_list_and_boxes_keep_theirs(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        visit.page.locator("#candidate-a").click()
        visit.press("ArrowDown", "Enter")
        assert visit.state("player.a") == 1
        visit.press("3", "ArrowRight")
        assert visit.state("[player.mode, player.a, player.tick]") == ["all", 1, 5]
        visit.page.locator("#candidate-a").focus()
        visit.press("ArrowDown", "ArrowDown", "2")
        assert visit.state("[player.mode, player.a, document.activeElement.id]") == ["two", 3, "candidate-a"]
        visit.page.locator("input[value=two]").focus()
        visit.press("ArrowRight")
        assert visit.state("[player.mode, document.activeElement.value]") == ["all", "all"]
        visit.page.locator("#follow").focus()
        visit.press("Space")
        assert visit.state("[player.follow, player.isPlaying]") == [True, False]


def test_all_candidates_stand_beside_the_chosen_one(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        visit.page.locator("#candidate-a").select_option("3")
        commands = visit.page.locator("#chart-controls figcaption")
        for mode in "13":
            visit.press(mode)
            assert commands.text_content().startswith("Commands of accelerate 0.80 and nominal: ")
            assert " · nominal " in commands.text_content()
        assert "accelerate 0.80 filled" in visit.page.locator("#map-a figcaption").text_content()
        before = drawn(visit, "#map-a")
        visit.page.locator("#candidate-a").select_option("5")
        assert drawn(visit, "#map-a") != before


def test_play_runs_to_the_horizon_and_pauses(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        visit.page.locator("#pace").select_option("2")
        visit.press("Space")
        assert visit.page.locator("#play").text_content() == "Pause"
        visit.until("player.tick > 20")
        visit.press("Space")
        tick = visit.state("player.tick")
        visit.page.wait_for_timeout(100)
        assert visit.state("player.tick") == tick
        assert visit.page.locator("#play").text_content() == "Play"
        visit.press("Space")
        visit.until("player.tick === 130 && !player.isPlaying")


def test_what_is_shown_changes_with_time_candidate_and_families(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        figures = ("#map-a", "#chart-speed", "#chart-gap", "#chart-controls")
        begin = {figure: drawn(visit, figure) for figure in figures}
        visit.press(*["ArrowRight"] * 6)
        moved = {figure: drawn(visit, figure) for figure in figures}
        assert all(begin[figure] != moved[figure] for figure in figures)
        visit.page.locator("#candidate-a").select_option("3")
        chosen = {figure: drawn(visit, figure) for figure in figures}
        assert all(chosen[figure] != moved[figure] for figure in figures)
        assert "accelerate 0.80" in visit.page.locator("#map-a figcaption").text_content()
        visit.page.locator("#families input").nth(2).focus()
        visit.press("Space")
        assert drawn(visit, "#map-a") != chosen["#map-a"]
        assert visit.state("player.hiddenFamilies.size") == 1


def test_actors_of_a_candidate_are_its_own(browser: Any, path: Path) -> None:
    with visits(browser, path) as visit:
        opened(visit)
        own = "player.group.futures.map((future) => [...future.tracks.keys()].length)"
        assert min(visit.state(own)) > 0
        visit.press("2", *["ArrowRight"] * 4)
        assert drawn(visit, "#map-a") != drawn(visit, "#map-b")


def test_places_are_those_that_were_recorded(browser: Any, path: Path, dataset: Path) -> None:
    import numpy as np

    from branchdrive import open_dataset

    group = open_dataset(dataset).group("g1")
    with visits(browser, path) as visit:
        opened(visit, 1)
        for key, (rollout, *_) in group.interventions.items():
            tick = rollout.column("observations", "tick").astype(int) - rollout.branch_tick
            seen = (tick >= -80) & (tick <= 130)
            found = visit.state(
                f"(() => {{ const one = player.group.futures.find((future) => future.key === '{key}');"
                " return [one.tick, one.x.map((x) => x + player.group.at[0]), one.y.map((y) => y + player.group.at[1]),"
                " [...one.tracks.keys()].sort((a, b) => a - b)]; })()"
            )
            assert found[0] == tick[seen].tolist()
            for place, name in ((1, "x_m"), (2, "y_m")):
                assert np.allclose(found[place], rollout.column("observations", name)[seen], atol=0.031)
            assert set(found[3]) <= set(rollout.column("actors", "actor_id").tolist())


def test_hostile_text_is_shown_and_does_nothing(browser: Any, tmp_path: Path) -> None:
    root = written(tmp_path / "d", {"rollouts": every("scenario_type", HOSTILE)})
    made(root, tmp_path / "report.html")
    with visits(browser, tmp_path / "report.html") as visit:
        opened(visit)
        assert "</script>" in visit.page.locator("#player-facts").text_content()
        assert visit.state("window.hostile") is None


def test_a_town_may_have_a_name_that_scripts_know(browser: Any, tmp_path: Path) -> None:
    made(written(tmp_path / "d", {"rollouts": every("town", "constructor")}), tmp_path / "report.html")
    with visits(browser, tmp_path / "report.html") as visit:
        opened(visit)
        assert "constructor" in visit.page.locator("#player-facts").text_content()


def test_an_address_of_no_group_opens_nothing_and_closes_what_is_open(browser: Any, path: Path) -> None:
    with visits(browser, path, fragment="#play-99") as visit:
        assert not visit.state("dialog.open")
        opened(visit)
        visit.state("location.hash = '#play-99'")
        visit.until("!dialog.open")


def test_a_page_of_one_group_opens_and_leads_back(
    browser: Any, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from branchdrive_reference.report import gallery as module

    monkeypatch.setattr(module, "PLAYED_BYTES", 0)
    monkeypatch.setattr(module, "IMAGE_BYTES", 0)
    made(dataset, tmp_path / "a%20b#1.html", "--folder")
    with visits(browser, tmp_path / "a%20b#1.html") as visit:
        visit.page.locator("a.open").first.focus()
        visit.press("Enter")
        visit.until("typeof player !== 'undefined' && dialog.open")
        assert visit.page.locator("#player-title").text_content() == "g0"
        assert violations(visit.page) == []
        visit.press("Escape")
        visit.page.locator("nav a").click()
        visit.page.wait_for_selector("#cards")


def test_the_report_is_readable_without_scripts(browser: Any, path: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(path.as_uri())
    assert page.locator(".card").count() == 3
    assert page.locator("#filters").is_hidden()
    context.close()
