"""What RoboMaker's calls answer about an export job."""

from pydantic import JsonValue

from specs.robomaker.world_descriptions import DescribeWorldExportJobResponse, WorldExportJobSummary
from tasks.storage.jobs.records import JobRecord

_SUMMARISED = ("worlds", "outputLocation")
_DESCRIBED = (*_SUMMARISED, "iamRole", "tags")


def describe_export_job(record: JobRecord) -> DescribeWorldExportJobResponse:
    """Returns the answer of DescribeWorldExportJob; what is empty is left out."""
    fields: dict[str, JsonValue] = {
        **_state(record),
        **_from_request(record, _DESCRIBED),
        "clientRequestToken": record.token,
    }
    if record.failure_code:
        fields |= {"failureCode": record.failure_code, "failureReason": record.failure_reason}
    return DescribeWorldExportJobResponse.model_validate(fields)


def summarise_export_job(record: JobRecord) -> WorldExportJobSummary:
    """Returns the job's line in ListWorldExportJobs."""
    return WorldExportJobSummary.model_validate({**_state(record), **_from_request(record, _SUMMARISED)})


def _state(record: JobRecord) -> dict[str, JsonValue]:
    return {"arn": record.arn, "status": record.status, "createdAt": record.created_at_s}


def _from_request(record: JobRecord, names: tuple[str, ...]) -> dict[str, JsonValue]:
    return {name: record.request[name] for name in names if name in record.request}
