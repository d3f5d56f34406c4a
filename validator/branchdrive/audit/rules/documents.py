"""Document rules: the descriptor parses, conforms and agrees with itself. Source: spec/03-layout.md#documents."""

from __future__ import annotations

from branchdrive.audit.check import SurveyCheck, survey_rule
from branchdrive.audit.finding import Sighting, quote
from branchdrive.audit.survey import Survey
from branchdrive.contract.document import Violation
from branchdrive.contract.encoding import ENCODING_NAME, encoding_digest
from branchdrive.contract.resources import SPEC_VERSION
from branchdrive.dataset.layout import DESCRIPTOR_FILE
from branchdrive.errors import UsageError

PLACE: dict[str, str | int] = {"file": DESCRIPTOR_FILE}


@survey_rule("BD-DOC-001")
def documents_parse(survey: Survey) -> SurveyCheck:
    """The descriptor is bounded, well-formed JSON."""
    found = [Sighting("a JSON document", survey.document_error, PLACE)] if survey.document_error else []
    return SurveyCheck(1, tuple(found))


@survey_rule("BD-DOC-002")
def spec_version_is_known(survey: Survey) -> SurveyCheck:
    """``spec_version`` is the one that this validator implements."""
    if survey.document_error is not None:
        return SurveyCheck(0, ())
    version = survey.document.get("spec_version") if isinstance(survey.document, dict) else None
    sighting = Sighting(quote(SPEC_VERSION), quote(version), {**PLACE, "pointer": "/spec_version"})
    return SurveyCheck(1, () if version == SPEC_VERSION else (sighting,))


def _violations(found: tuple[Violation, ...]) -> tuple[Sighting, ...]:
    return tuple(Sighting(v.expected, v.found, {**PLACE, "pointer": v.pointer or "/"}) for v in found)


@survey_rule("BD-DOC-003")
def documents_conform(survey: Survey) -> SurveyCheck:
    """The descriptor meets its JSON Schema."""
    return SurveyCheck(int(survey.document_error is None), _violations(survey.violations))


@survey_rule("BD-DOC-004")
def descriptor_agrees_with_itself(survey: Survey) -> SurveyCheck:
    """What no schema can say: unique keys, one nominal policy, cameras of the claimed streams."""
    judged = survey.descriptor is not None or bool(survey.conflicts)
    return SurveyCheck(int(judged), _violations(survey.conflicts))


@survey_rule("BD-ENC-001")
def encoding_recomputes(survey: Survey) -> SurveyCheck:
    """The digest of a declared `bd29` encoding is that of the bank's matrix."""
    declared = survey.descriptor.action_encoding if survey.descriptor else None
    if survey.descriptor is None or declared is None or declared.name != ENCODING_NAME:
        return SurveyCheck(0, ())
    place: dict[str, str | int] = {**PLACE, "pointer": "/action_encoding"}
    try:
        digest = encoding_digest(survey.descriptor.action_bank)
    except UsageError as error:
        return SurveyCheck(1, (Sighting(f"a bank in the domain of `{ENCODING_NAME}`", str(error), place),))
    sighting = Sighting(
        f"sha256 {digest}", f"sha256 {declared.sha256}", {**place, "pointer": "/action_encoding/sha256"}
    )
    return SurveyCheck(1, () if declared.sha256 == digest else (sighting,))
