"""Applications as a Prefect task: unpacked where they run."""

from pathlib import Path

from prefect import task
from prefect.cache_policies import NO_CACHE

from tasks.applications.registry import unpack
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.store_url import open_store


@task(name="unpack-application", cache_policy=NO_CACHE, persist_result=False)
def unpack_application(store_url: str, digest: str) -> Path:
    """Returns the folder of an application's files on this machine; bundles are kept by digest in the cache folder."""
    return unpack(open_store(store_url), digest, cache_folder() / "bundles")
