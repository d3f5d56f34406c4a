"""Tables of guards and of the noise of outcomes, with what the guards promise."""

from __future__ import annotations

from branchdrive.benchmark.promise import UNGUARDED, noise_floor, promises
from branchdrive.benchmark.ranking.ranking import SEPARATION
from branchdrive.benchmark.table.markdown import NONE, Document, Rows, ends_of, number, plain, table
from branchdrive.driving.target import TARGETS

__all__ = ["guard_tables", "noise_tables"]

_FIGURES = (
    ("coverage", "Coverage"),
    ("violation", "Violation"),
    ("violation_of_clusters", "Violation, clusters"),
    ("violation_of_interventions", "Violation, interventions"),
    ("intervention", "Intervention"),
    ("gain", "Gain"),
    ("retained_gain", "Retained gain"),
    ("separation_difference_m", "Separation, m"),
)


def guard_tables(results: Document) -> list[list[str]]:
    """Sections of lines; a guard that was not judged has its reason."""
    guard = results["guard"]
    if not guard["profiles"]:
        return [["## Guard", "", f"Not judged: {plain(guard['reason'])}"]]
    sections = [
        table(f"Guard, profile {p['profile']}", results, *_guard_profile(p, results)) for p in guard["profiles"]
    ]
    promise = ["## What the guards promise", *(line for text in promises(results) for line in ("", text))]
    return [*sections, promise]


def _guard_profile(profile: Document, results: Document) -> tuple[list[str], Rows, list[str]]:
    rows = []
    for selection in profile["selections"]:
        figures = [selection["figures"][name] for name, _ in _FIGURES]
        cells = [
            NONE if found["value"] is None else f"{number(found['value'])} {ends_of(found)}".removesuffix(f" {NONE}")
            for found in figures
        ]
        rows.append([selection["selection"], *cells, str(selection["num_actions"])])
    margin = profile["global_margin"]
    test = margin["test"]
    notes = [
        f"N = {profile['num_groups']} groups. Global margin {margin['margin_m']:.3f} m, order statistic "
        f"{margin['rank']} of {margin['num_groups']}; on test it covers {test['covered_candidates']:.3f} of candidates "
        f"and {test['covered_groups']:.3f} of groups, and accepts {test['acceptance']:.3f} of interventions."
    ]
    if test["vacuous"]:
        notes.append("The global margin is vacuous: it accepts no intervention in any group.")
    for name, title in (("conformal", "Selection-path conformal"), ("learn_then_test", "Learn then test")):
        found = profile[name]
        price = "nominal alone" if found["price"] is None else f"price {found['price']:.4g}"
        refused = "" if found["refusal"] is None else f" Not judged: {plain(found['refusal'])}."
        size = f"{found['num_groups']} groups in {found['num_clusters']} clusters"
        notes.append(f"{title}: {price}, calibrated on {size}.{refused}")
    notes.append(UNGUARDED)
    if (floor := noise_floor(results)) is not None:
        notes.append(floor)
    return ["Selection", *(title for _, title in _FIGURES), "Actions"], rows, notes


def noise_tables(results: Document) -> list[list[str]]:
    """Sections of lines; none where no nominal was repeated."""
    noise = results["noise"]
    if noise is None:
        return []
    rows = [
        [f"{t.symbol}, {t.unit}", number(noise["tolerance"][i], 4), number(noise["rms"][i], 4),
         str(noise["num_groups"][i])]
        for i, t in enumerate(TARGETS)
    ]  # fmt: skip
    header = ["Target", "Tolerance", "Root mean square", "N groups, training"]
    floor = noise_floor(results)
    sections = [table("Noise of outcomes", results, header, rows, [] if floor is None else [floor])]
    selections = [
        (profile["profile"], selection)
        for profile in results["guard"]["profiles"]
        for selection in profile["selections"]
        if selection["beyond_noise"] is not None
    ]
    if selections:
        counted = [
            [profile, found["selection"], *_beyond(found["beyond_noise"]), _separation(found)]
            for profile, found in selections
        ]
        header = ["Profile", "Selection", *(target.symbol for target in TARGETS), "Mean D_min, m"]
        note = (
            "Groups whose selected difference to nominal exceeds the tolerance, for the worse and for the better, of "
            "those that have one. The tolerance is that of one group; the mean difference of separation stands beside "
            "the standard error that repetition alone gives it."
        )
        sections.append(table("Selected differences beyond noise", results, header, counted, [note], 2))
    return sections


def _beyond(found: Document) -> list[str]:
    counts = zip(found["num_worse"], found["num_better"], found["num_compared"], strict=True)
    return [f"{worse} + {better} / {compared}" for worse, better, compared in counts]


def _separation(found: Document) -> str:
    """Mean difference of separation with the standard error from repetition."""
    error = found["beyond_noise"]["standard_error"][SEPARATION]
    mean = number(found["figures"]["separation_difference_m"]["value"])
    return mean if error is None else f"{mean} (noise {error:.3f})"
