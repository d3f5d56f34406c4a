"""Document rules: the descriptor parses, conforms and agrees with itself. Source: spec/03-layout.md#documents."""

from __future__ import annotations

from collections.abc import Iterator

from branchdrive.contract.encoding import ENCODING_NAME, encoding_digest
from branchdrive.contract.layout import DESCRIPTOR_FILE
from branchdrive.contract.machine_trace import trace_of
from branchdrive.contract.mismatch import Check, Location, Mismatch
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.contract.rule import rule
from branchdrive.contract.text import quote
from branchdrive.errors import UsageError
from branchdrive.files.survey import Survey

PLACE: Location = {"file": DESCRIPTOR_FILE}


@rule("BD-DOC-001")
def documents_parse(survey: Survey) -> Iterator[Check]:
    """The descriptor is bounded, well-formed JSON."""
    found = [Mismatch(PLACE, "a JSON document", survey.document_error)] if survey.document_error else []
    yield Check.of(1, tuple(found))


@rule("BD-DOC-002")
def spec_version_is_known(survey: Survey) -> Iterator[Check]:
    """``spec_version`` is the one that this validator implements."""
    if survey.document_error is not None:
        yield Check.of(0, ())
        return
    version = survey.document.get("spec_version") if isinstance(survey.document, dict) else None
    mismatch = Mismatch({**PLACE, "pointer": "/spec_version"}, quote(SPEC_VERSION), quote(version))
    yield Check.of(1, () if version == SPEC_VERSION else (mismatch,))


@rule("BD-DOC-003")
def documents_conform(survey: Survey) -> Iterator[Check]:
    """The descriptor meets its JSON Schema."""
    yield Check.of(int(survey.document_error is None), (found.within(PLACE) for found in survey.schema_mismatches))


@rule("BD-DOC-004")
def descriptor_agrees_with_itself(survey: Survey) -> Iterator[Check]:
    """What no schema can say: unique keys, one nominal policy, cameras of the claimed streams."""
    judged = survey.descriptor is not None or bool(survey.conflicts)
    yield Check.of(int(judged), (found.within(PLACE) for found in survey.conflicts))


def _texts(value: object, pointer: str = "") -> Iterator[tuple[str, str]]:
    """Every text of a document with its JSON pointer."""
    if isinstance(value, str):
        yield pointer or "/", value
    elif isinstance(value, dict):
        for key, member in value.items():
            yield from _texts(member, f"{pointer}/{key.replace('~', '~0').replace('/', '~1')}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _texts(item, f"{pointer}/{index}")


@rule("BD-DOC-005")
def descriptor_names_no_machine(survey: Survey) -> Iterator[Check]:
    """No text of the descriptor holds a path, a host or a time of the machine that wrote it."""
    judged = survey.document_error is None
    yield Check.of(
        int(judged),
        (
            Mismatch({**PLACE, "pointer": pointer}, f"a text without {trace}", quote(text))
            for pointer, text in (_texts(survey.document) if judged else ())
            if (trace := trace_of(text))
        ),
    )


@rule("BD-ENC-001")
def encoding_recomputes(survey: Survey) -> Iterator[Check]:
    """The digest of a declared `bd29` encoding is that of the bank's matrix."""
    declared = survey.descriptor.action_encoding if survey.descriptor else None
    if survey.descriptor is None or declared is None or declared.name != ENCODING_NAME:
        yield Check.of(0, ())
        return
    place: Location = {**PLACE, "pointer": "/action_encoding"}
    try:
        digest = encoding_digest(survey.descriptor.action_bank)
    except UsageError as error:
        yield Check.of(1, (Mismatch(place, f"a bank in the domain of `{ENCODING_NAME}`", str(error)),))
        return
    mismatch = Mismatch(
        {**place, "pointer": "/action_encoding/sha256"}, f"sha256 {digest}", f"sha256 {declared.sha256}"
    )
    yield Check.of(1, () if declared.sha256 == digest else (mismatch,))
