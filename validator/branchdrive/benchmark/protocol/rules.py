"""Rule of the protocol, and the protocol as rules see it."""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.benchmark.protocol.protocol import BenchmarkProtocol, protocol_problem, read_protocol
from branchdrive.contract.layout import PROTOCOL_FILE
from branchdrive.contract.mismatch import Check, Mismatch, PreconditionError
from branchdrive.contract.rule import rule
from branchdrive.errors import DatasetError
from branchdrive.layers.compare import document_check
from branchdrive.layers.view import ReleaseView


def protocol_of(view: ReleaseView) -> BenchmarkProtocol:
    """The protocol of the layer.

    Raises:
        PreconditionError: It cannot be read.
    """
    try:
        return read_protocol(view.document(PROTOCOL_FILE))
    except DatasetError as error:
        raise PreconditionError(f"{PROTOCOL_FILE}: {error}") from error


@rule("BD-BMK-001")
def protocol_is_consistent(view: ReleaseView) -> Iterator[Check]:
    """Names differ, profiles are weighed to 1, and families and guard name what is declared."""
    problem = protocol_problem(view.document(PROTOCOL_FILE))
    yield document_check(
        PROTOCOL_FILE,
        1,
        [] if problem is None else [Mismatch({"pointer": "/"}, "a protocol without contradiction", problem)],
    )
