"""Applications as a Prefect task: unpacked where they run."""

from pathlib import Path

from prefect import task
from prefect.cache_policies import NO_CACHE

from tasks.applications import step


@task(name="unpack-application", cache_policy=NO_CACHE, persist_result=False)
def unpack_application(store_url: str, digest: str) -> Path:
    """Returns what `tasks.applications.step.unpack_application` does."""
    return step.unpack_application(store_url, digest)
