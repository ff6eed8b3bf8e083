"""Results of flows as JSON, so that another process reads the same values, and the same exceptions, from the storage.

Prefect's own JSON keeps of an exception its class and text, and calls the class with the text. Simyard's exceptions
have more than a text: the code of a stage, the faults of a document, the report of a run. So this module writes what
an exception was made of. Where Simyard is not installed, Prefect gives the same values as dictionaries.
"""

from collections.abc import Callable
from typing import Annotated, cast

from prefect.serializers import JSONSerializer, prefect_json_object_encoder
from pydantic import AfterValidator, JsonValue

from specs.base import Fault, Spec
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, PipelineNotPassed, SimyardError, StageFailed

# Prefect 3.8 takes whatever has "data" for a record of its older format, and would give the data alone, as a dictionary
# (docs/reference/prefect.md, section 8). No record has such metadata; the decoder does not look at them.
_NO_RECORD: dict[str, JsonValue] = {"metadata": None}


class FailureParts(Spec):
    """What an exception was made of.

    Attributes:
        error: The name of its class in ``specs.errors``.
        text: What it says.
        code: Of a stage that failed.
        reason: Of a stage that failed.
        arn: Of a stage that failed.
        faults: Of a document.
        source: Of a document.
        report: Of a run that did not pass.
    """

    error: str
    text: str
    code: str = ""
    reason: str = ""
    arn: str = ""
    faults: tuple[Fault, ...] = ()
    source: str = ""
    report: PipelineReport | None = None


def encode_result(value: object) -> JsonValue:
    """Returns what JSON has no word for as JSON: a document, or an exception. Prefect calls it."""
    if isinstance(value, SimyardError):
        return {"__class__": f"{__name__}.Failure", "data": _parts(value).model_dump(mode="json"), **_NO_RECORD}
    encoded: dict[str, JsonValue] = prefect_json_object_encoder(value)
    return {**encoded, **_NO_RECORD}


def _parts(failure: SimyardError) -> FailureParts:
    parts: dict[str, object] = {"error": type(failure).__name__, "text": str(failure)}
    if isinstance(failure, StageFailed):
        parts |= {"code": failure.code, "reason": failure.reason, "arn": failure.arn}
    elif isinstance(failure, DocumentError):
        parts |= {"faults": failure.faults, "source": failure.source}
    elif isinstance(failure, PipelineNotPassed):
        parts |= {"report": failure.report}
    return FailureParts.model_validate(parts)


def _failure(parts: FailureParts) -> SimyardError:
    kind = _kinds(SimyardError).get(parts.error, SimyardError)
    if issubclass(kind, StageFailed):
        return kind(parts.code, parts.reason, parts.arn)
    if issubclass(kind, DocumentError):
        return kind(parts.faults, parts.source)
    if parts.report is not None:
        return PipelineNotPassed(parts.report)
    return cast("Callable[[str], SimyardError]", kind)(parts.text)


def _kinds(base: type[SimyardError]) -> dict[str, type[SimyardError]]:
    found = {base.__name__: base}
    for below in base.__subclasses__():
        found |= _kinds(below)
    return found


Failure = Annotated[FailureParts, AfterValidator(_failure)]
"""What Prefect's decoder makes an exception of."""


def result_serializer() -> JSONSerializer:
    """Returns how Prefect shall write the results of a flow."""
    return JSONSerializer(object_encoder=f"{__name__}.{encode_result.__name__}")
