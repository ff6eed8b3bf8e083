"""The kinds of jobs: one declaration each, with its names, its stage of a pipeline, and the objects that it keeps.

A form is a key with named parts, such as ``worlds/{generation}/{world}.json``. ``tasks.storage.base.keys`` fills forms,
and housekeeping recognises what was written by them.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

from specs.field_types import BAG_ENDINGS

JobKind = Literal["world-generation-job", "world-export-job", "simulation-job-batch", "deployment-job", "pipeline-run"]

WORLD = "worlds/{generation}/{world}.json"
CONTACT_SHEET = "worlds/{generation}/contact-sheet.svg"
EXPORT_PART = "parts/{export}/{generation}/{world}.zip"
EXPORT_ZIP = "{export}.zip"
FLOOR_PLANS = ("{export}/{world}.svg", "{export}/{generation}/{world}.svg")
CHUNK = "chunks/{batch}/{number:06d}.json"
CHUNK_START = "chunks/{batch}/{number:06d}.started.json"
SEARCH_STEP = "searches/{batch}/{digest}/{number:06d}.json"
AUDIT_NOTE = "results/{batch}/audit-begun.json"
BATCH_FILES = tuple(
    f"{{batch}}/{name}" for name in ("results.parquet", "failures.parquet", "report.html", "audit.json")
)
RECORDING = "recordings/{batch}/{number:06d}.parquet"
BAGS = tuple(
    f"bags/{{batch}}/{{number:06d}}{ending}{'' if '.' in ending else '/{file}'}" for ending in BAG_ENDINGS.values()
)
"""What ROS's tools read, by the number of the episode: a file, or a folder of files."""
TAGS = "tags/{kind}/{name}.json"
"""Tags that a resource was given after it was made."""
TAGS_WITHIN = "tags/{kind}/{parent}/{name}.json"
"""The same of one that belongs to another: a world to its generation job, a simulation job to its batch."""
_WORLD_TAGS = TAGS_WITHIN.format(kind="world", parent="{generation}", name="{world}")
_JOB_TAGS = TAGS_WITHIN.format(kind="simulation-job", parent="{batch}", name="{index}")


class JobObjects(NamedTuple):
    """Objects of one sort that the jobs of a kind keep.

    Attributes:
        what: What `simyard gc` calls them.
        forms: The forms of their keys.
        in_bucket: Whether they lie in a document's bucket, below its prefix, and not in the store.
        from_elsewhere: Whether other jobs' records may name them, and people may add such objects: only what a job of
            this store made is freed, and only when nobody names that job.
        spent: Why they go as soon as their job has ended; empty if they stay as long as its record.
    """

    what: str
    forms: tuple[str, ...]
    in_bucket: bool = False
    from_elsewhere: bool = False
    spent: str = ""


def _tags(kind: JobKind, part: str, *others: str) -> JobObjects:
    return JobObjects("tags", (TAGS.format(kind=kind, name=f"{{{part}}}"), *others))


class JobDeclaration(NamedTuple):
    """All that is known of a kind of job without running one.

    Attributes:
        kind: RoboMaker's word for it, which is part of its ARNs.
        prefix: What the ids of its jobs begin with.
        part: What its id is called in the forms of its objects.
        event: What Prefect's events call it: ``simyard.<event>.<status>``.
        flow: The flow that runs one job alone; empty if none does.
        section: The section of a pipeline document that asks for it; empty if none does.
        stage: What the token of the job of a pipeline's run ends in.
        objects: What its jobs keep besides their record, claim and token.
        forgettable: Whether the record of a job that ended long ago may go.
    """

    kind: JobKind
    prefix: str
    part: str
    event: str
    flow: str = ""
    section: str = ""
    stage: str = ""
    objects: tuple[JobObjects, ...] = ()
    forgettable: bool = True


_DECLARATIONS = (
    JobDeclaration(
        "world-generation-job",
        prefix="wgj",
        part="generation",
        event="world-generation",
        flow="world-generation",
        section="worldGeneration",
        stage="worlds",
        objects=(
            JobObjects("worlds", (WORLD, CONTACT_SHEET, _WORLD_TAGS), from_elsewhere=True),
            _tags("world-generation-job", "generation"),
        ),
    ),
    JobDeclaration(
        "world-export-job",
        prefix="wej",
        part="export",
        event="world-export",
        flow="world-export",
        section="worldExport",
        stage="export",
        objects=(
            JobObjects("export parts", (EXPORT_PART,), spent="of exports that are done"),
            JobObjects("exports", (EXPORT_ZIP, *FLOOR_PLANS), in_bucket=True, from_elsewhere=True),
            _tags("world-export-job", "export"),
        ),
    ),
    JobDeclaration(
        "simulation-job-batch",
        prefix="simb",
        part="batch",
        event="simulation-batch",
        flow="simulation-batch",
        section="simulationBatch",
        stage="batch",
        objects=(
            JobObjects("chunks", (CHUNK, CHUNK_START)),
            JobObjects("audit notes", (AUDIT_NOTE,)),
            JobObjects("searches", (SEARCH_STEP,)),
            JobObjects("recordings", (RECORDING,), in_bucket=True, from_elsewhere=True),
            JobObjects("bags", BAGS, in_bucket=True, from_elsewhere=True),
            JobObjects("results", BATCH_FILES, in_bucket=True, from_elsewhere=True),
            _tags("simulation-job-batch", "batch", _JOB_TAGS),
        ),
    ),
    JobDeclaration(
        "deployment-job",
        prefix="dep",
        part="deployment",
        event="deployment",
        flow="deployment-sync",
        section="deployment",
        stage="deployment",
        objects=(_tags("deployment-job", "deployment"),),
    ),
    # Runs of a document are numbered without gaps, and each says how it went; nothing is gained by forgetting one.
    JobDeclaration("pipeline-run", prefix="run", part="run", event="pipeline", forgettable=False),
)
JOB_KINDS: Mapping[JobKind, JobDeclaration] = {each.kind: each for each in _DECLARATIONS}
"""In the order in which a pipeline runs them."""
