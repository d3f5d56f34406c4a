"""Judges a dataset by the raw rules: one SQL statement for each rule over the Parquet files, in DuckDB.

Statements lie in `sql/`, one file for each rule, or are written from the declared columns (`values`).
A statement gives one row for each finding; its columns are the keys of the report's locations.
Files without the identity of a rule prepare tables that several rules read.
"""

import re
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import documents
import duckdb
import layout
import media
import tables
import values
from contract import BOUNDS, LIMITS, RAW_TABLES, RULES, VERSION
from layout import Folder, Location

SQL = Path(__file__).parent / "sql"
NO_SUBJECT = "no subject"
UNREADABLE = "files or documents that it needs cannot be read"
EXIT_CODES = {"valid": 0, "invalid": 1, "partial": 3}

LAYOUT_RULES = {f"BD-LAY-{number:03}": getattr(layout, f"lay_{number:03}") for number in (1, 2, 3, 4, 5, 6, 7, 8, 10)}


@cache
def claims() -> list[str]:
    """Identities of the rules that this checker judges, in the order of the catalogue."""
    judged = {path.stem for path in SQL.glob("BD-*.sql")} | {*values.VIOLATIONS, *LAYOUT_RULES}
    judged |= {f"BD-DOC-{number:03}" for number in range(1, 6)} | {f"BD-TAB-{number:03}" for number in range(1, 7)}
    judged |= {"BD-LAY-009", "BD-ENC-001", "BD-FRM-002", "BD-FRM-013"}
    return [rule["id"] for rule in RULES if rule["id"] in judged]


@cache
def _script(name: str) -> str:
    return (SQL / f"{name}.sql").read_text(encoding="utf-8")


def _subjects(sql: str) -> str:
    """What a statement examines, as its first line says."""
    return sql.partition("\n")[0].removeprefix("-- subjects: ")


@dataclass
class Outcome:
    """What one rule found: a status, a reason where it was not judged, and locations."""

    status: str
    reason: str | None = None
    examined: int = 0
    locations: tuple[Location, ...] = ()


def outcome(locations: list[Location], examined: int = 1) -> Outcome:
    """Fails where there is a location, passes where something was examined."""
    if locations:
        return Outcome("fail", None, examined, tuple(locations))
    return Outcome("pass", None, examined) if examined else Outcome("skipped", NO_SUBJECT)


