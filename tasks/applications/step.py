"""An application as a step: unpacked where it runs."""

import logging
from pathlib import Path

from tasks.applications.registry import unpack
from tasks.storage.base.local_files import cache_folder
from tasks.storage.store_url import open_store

_LOG = logging.getLogger(__name__)


def unpack_application(store_url: str, digest: str, name: str = "") -> Path:
    """Returns the folder of an application's files on this machine; bundles are kept by digest in the cache folder.

    Args:
        store_url: Where the bundle is.
        digest: The bundle's.
        name: What the document calls the application, for people; empty where nobody looks.
    """
    folder = unpack(open_store(store_url), digest, cache_folder() / "bundles")
    _LOG.debug("%s (%s) is in %s", name, digest, folder)
    return folder
