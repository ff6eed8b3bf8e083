"""What strangers have put into a store and a browser may look at: reports, trends, contact sheets; and floor plans.

An address names a job, a world or a document; the key is made from that, so no address reaches anything else.
"""

from contextlib import suppress
from urllib.parse import quote

from flows.gateway.page.request_context import RequestContext, address, job, known_job, missing, newest_jobs, read_bytes
from specs.errors import DocumentError, ObjectTooBig
from specs.field_types import OutputLocation
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.gateway.page.render import stored_content_headers
from tasks.gateway.rest_json import HttpAnswer
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import contact_sheet_key, output_key, trend_key, world_key
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import document_of_run, jobs_of
from tasks.storage.worlds import decode_world

REPORT = "report.html"
_TYPES = {
    REPORT: "text/html; charset=utf-8",
    "audit.json": "application/json",
    "results.parquet": "application/vnd.apache.parquet",
    "failures.parquet": "application/vnd.apache.parquet",
}
_SVG = "image/svg+xml"
_MOST_BYTES = 64 << 20
_MOST_WORLD_BYTES = 4 << 20
_RUNS_LOOKED_AT = 200
_DRAWING_KEPT_S = 300


def has_report(record: JobRecord) -> bool:
    """Returns whether a batch's report is there."""
    return "report_url" in record.detail


def report_address(record: JobRecord) -> str:
    """Returns where the report of a batch is shown."""
    return f"{address('simulation-job-batch', record.id)}/{REPORT}"


def trend_address(document: str) -> str:
    """Returns where the nights of a document are shown: beside the batches, as the links of a report have it.

    Empty for a name that no trend can have.
    """
    try:
        trend_key(document)
    except DocumentError:
        return ""
    return f"/batches/trends/{quote(document, safe='')}.html"


def batch_file(context: RequestContext, batch: str, name: str) -> HttpAnswer:
    """Returns one of the files beside a batch's report, or the report.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no batch's.
    """
    record = job(context, BATCH, batch)
    body = _from_bucket(context, recorded_location(record), f"{record.id}/{name}") if name in _TYPES else None
    if body is None:
        raise missing("simulation-job-batch", f"{batch}/{name}")
    saved = "" if name == REPORT else name
    return HttpAnswer(200, body, _TYPES[name], headers=stored_content_headers(file_name=saved))


def trend_file(context: RequestContext, document: str) -> HttpAnswer:
    """Returns the page of a document's nights, which lies beside the batches of its newest runs.

    Raises:
        ResourceNotFound: None of the newest runs that may be seen is of this document, or its trend is not there.
        DocumentError: The name can be no document's.
    """
    key = trend_key(document)
    for name in newest_jobs(context, RUN)[:_RUNS_LOOKED_AT]:
        run = known_job(context.store, RUN, name)
        if run is None or document_of_run(run) != document:
            continue
        for kind, batch in jobs_of(run):
            record = known_job(context.store, BATCH, batch) if kind == BATCH else None
            body = _from_bucket(context, recorded_location(record), key) if record else None
            if body is not None:
                return HttpAnswer(200, body, _TYPES[REPORT], headers=stored_content_headers())
    raise missing("pipeline-run", document)


def contact_sheet(context: RequestContext, generation: str) -> HttpAnswer:
    """Returns the picture of a generation job's worlds.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    context.require("world-generation-job", generation)
    body = read_bytes(context.store, contact_sheet_key(generation))
    if body is None:
        raise missing("world-generation-job", generation)
    return HttpAnswer(200, body, _SVG, headers=stored_content_headers(keep_s=_DRAWING_KEPT_S))


def floor_plan(context: RequestContext, generation: str, name: str) -> HttpAnswer:
    """Returns the drawing of a world.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no world's.
        pydantic.ValidationError: What lies there is no world.
    """
    context.require("world", f"{generation}/{name}")
    world = decode_world(world_body(context, generation, name))
    return HttpAnswer(200, floor_plan_svg(world).encode(), _SVG, headers=stored_content_headers(keep_s=_DRAWING_KEPT_S))


def world_body(context: RequestContext, generation: str, name: str) -> bytes:
    """Returns the document of a world.

    Raises:
        ResourceNotFound: There is none, or it may not be seen, or it is bigger than any that Simyard makes.
        DocumentError: The name can be no world's.
    """
    context.require("world", f"{generation}/{name}")
    body = None
    with suppress(ObjectTooBig):
        body = read_bytes(context.store, world_key(generation, name), _MOST_WORLD_BYTES)
    if body is None:
        raise missing("world", f"{generation}/{name}")
    return body


def _from_bucket(context: RequestContext, place: OutputLocation, name: str) -> bytes | None:
    bucket = open_bucket(context.store, place.s3Bucket or "")
    return read_bytes(bucket, output_key(place.s3Prefix, name), _MOST_BYTES)