class Judgement:
    """The judgement of one dataset, rule by rule in the order of spec/07-rules.md#order."""

    def __init__(self, root: Path, connection: duckdb.DuckDBPyConnection):
        self.folder = Folder(root)
        self.connection = connection
        self.descriptor: dict[str, Any] = {}
        self.outcomes: dict[str, Outcome] = {}
        self.parameters: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.judge()

    def judge(self) -> None:
        """Judges files and documents first, then what the tables hold."""
        self._judge_layout()
        self._judge_documents()
        self._judge_tables()
        if self.descriptor:
            self._bind()
            self._prepare_rows()
            self._judge_media()
            self._judge_structure()
            self._judge_attempts()
            self._judge_groups()
        else:
            self._judge_media()
        for rule in RULES:
            if not self.is_whole and rule["grain"] in ("row", "rollout", "group") and not self.failed(rule["id"]):
                self.outcomes[rule["id"]] = Outcome("skipped", UNREADABLE)
            if self.descriptor and not self._is_about(rule):
                self.outcomes[rule["id"]] = Outcome("not-claimed", "the descriptor claims none of its streams")
            self.outcomes.setdefault(rule["id"], Outcome("skipped", UNREADABLE))

    def failed(self, rule: str) -> bool:
        """Whether a rule failed."""
        return rule in self.outcomes and self.outcomes[rule].status == "fail"

    def _judge_layout(self) -> None:
        self.outcomes["BD-LAY-001"] = outcome(layout.lay_001(self.folder))
        for rule in (rule for rule in RULES if rule["id"] in LAYOUT_RULES and rule["id"] != "BD-LAY-001"):
            if self.failed("BD-LAY-001") and "BD-LAY-001" in rule.get("requires", ()):
                self.outcomes[rule["id"]] = Outcome("skipped", UNREADABLE)
            else:
                found = LAYOUT_RULES[rule["id"]](self.folder)
                self.outcomes[rule["id"]] = outcome(found, layout.num_examined(rule["id"], self.folder))

    def _judge_documents(self) -> None:
        self._judge_descriptor()
        self.outcomes["BD-LAY-009"] = outcome(layout.lay_009(self.folder, self.descriptor or documents.EVERYTHING))

    def _judge_descriptor(self) -> None:
        found, value = documents.doc_001(self.folder)
        self.outcomes["BD-DOC-001"] = outcome(found)
        if found:
            return
        self.outcomes["BD-DOC-005"] = outcome(documents.doc_005(value))
        for rule, check in (
            ("BD-DOC-002", documents.doc_002),
            ("BD-DOC-003", documents.doc_003),
            ("BD-DOC-004", documents.doc_004),
        ):
            self.outcomes[rule] = outcome(check(value))
            if self.failed(rule):
                return
        self.descriptor = value
        if documents.has_own_encoding(value):
            self.outcomes["BD-ENC-001"] = Outcome("skipped", "an encoding of the dataset's own cannot be recomputed")
        else:
            encoding = documents.enc_001(value)
            self.outcomes["BD-ENC-001"] = outcome(encoding or [], examined=int(encoding is not None))

    def _bind(self) -> None:
        """Parameters of the statements: declared bounds, and what the descriptor says."""
        noise = self.descriptor["collection"].get("replay_noise", 0)
        noise = noise if isinstance(noise, dict) else {"kind": "injected" if noise else "exact"}
        tolerances = self.descriptor.get("tolerances", {})
        self.parameters = {
            **BOUNDS,
            "max_route_vertices": LIMITS["max_route_vertices"],
            "actuator": float(tolerances.get("actuator", 0)),
            "evidence": float(tolerances.get("evidence", 1e-6)),
            "unrecorded": self.descriptor.get("unrecorded", []),
            "cameras": documents.claimed_cameras(self.descriptor),
            "has_evidence": "actor_risk_evidence" in self.descriptor["streams"],
            "is_log": (self.descriptor.get("driver") or {}).get("kind") == "log",
            "has_drives": "decisions" in self.descriptor["streams"],
            "has_map": "map" in self.descriptor["streams"],
            "noise": noise["kind"],
            "scenario_types": self.descriptor["collection"].get("scenario_types", []),
            "wheelbase_m": (self.descriptor.get("vehicle") or {}).get("wheelbase_m"),
            "single_axis": (self.descriptor.get("vehicle") or {}).get("actuation") == "single_axis",
        }

    def _execute(self, statement: str) -> duckdb.DuckDBPyConnection:
        """Runs one statement with the parameters that it names."""
        names = set(re.findall(r"\$([a-z][a-z0-9_]*)", statement))
        return self.connection.execute(statement, {name: self.parameters[name] for name in names})

    def _prepare(self, name: str) -> None:
        """Runs the statements of a script, which a blank line parts."""
        for statement in _script(name).split(";\n\n"):
            self._execute(statement)

    def _judge_tables(self) -> None:
        connection, claimed = self.connection, documents.claimed_tables(self.descriptor or documents.EVERYTHING)
        tables.create(connection)
        reading = tables.read(connection, self.folder, claimed, is_claim=bool(self.descriptor))
        limits = [*self.outcomes["BD-LAY-007"].locations, *reading.found.pop("BD-LAY-007")]
        self.outcomes["BD-LAY-007"] = outcome(limits)
        if self.folder.shards and not self._count("rollouts"):
            reading.found["BD-TAB-006"].append({"table": "rollouts"})
        for rule in (rule for rule in RULES if rule["id"] in reading.found):
            if any(self.failed(required) for required in rule.get("requires", ())):
                self.outcomes[rule["id"]] = Outcome("skipped", UNREADABLE)
            else:
                self.outcomes[rule["id"]] = outcome(reading.found[rule["id"]], reading.examined[rule["id"]])
        self.tables = [table for table in RAW_TABLES if table in claimed]
        self.is_whole = reading.is_whole

    def _prepare_rows(self) -> None:
        """What statements on rows read beside the tables: the bank, and functions."""
        self.connection.execute(
            "create or replace temp table policy (key varchar, duration_ticks integer, recovery varchar, "
            + ", ".join(f"{name}_rule varchar, {name}_value float" for name in ("steer", "throttle", "brake"))
            + ")"
        )
        rows = [
            [
                policy["key"],
                policy["duration_ticks"],
                policy["recovery"],
                *(policy[name].get(item) for name in ("steer", "throttle", "brake") for item in ("rule", "value")),
            ]
            for policy in self.descriptor["action_bank"]["policies"]
        ]
        self.connection.executemany(f"insert into policy values ({', '.join('?' * 9)})", rows)
        self._prepare("macros")

    def _judge_structure(self) -> None:
        """Structure rules on rows; what they find excludes rollouts and groups from later rules."""
        for rule in RULES:
            if rule["kind"] == "structure" and rule["id"] not in self.outcomes:
                if rule["id"] in values.VIOLATIONS:
                    sql = values.statement(rule["id"], self.tables)
                    self._judge_rule(rule, sql)
                elif rule["id"] in claims():
                    self._judge_rule(rule, _script(rule["id"]))
        rules = [rule["id"] for rule in RULES if rule["grain"] not in ("file", "document")]
        found = [place for rule in rules if rule in self.outcomes for place in self.outcomes[rule].locations]
        rollouts = {
            (place["rollout_id"], layout.shard_of(place.get("file", ""))) for place in found if "rollout_id" in place
        }
        groups = {place["group_id"] for place in found if "group_id" in place and "rollout_id" not in place}
        self.connection.execute(
            "create or replace temp table faulty_group as select unnest($groups::varchar[]) as group_id",
            {"groups": sorted(groups)},
        )
        # a row that names an attempt of another shard does not belong to this one
        self.connection.execute(
            "create or replace temp table faulty as select r.rollout_id from rollouts r join ("
            "select unnest($rollouts::varchar[]) as rollout_id, unnest($shards::varchar[]) as shard) f "
            "on f.rollout_id = r.rollout_id and coalesce(f.shard, r.shard) = r.shard "
            "union select rollout_id from rollouts semi join faulty_group using (group_id) "
            "where rollout_id is not null",
            {"rollouts": [name for name, _ in rollouts], "shards": [shard for _, shard in rollouts]},
        )
        elements = {(place["town"], place["element_id"]) for place in found if {"town", "element_id"} <= place.keys()}
        self.connection.execute(
            "create or replace temp table faulty_element as select unnest($towns::varchar[]) as town, "
            "unnest($names::varchar[]) as element_id",
            {"towns": [town for town, _ in elements], "names": [name for _, name in elements]},
        )
        self.connection.execute("create or replace temp table failed (rule varchar, rollout_id varchar)")
        self.connection.execute("create or replace temp table judged (rule varchar, attempts integer)")

    def _judge_attempts(self) -> None:
        """Qualification rules on rollouts; their failures decide who complies."""
        with_evidence = ["evidence"] * self.parameters["has_evidence"]
        with_map = ["walls", "surfaces"] * self.parameters["has_map"]
        for name in ("attempts", "targets", "motion", *with_evidence, "results", "histories", *with_map):
            self._prepare(name)
        for rule in RULES:
            is_judged = rule["id"] in claims() and self._is_about(rule)
            if rule["kind"] == "qualification" and rule["grain"] == "rollout" and is_judged:
                self._judge_rule(rule, _script(rule["id"]))
                judged = self.outcomes[rule["id"]]
                self.connection.execute("insert into judged values (?, ?)", [rule["id"], judged.examined])
                failing = [[rule["id"], place["rollout_id"]] for place in judged.locations]
                if failing:
                    self.connection.executemany("insert into failed values (?, ?)", failing)

    def _judge_groups(self) -> None:
        """Rules on groups and on the dataset, after the choice of candidates."""
        for name in ("choice", "replays", "response", "calibration", "prevalence"):
            self._prepare(name)
        for rule in RULES:
            if rule["id"] not in self.outcomes and self._is_about(rule) and (SQL / f"{rule['id']}.sql").exists():
                self._judge_rule(rule, _script(rule["id"]))

    def _is_about(self, rule: dict[str, Any]) -> bool:
        if rule["scope"] == "group" and "decisions" in self.descriptor["streams"]:
            return False  # drives are in no branch group
        return "streams" not in rule or bool(set(rule["streams"]) & set(self.descriptor["streams"]))

    def _judge_rule(self, rule: dict[str, Any], sql: str | None) -> None:
        """Runs the statement of a rule; rollouts that fail a rule that it requires are left out of it."""
        if not self._is_about(rule):
            return
        if sql is None:
            self.outcomes[rule["id"]] = outcome([], examined=0)
            return
        required = {
            place["rollout_id"]
            for name in rule.get("requires", ())
            if name in self.outcomes
            for place in self.outcomes[name].locations
            if "rollout_id" in place
        }
        examined = sum(self._count(subject, required) for subject in _subjects(sql).split(" + "))
        if not examined:
            self.outcomes[rule["id"]] = Outcome("skipped", NO_SUBJECT)
            return
        cursor = self._execute(sql)
        names = [name for name, *_ in cursor.description]
        rows = [zip(names, row, strict=True) for row in cursor.fetchall()]
        places = [_place(dict(row)) for row in rows]
        found = [place for place in places if place.get("rollout_id") not in required]
        self.outcomes[rule["id"]] = outcome(found, examined)

    def _count(self, subjects: str, left_out: Collection[str] = ()) -> int:
        """Rows of a table, or of a table under a condition, without those of attempts that are left out."""
        if left_out:
            rows = self._execute(f"select rollout_id from {subjects}").fetchall()
            return sum(rollout_id not in left_out for (rollout_id,) in rows)
        if subjects not in self.counts:
            ((self.counts[subjects],),) = self._execute(f"select count(*) from {subjects}").fetchall()
        return self.counts[subjects]

    def _judge_media(self) -> None:
        """Rules on files of images: BD-FRM-002, BD-FRM-013, and limits of the index."""
        whole = " and ".join(f"{name} is not null" for name in media.COLUMNS.split(", "))
        rows = [
            media.Row(*row) for row in self._execute(f"select {media.COLUMNS} from frames where {whole}").fetchall()
        ]
        cameras = {camera["name"]: camera for camera in self.descriptor.get("cameras", [])}
        shards = {row.shard for row in rows} | (set(self.folder.shards) if self.is_whole else set())
        found = media.judge(self.folder, rows, cameras, shards)
        beyond = {layout.shard_of(str(place["file"])) for place in found.limits}
        if beyond:
            self.outcomes["BD-LAY-007"] = outcome([*self.outcomes["BD-LAY-007"].locations, *found.limits])
            for rule in RULES:
                if "BD-LAY-007" in rule.get("requires", ()) and not self.failed(rule["id"]):
                    self.outcomes[rule["id"]] = Outcome("skipped", UNREADABLE)
        num_rows = dict(self._execute("select shard, count(*) from frames group by shard").fetchall())
        examined = sum(number for shard, number in num_rows.items() if shard not in beyond)
        self.outcomes["BD-FRM-002"] = outcome(found.places, examined)
        self.outcomes["BD-FRM-013"] = outcome(found.archives, found.num_archives)

    def report(self) -> dict[str, Any]:
        """The report, in the form of `report.schema.json` as far as this checker judges."""
        verdict = "valid"
        decisive = [rule for rule in RULES if rule["kind"] in ("structure", "claim") and rule["level"] == "MUST"]
        if any(self.failed(rule["id"]) for rule in decisive):
            verdict = "invalid"
        elif self.descriptor.get("layers", ["raw"]) != ["raw"] or any(
            self.outcomes[rule["id"]].status == "skipped" and self.outcomes[rule["id"]].reason != NO_SUBJECT
            for rule in decisive
        ):
            verdict = "partial"
        rules, findings = [], []
        for rule in RULES:
            judged = self.outcomes[rule["id"]]
            rules.append(
                {
                    **{name: rule[name] for name in ("id", "title", "kind", "grain")},
                    "status": judged.status,
                    "reason": judged.reason,
                    "examined": judged.examined,
                    "total": judged.examined,
                    "num_findings": len(judged.locations),
                    "num_waived": 0,
                    "url": f"docs/rules/{rule['id']}.md",
                }
            )
            places = Counter(
                tuple(sorted((key, printable(value)) for key, value in place.items())) for place in judged.locations
            )
            findings += [
                {"rule": rule["id"], "kind": rule["kind"], "location": dict(place), "count": count}
                for place, count in places.items()
            ]
        return {
            "verdict": verdict,
            "exit_code": EXIT_CODES[verdict],
            "spec_version": VERSION,
            "rules": rules,
            "findings": findings,
        }


def _place(row: Location) -> Location:
    """The location that a row of a statement stands for: the shard of a row in a table names its file."""
    place = {name: value for name, value in row.items() if value is not None}
    if shard := place.pop("shard", None):
        place = {"file": f"{shard}/{place['table']}.parquet", **place}
    return place


def printable(value: Any) -> Any:
    """A part of a location; a text in printable ASCII, with every other character escaped."""
    return "".join(c if " " <= c <= "~" else ascii(c)[1:-1] for c in value) if isinstance(value, str) else value


def connect() -> duckdb.DuckDBPyConnection:
    """A database in memory with one thread: tables of a shard are small, and threads cost more than they give."""
    connection = duckdb.connect(config={"threads": 1})
    connection.execute("set enable_progress_bar = false")
    return connection


def judge(root: Path, connection: duckdb.DuckDBPyConnection | None = None) -> dict[str, Any]:
    """Judges one dataset; a connection may serve many, one after the other."""
    return Judgement(root, connection or connect()).report()
