"""Ends of selected drives computed by another program: SQL over the tables, and intervals by scipy.

It takes tables and choices, and shares nothing with the program that it checks but the seeds' predictions.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy import stats
from tests.validator.benchmark.samples import (
    BANK,
    data_with_endings,
    endings,
    frames,
    noise,
    prediction_set,
    small_protocol,
)

from branchdrive.benchmark.results import results_document

TARGETS = ["min_separation_m", "displacement_m", "mean_jerk_mps3", "max_accel_mps2", "max_yaw_rate_radps"]
WEIGHTS = {
    "balanced": (1 / 3, 1 / 3, 1 / 3), "safety": (0.5, 0.25, 0.25), "progress": (0.25, 0.5, 0.25),
    "comfort": (0.25, 0.25, 0.5), "near_range": (0.5, 0.25, 0.25),
}  # fmt: skip
NOMINAL = BANK.keys.index("nominal")

ENDS = """
WITH it AS (
    SELECT w.selector, x.route_cluster AS cluster, w.share, e.*, n.clean AS nominal_clean,
           n.completed::DOUBLE AS nominal_completed
    FROM chosen w
    JOIN drives e USING (group_id, action_key)
    JOIN drives n ON n.group_id = w.group_id AND n.action_key = 'nominal'
    JOIN contexts x ON x.group_id = w.group_id
    WHERE w.share > 0
)
SELECT selector,
       sum(share * collision) FILTER (collision IS NOT NULL) / sum(share) FILTER (collision IS NOT NULL) AS collision,
       sum(share * off_road) FILTER (off_road IS NOT NULL) / sum(share) FILTER (off_road IS NOT NULL) AS off_road,
       sum(share * infraction) FILTER (infraction IS NOT NULL) / sum(share) FILTER (infraction IS NOT NULL)
           AS infraction,
       sum(share * clean) FILTER (clean IS NOT NULL) / sum(share) FILTER (clean IS NOT NULL) AS clean,
       sum(share * completed) / sum(share) AS completed,
       sum(share) FILTER (clean IS NOT NULL) / sum(share) AS known,
       sum(share * route_fraction) / sum(share) AS route_fraction,
       sum(share * (clean - nominal_clean)) FILTER (clean IS NOT NULL AND nominal_clean IS NOT NULL)
           / sum(share) FILTER (clean IS NOT NULL AND nominal_clean IS NOT NULL) AS clean_to_nominal,
       sum(share * (completed - nominal_completed)) / sum(share) AS completed_to_nominal
FROM it GROUP BY selector
"""

CLUSTERED = """
SELECT x.route_cluster AS cluster, w.group_id, sum(w.share) AS weight, sum(w.share * d.{event}) AS events
FROM chosen w JOIN drives d USING (group_id, action_key) JOIN contexts x USING (group_id)
WHERE w.selector = $selector AND w.share > 0 AND d.{event} IS NOT NULL GROUP BY ALL
"""


@cache
def results() -> dict[str, Any]:
    return results_document(small_protocol(), data_with_endings(), prediction_set(), noise=noise())


def scalar_frame() -> pd.DataFrame:
    """Scalars of the test partition, groups by id and candidates in the order of the bank."""
    homes = dict(zip(frames()["contexts"]["group_id"], frames()["contexts"]["partition"], strict=True))
    scalars = pd.DataFrame({name: np.asarray(values) for name, values in frames()["scalars"].items()})
    scalars["partition"] = scalars.group_id.map(homes)
    scalars["place"] = scalars.action_key.map(BANK.keys.index)
    return scalars.sort_values(["group_id", "place"])


def utilities(profile: str, values: NDArray[np.float64], fitted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Utility of targets in the order of `TARGETS` ``[..., 5]``, by quantiles of `fitted` ``[rows, 5]``."""
    low, high = np.quantile(fitted, [0.05, 0.95], axis=0)
    wanted = np.clip((values - low) / (high - low), 0, 1)
    wanted[..., 2:] = 1 - wanted[..., 2:]
    if profile == "near_range":
        wanted[..., 0] = np.sqrt(np.clip(values[..., 0] / 2.0, 0, 1))
    gap, way, comfort = WEIGHTS[profile]
    return np.asarray(wanted @ np.array([gap, way, *[comfort / 3] * 3]))


