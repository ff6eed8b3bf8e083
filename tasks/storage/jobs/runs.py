"""A run of a flow: a document's identity and a number (docs/decisions/0003).

The same document run again after a crash continues the run that did not end; run again after an end, it begins the
next.
"""

import re
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress

from pydantic import JsonValue

from specs.errors import ResourceNotFound
from specs.job_kinds import JOB_KINDS, JobKind
from specs.pipeline.generation_parts import generation_tokens
from specs.settings import MAX_WORLDS
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimRecord, hold_claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read, request_digest, submit

KIND: JobKind = "pipeline-run"
FLOW_RUN = "flow_run"
"""Where a run's detail says which of Prefect's flow runs works on it."""
FLOW_RUN_BEFORE = "flow_run_before"
"""Where it says which flow run of a dead process worked on it, if a process without Prefect goes on."""
WORLDS_OF_JOB = "worlds_of_job"
"""Where it says how many worlds one of its generation jobs makes at most."""
_STAGE_TOKEN = re.compile(r"(run-[0-9a-f]{16})-.+")
Waiting = Callable[[JobRecord, ClaimRecord], None]


def _nobody(_run: JobRecord, _holder: ClaimRecord) -> None:
    """Drops what is told: nobody watches."""


@contextmanager
def begin_run(
    store: Store, identity: dict[str, JsonValue], waiting: Waiting = _nobody, awaited: str = ""
) -> Generator[JobRecord, None, None]:
    """Yields the run of a document, which no other live process works on inside the ``with`` block.

    Waits while another process works on it; the yielded record is terminal when that one ended it, and then there is
    nothing left to do but to tell its result.

    Args:
        store: Where runs are recorded.
        identity: All that decides the outcome: the flow's name, the document, digests of what it refers to.
        waiting: Told several times a second of the run and who works on it, for as long as another process does.
        awaited: Id of the run that this one waited for before it came again: that is its run, also if it has ended
            meanwhile. Empty for none; one of another document is none.
    """
    digest = request_digest(identity)
    token = _awaited_token(store, digest, awaited) or _open_run(store, digest[:32])
    record = submit(store, KIND, identity, token)
    with hold_claim(store, claim_key(KIND, record.id), waiting=lambda holder: waiting(record, holder)):
        yield read(store, KIND, record.id)


def stage_token(run: JobRecord, stage: str) -> str:
    """Returns the client request token of one of a run's stages."""
    return f"{run.id}-{stage}"


def document_of_run(run: JobRecord) -> str:
    """Returns the name of the document that a run is of; of a stage that runs alone, its flow's."""
    spec = run.request.get("spec")
    name = spec.get("name") if isinstance(spec, dict) and run.request.get("flow") == "pipeline" else None
    return str(name or run.request.get("flow", ""))


def run_of(token: str) -> str:
    """Returns the id of the run that a stage's token was made for; empty for a token of a document's own."""
    found = _STAGE_TOKEN.fullmatch(token)
    return found[1] if found else ""


def worlds_of_job(store: Store, token: str) -> int:
    """Returns how many worlds a generation job of a run makes at most, as its record says from the first question on.

    A machine with another SIMYARD_MAX_WORLDS so goes on with the jobs that the run has begun.

    Args:
        store: Where the run is.
        token: Of one of the run's stages; of a stage without a run it is what this machine allows.
    """
    most, run = MAX_WORLDS.value(), run_of(token)
    if not run:
        return most
    record = read(store, KIND, run)
    if _recorded_size(record) is None:
        record = advance(store, KIND, run, record.status, detail={WORLDS_OF_JOB: most}, only_from={record.status})
    return _recorded_size(record) or most


def _recorded_size(run: JobRecord) -> int | None:
    known = run.detail.get(WORLDS_OF_JOB)
    return known if type(known) is int and known > 0 else None


def jobs_of(run: JobRecord) -> Iterator[tuple[JobKind, str]]:
    """Yields kind and id of each job that a run has begun or may begin, in the order of its stages."""
    spec = run.request.get("spec")
    sections = spec if isinstance(spec, dict) else {}
    flow = run.request.get("flow")
    for kind, declared in JOB_KINDS.items():
        if flow == "pipeline" and declared.section and declared.section in sections:
            token = _own_token(sections[declared.section])
            yield from _jobs(run, kind, sections[declared.section], token or stage_token(run, declared.stage))
        elif declared.flow and flow == declared.flow:
            yield from _jobs(run, kind, spec, _own_token(spec) or stage_token(run, declared.flow))


def _jobs(run: JobRecord, kind: JobKind, section: JsonValue, token: str) -> Iterator[tuple[JobKind, str]]:
    """Yields the jobs of one section: a world generation may take several."""
    generates = kind == "world-generation-job"
    tokens = generation_tokens(section, token, _recorded_size(run)) if generates else [token]
    for each in tokens:
        yield kind, job_id(kind, each)


def _own_token(section: JsonValue) -> str:
    token = section.get("clientRequestToken") if isinstance(section, dict) else None
    return token if isinstance(token, str) else ""


def _awaited_token(store: Store, digest: str, awaited: str) -> str:
    """Returns the token of the run that was waited for; empty if there is none of this document."""
    if awaited:
        with suppress(ResourceNotFound):
            run = read(store, KIND, awaited)
            return run.token if run.request_digest == digest else ""
    return ""


def _open_run(store: Store, digest: str) -> str:
    """Returns the token of the newest run if it is still open, else of the one after it."""
    newest = _newest(store, digest)
    if newest and not is_terminal(read(store, KIND, _id(digest, newest))):
        return _token(digest, newest)
    return _token(digest, newest + 1)


def _newest(store: Store, digest: str) -> int:
    """Returns the number of the newest run, 0 for none.

    Runs are numbered without gaps, so doubling and halving finds the last of a thousand nights in twenty requests, and
    no listing has to be believed.
    """
    known, unknown = 0, 1
    while _exists(store, digest, unknown):
        known, unknown = unknown, unknown * 2
    while unknown - known > 1:
        middle = (known + unknown) // 2
        if _exists(store, digest, middle):
            known = middle
        else:
            unknown = middle
    return known


def _exists(store: Store, digest: str, number: int) -> bool:
    try:
        read(store, KIND, _id(digest, number))
    except ResourceNotFound:
        return False
    return True


def _id(digest: str, number: int) -> str:
    return job_id(KIND, _token(digest, number))


def _token(digest: str, number: int) -> str:
    return f"{digest}-{number}"
