"""What an object is, from its key."""

import re

import pytest

from flows.batch.batch_end import BAGS_FOLDER
from specs.job_kinds import BAGS, BATCH_FILES, RECORDING
from tasks.housekeeping.object_kinds import ObjectKind, StoredJob, digests_in, ids_in, is_record, job_of_id, kind_of_key
from tasks.results.report.report_page import REPORT_FILE
from tasks.results.tables.recordings import RECORDINGS_FOLDER
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE
from tasks.simulate.audit.audit_run import AUDIT_FILE
from tasks.storage.base import keys
from tasks.storage.base.keys import (
    attempt_key,
    bundle_key,
    chunk_key,
    chunk_start_key,
    claim_key,
    contact_sheet_key,
    job_key,
    named_template_key,
    tags_key,
    template_name_key,
    token_key,
    trust_key,
    world_key,
)

BATCH, EXPORT, GENERATION = "simb-0123456789abcdef", "wej-0123456789abcdef", "wgj-0123456789abcdef"
DEPLOYMENT = "dep-0123456789abcdef"


@pytest.mark.parametrize(
    ("key", "what", "job"),
    [
        (world_key(GENERATION, "w-1"), "worlds", GENERATION),
        (contact_sheet_key(GENERATION), "worlds", GENERATION),
        (chunk_key(BATCH, 7), "chunks", BATCH),
        (chunk_start_key(BATCH, 1_000_000), "chunks", BATCH),
        (claim_key("simulation-job-batch", BATCH), "claims", BATCH),
        (job_key("world-export-job", EXPORT), "job records", EXPORT),
        (f"parts/{EXPORT}/g/w.zip", "export parts", EXPORT),
        (tags_key("world", f"{GENERATION}/w-1"), "worlds", GENERATION),
        (tags_key("world-generation-job", GENERATION), "tags", GENERATION),
        (tags_key("world-export-job", EXPORT), "tags", EXPORT),
        (tags_key("simulation-job-batch", BATCH), "tags", BATCH),
        (tags_key("simulation-job", f"{BATCH}/7"), "tags", BATCH),
        (tags_key("deployment-job", DEPLOYMENT), "tags", DEPLOYMENT),
        (f"results/{BATCH}/audit-begun.json", "audit notes", BATCH),
        (f"buckets/out/{EXPORT}.zip", "exports", EXPORT),
        (f"buckets/out/a/{EXPORT}/w.svg", "exports", EXPORT),
        (f"buckets/out/a/{EXPORT}/g/w.svg", "exports", EXPORT),
        (f"buckets/out/a/b/{BATCH}/results.parquet", "results", BATCH),
        (f"buckets/out/{BATCH}/report.html", "results", BATCH),
        (f"buckets/out/recordings/{BATCH}/000001.parquet", "recordings", BATCH),
        (f"buckets/out/bags/{BATCH}/000001.bag", "bags", BATCH),
        (f"buckets/out/bags/{BATCH}/000001-ros1.mcap", "bags", BATCH),
        (f"buckets/out/bags/{BATCH}/000001-rosbag2/metadata.yaml", "bags", BATCH),
    ],
)
def test_what_a_job_made_is_known_by_its_key(key: str, what: str, job: str) -> None:
    assert kind_of_key(key) == ObjectKind(what, job_of_id(job))


@pytest.mark.parametrize(
    ("key", "what"),
    [
        (bundle_key("0" * 64), "bundles"),
        (token_key("pipeline-run", "t"), "tokens"),
        (trust_key("fleet", "12.snapshot.json"), "signed metadata"),
        (f"probe/{'0' * 32}", "probes"),
    ],
)
def test_what_is_no_jobs_is_known_too(key: str, what: str) -> None:
    assert kind_of_key(key) == ObjectKind(what)


@pytest.mark.parametrize(
    "key",
    [
        "store.json",
        "housekeeping/unnamed.json",
        attempt_key("0" * 32, "1" * 32, 25_000_000),
        "templates/t.json",
        named_template_key("wt-0123456789abcdef"),
        template_name_key("a flat"),
        tags_key("world-template", "0" * 64),
        tags_key("world", "shrunk/w"),
        world_key("shrunk", "w"),
        f"results/{BATCH}/evidence.json",
        trust_key("fleet", "1.root.json"),
        trust_key("fleet", "timestamp.json"),
        claim_key("trust", "fleet"),
        "applications/robot-application/courier.json",
        "fleets/f.json",
        "robots/r/desired.json",
        "buckets/out/data.csv",
        f"buckets/out/{BATCH}/notes.txt",
        f"buckets/out/my-{BATCH}/results.parquet",
        f"buckets/out/{EXPORT}.zip.bak",
        "agents/robot/trust/fleet/2.snapshot.json",
        "bundles/not-a-digest",
    ],
)
def test_what_never_goes_is_nothing_to_housekeeping(key: str) -> None:
    assert not kind_of_key(key).what


def test_evidence_and_every_job_application_robot_and_fleet_is_a_record() -> None:
    records = [
        job_key("pipeline-run", "run-1"),
        f"results/{BATCH}/evidence.json",
        "fleets/f.json",
        "robots/r/reported.json",
    ]
    assert all(map(is_record, records))
    assert not any(
        map(is_record, ["store.json", f"results/{BATCH}/audit-begun.json", chunk_key(BATCH, 1), "tokens/a/b"])
    )


def test_the_steps_of_a_search_are_their_batchs() -> None:
    key = keys.search_step_key(BATCH, "a" * 64, 7)
    assert kind_of_key(key) == ObjectKind("searches", StoredJob("simulation-job-batch", BATCH))


def test_a_name_is_found_wherever_it_stands() -> None:
    text = f'{{"arn:simyard:world:s:{GENERATION}/w": "token-of-{BATCH}-worlds", "x{EXPORT}": "{EXPORT}0"}}'
    assert ids_in(text) == {GENERATION, BATCH}
    assert digests_in(f'["{"a" * 64}", "bundles/{"b" * 64}", "{"c" * 65}"]') == {"a" * 64, "b" * 64}


def test_every_folder_of_the_store_was_thought_of() -> None:
    forms = [value for value in vars(keys).values() if isinstance(value, str) and re.match(r"[a-z]+/.*\{", value)]
    known = {"tokens", "jobs", "claims", "templates", "worlds", "parts", "chunks", "results", "bundles", "applications"}
    assert {form.split("/")[0] for form in forms} <= known | {
        "fleets",
        "robots",
        "trust",
        "trends",
        "buckets",
        "queue",
        "actions",
        "housekeeping",
        "tags",
        "world-templates",
        "template-names",
        "attempts",
        "searches",
    }
    assert len(forms) > 15


def test_the_names_of_a_batchs_files_are_those_that_are_written() -> None:
    assert tuple(f"{{batch}}/{name}" for name in (RESULTS_FILE, FAILURES_FILE, REPORT_FILE, AUDIT_FILE)) == BATCH_FILES
    assert RECORDING.split("/")[0] == RECORDINGS_FOLDER
    assert {form.split("/")[0] for form in BAGS} == {BAGS_FOLDER}
