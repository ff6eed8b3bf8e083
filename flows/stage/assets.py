"""What the jobs of a run leave in the store, what each was made of, and its figures: the run's lineage.

worlds -> zip; worlds and applications -> tables -> evidence -> roll-out. A job that made nothing leaves nothing.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, cast

from pydantic import JsonValue

from flows.gate.judge import GateAnswer, read_gate_answer
from specs.arn import RUN_KIND, resource_name
from specs.job_kinds import JobKind
from tasks.deploy.rollout.observation import recorded_progress
from tasks.deploy.rollout.rollout_plan import RolloutPlan
from tasks.simulate.batch.job import plan_of
from tasks.storage.base.keys import bundle_key, job_key, worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.jobs.runs import run_of

_MADE = frozenset({"Completed", "PartialFailed", "Succeeded"})


class Asset(NamedTuple):
    """Something in the store.

    Attributes:
        url: Where it is.
        name: What a person calls it.
    """

    url: str
    name: str


class MadeAsset(NamedTuple):
    """Something that a job, or a gate, has made.

    Attributes:
        asset: What.
        sources: What it was made of.
        facts: Counts, digests and verdicts, for a person.
    """

    asset: Asset
    sources: tuple[Asset, ...]
    facts: dict[str, JsonValue]


def made_by(store: Store, job: JobRecord, token: str = "") -> MadeAsset | None:
    """Returns what an ended job has made; None if that is nothing.

    Args:
        store: Where it is.
        job: Of a stage.
        token: The pipeline's for the stage; empty for a stage that runs alone.
    """
    if job.status not in _MADE:
        return None
    return _MAKERS[job.kind](store, job, token)


def evidence_of(store: Store, answer: GateAnswer) -> MadeAsset:
    """Returns the evidence that a gate has written.

    Args:
        store: Where it is.
        answer: The gate's.
    """
    batch = read(store, "simulation-job-batch", answer.batch)
    facts: dict[str, JsonValue] = {
        "verdict": answer.verdict,
        "sentence": answer.sentence,
        "sha256": answer.evidence,
        "batch": batch.arn,
    }
    return MadeAsset(_evidence(answer), (_tables(batch),), facts)


def _worlds_made(store: Store, job: JobRecord, _token: str) -> MadeAsset | None:
    worlds = cast("list[str]", job.detail["worlds"])
    if not worlds:
        return None
    failures = cast("Mapping[str, Mapping[str, int]]", job.detail["failures"])
    facts: dict[str, JsonValue] = {
        "worlds": len(worlds),
        "failed": sum(each["count"] for each in failures.values()),
        "template": job.detail["template_digest"],
        "seed": job.detail["seed"],
        "job": job.arn,
    }
    return MadeAsset(_generation(store, job.id), (), facts)


def _zip_made(store: Store, job: JobRecord, _token: str) -> MadeAsset:
    worlds = [resource_name(each) for each in cast("list[str]", job.request["worlds"])]
    facts: dict[str, JsonValue] = {
        "worlds": len(worlds),
        "formats": job.request["formats"],
        "sha256": job.detail.get("sha256", ""),
        "job": job.arn,
    }
    return MadeAsset(Asset(str(job.detail["zip"]), f"worlds of {job.id}"), _generations(store, worlds), facts)


def _tables_made(store: Store, job: JobRecord, _token: str) -> MadeAsset:
    plan = plan_of(job)
    launches = [launch for template in plan.templates for launch in (template.robot, template.scenario)]
    bundles = [_bundle(store, each.digest, f"{each.name} {each.version}") for each in launches]
    audit = cast("Mapping[str, JsonValue]", job.detail.get("audit") or {})
    facts: dict[str, JsonValue] = {
        "episodes": job.detail["episodes"],
        "passed": job.detail["passed"],
        "sha256s": job.detail["sha256s"],
        **({"audit": audit["verdict"]} if audit else {}),
        "job": job.arn,
    }
    sources = (*_generations(store, plan.worlds_used()), *dict.fromkeys(bundles))
    return MadeAsset(_tables(job), sources, facts)


def _rollout_made(store: Store, job: JobRecord, token: str) -> MadeAsset:
    plan, robots = RolloutPlan.model_validate(job.detail["plan"]), recorded_progress(job)
    version = f"{plan.application} {plan.version}"
    answer = _answer(store, token)
    bundles = [_bundle(store, digest, version) for digest in dict.fromkeys(plan.builds.values()) or (plan.digest,)]
    facts: dict[str, JsonValue] = {
        "fleet": plan.fleet,
        "application": version,
        "sha256": plan.digest,
        "robots": len(robots),
        "inSync": [each.status for each in robots.values()].count("InSync"),
        "job": job.arn,
    }
    where = Asset(f"{store.url}/{job_key(job.kind, job.id)}", f"{version} on {plan.fleet}")
    return MadeAsset(where, (*bundles, *([_evidence(answer)] if answer else [])), facts)


_MAKERS: Mapping[JobKind, Callable[[Store, JobRecord, str], MadeAsset | None]] = {
    "world-generation-job": _worlds_made,
    "world-export-job": _zip_made,
    "simulation-job-batch": _tables_made,
    "deployment-job": _rollout_made,
}


def _answer(store: Store, token: str) -> GateAnswer | None:
    run = run_of(token)
    return read_gate_answer(store, read(store, RUN_KIND, run)) if run else None


def _evidence(answer: GateAnswer) -> Asset:
    return Asset(answer.evidence_url, f"evidence of {answer.batch}")


def _tables(batch: JobRecord) -> Asset:
    return Asset(str(batch.detail["results_url"]), f"results of {batch.id}")


def _bundle(store: Store, digest: str, name: str) -> Asset:
    return Asset(f"{store.url}/{bundle_key(digest)}", name)


def _generation(store: Store, generation: str) -> Asset:
    return Asset(f"{store.url}/{worlds_prefix(generation)}", f"worlds of {generation}")


def _generations(store: Store, worlds: Iterable[str]) -> tuple[Asset, ...]:
    return tuple(_generation(store, each) for each in dict.fromkeys(world.partition("/")[0] for world in worlds))