def first_of_the_best(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of 1 at the first candidate within 1e-9 of the best ``[groups, candidates]``."""
    taken = (scores >= scores.max(axis=1, keepdims=True) - 1e-9).argmax(axis=1)
    return np.asarray(np.eye(scores.shape[1])[taken])


def drives() -> pd.DataFrame:
    """The table of endings with null where a thing was not monitored, numbers else, and whether a drive is clean."""
    found = pd.DataFrame({name: endings()[name] for name in ("group_id", "action_key")})
    for event in ("collision", "off_road", "infraction"):
        found[event] = np.ma.filled(endings()[event].astype(np.float64), np.nan)
    events = found[["collision", "off_road", "infraction"]]
    found["clean"] = np.where(events.notna().all(axis=1), 1.0 - events.max(axis=1), np.nan)
    found["completed"] = endings()["completed"].astype(np.float64)
    found["route_fraction"] = endings()["route_fraction"].astype(np.float64)
    return found


def shares_of(profile: str) -> dict[str, NDArray[np.float64]]:
    """Shares of some selectors ``[groups, candidates]``."""
    scalars = scalar_frame()
    tested, trained = (scalars[scalars.partition == name] for name in ("test", "train"))
    size = len(BANK.keys)
    fitted = trained[TARGETS].to_numpy()
    executed = utilities(profile, tested[TARGETS].to_numpy(), fitted).reshape(-1, size)
    prior = utilities(profile, fitted, fitted).reshape(-1, size).mean(axis=0)
    clean = tested[["group_id", "action_key"]].merge(drives(), how="left").clean.to_numpy().reshape(-1, size) == 1
    predicted = [p["test"].scalars[..., 1:] for p in prediction_set().by_model["M3"].values()]
    learned = [first_of_the_best(utilities(profile, one, fitted)) for one in predicted]
    nothing = np.zeros_like(executed)
    return {
        "random": nothing + 1 / size,
        "nominal": nothing + np.eye(size)[NOMINAL],
        "action_prior": nothing + np.eye(size)[prior.argmax()],
        "O-M3": np.asarray(np.mean(learned, axis=0)),
        "oracle": first_of_the_best(executed),
        "oracle_clean": first_of_the_best(executed + 2 * clean),
    }


def database(profile: str) -> duckdb.DuckDBPyConnection:
    scalars = scalar_frame()
    groups = scalars[scalars.partition == "test"].group_id.unique()
    chosen = pd.concat(
        pd.DataFrame(
            {
                "selector": selector, "group_id": np.repeat(groups, len(BANK.keys)),
                "action_key": np.tile(BANK.keys, len(groups)), "share": shares.ravel(),
            }
        )
        for selector, shares in shares_of(profile).items()
    )  # fmt: skip
    connection = duckdb.connect()
    contexts = pd.DataFrame({name: frames()["contexts"][name] for name in ("group_id", "route_cluster")})
    for name, frame in (("chosen", chosen), ("drives", drives()), ("contexts", contexts)):
        connection.register(f"{name}_frame", frame)
        # NaN of pandas is null.
        columns = ", ".join(
            f"CASE WHEN isnan({c}) THEN NULL ELSE {c} END AS {c}" if frame[c].dtype == np.float64 else c for c in frame
        )
        connection.execute(f"CREATE TABLE {name} AS SELECT {columns} FROM {name}_frame")
    return connection


def clopper_pearson(rows: pd.DataFrame) -> tuple[float, float]:
    """The interval of a rate by clusters, with the effective number of groups of Korn and Graubard."""
    clusters = rows.groupby("cluster")[["weight", "events"]].sum()
    weight, rate = rows.weight.sum(), rows.events.sum() / rows.weight.sum()
    count = len(clusters)
    if rate in (0.0, 1.0) or count < 2:
        size = weight**2 / (clusters.weight**2).sum()
    else:
        variance = count / (count - 1) * ((clusters.events - rate * clusters.weight) ** 2).sum() / weight**2
        ratio = (stats.t.ppf(0.975, len(rows) - 1) / stats.t.ppf(0.975, count - 1)) ** 2
        size = min(weight**2 / (rows.weight**2).sum(), rate * (1 - rate) / variance * ratio)
    low = 0.0 if rate == 0 else stats.beta.ppf(0.025, size * rate, size * (1 - rate) + 1)
    high = 1.0 if rate == 1 else stats.beta.ppf(0.975, size * rate + 1, size * (1 - rate))
    return float(low), float(high)


@pytest.mark.parametrize("profile", WEIGHTS)
def test_sql_finds_the_same_ends(profile: str) -> None:
    (mine,) = (one for one in results()["ranking"]["profiles"] if one["profile"] == profile)
    entries = {entry["selector"]: entry["outcomes"]["endings"] for entry in mine["entries"]}
    connection = database(profile)
    again = connection.execute(ENDS).df().set_index("selector")
    assert len(again) == 6
    for selector, row in again.iterrows():
        found = entries[selector]
        for event in ("collision", "off_road", "infraction", "clean", "completed"):
            assert found[event]["value"] == pytest.approx(row[event], abs=1e-12), (selector, event)
            clustered = connection.execute(CLUSTERED.format(event=event), {"selector": selector}).df()
            low, high = clopper_pearson(clustered)
            assert (found[event]["low"], found[event]["high"]) == pytest.approx((low, high), abs=1e-9), (
                selector,
                event,
            )
        assert found["known"] == pytest.approx(row.known, abs=1e-12)
        assert found["route_fraction"]["mean"] == pytest.approx(row.route_fraction, abs=1e-12)
        assert found["to_nominal"]["clean"]["value"] == pytest.approx(row.clean_to_nominal, abs=1e-12)
        assert found["to_nominal"]["completed"]["value"] == pytest.approx(row.completed_to_nominal, abs=1e-12)
    tested = scalar_frame().query("partition == 'test'")[["group_id"]].drop_duplicates().merge(drives())
    assert mine["num_with_clean"] == tested.groupby("group_id").clean.max().eq(1).sum()
