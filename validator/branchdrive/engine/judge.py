"""One rule on one view: run it, count what its checks examined, keep findings of the subjects that mismatch.

Every scope is judged here; a scope says where its subjects are, and nothing else. Source: spec/07-rules.md#order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice

from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.text import failure_text
from branchdrive.engine.finding import Finding
from branchdrive.engine.tally import MAX_FINDINGS_PER_RULE, Tally

__all__ = ["judge", "plain_mismatches"]


def plain_mismatches(check: Check) -> Iterable[Mismatch]:
    """Mismatches of subjects whose place the rule knows itself."""
    return (check.mismatch(int(i)) for i in check.bad)


def judge(
    tally: Tally,
    checks: Callable[[], Iterable[Check]],
    mismatches: Callable[[Check], Iterable[Mismatch]] = plain_mismatches,
    *,
    place: str = "",
    each: Callable[[Check], None] | None = None,
) -> list[Check]:
    """Run a rule and count its checks; what a rule cannot judge, and how it fails, is noted in its tally.

    Args:
        tally: Totals of the rule, which are added to.
        checks: Calls the rule.
        mismatches: Mismatches of a check with whole locations, in order; as many are made as the tally can keep.
        place: Where the rule runs, for the text of a failure.
        each: Called with every check that has subjects that mismatch.

    Returns:
        Checks with subjects that mismatch.
    """
    bad = []
    try:
        for check in checks():
            tally.examined += check.num_examined
            tally.total += check.num_subjects
            tally.num_findings += len(check.bad)
            if len(check.bad):
                bad.append(check)
                room = MAX_FINDINGS_PER_RULE - len(tally.findings)
                tally.keep([Finding.of(tally.rule_id, found) for found in islice(mismatches(check), max(room, 0))])
                if each is not None:
                    each(check)
    except PreconditionError as reason:
        tally.unjudged = str(reason)
    except MemoryError:
        raise
    except Exception:  # a failing rule is a bug of this tool and must not hide the other rules
        tally.errors.append(failure_text(f"{tally.rule_id} on {place}" if place else tally.rule_id))
    return bad
