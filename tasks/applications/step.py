"""An application as a step: unpacked where it runs."""

from pathlib import Path

from tasks.applications.registry import unpack
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.store_url import open_store


def unpack_application(store_url: str, digest: str) -> Path:
    """Returns the folder of an application's files on this machine; bundles are kept by digest in the cache folder."""
    return unpack(open_store(store_url), digest, cache_folder() / "bundles")
