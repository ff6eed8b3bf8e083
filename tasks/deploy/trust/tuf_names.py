"""Names of python-tuf and securesystemslib, imported once for all.

Both re-export them from private modules without saying so to type checkers; said once here, and nowhere else.
securesystemslib also imports the client of a cloud for keys that lie there, if that is installed, which takes longer
than all else that an agent imports for signatures. Simyard has its keys in files, so it is imported without.
"""

import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from threading import get_ident
from types import ModuleType

_CLOUD = "boto3"


class _NoCloud(MetaPathFinder):
    """Says to one thread that the client is not installed."""

    def __init__(self) -> None:
        self._thread = get_ident()

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname == _CLOUD and get_ident() == self._thread:
            raise ModuleNotFoundError(fullname, name=fullname)
        return None


@contextmanager
def _without_cloud() -> Generator[None]:
    finder = _NoCloud()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)


with _without_cloud():
    from securesystemslib import signer as _signer
    from tuf.api import metadata as _metadata
    from tuf.api.exceptions import (
        BadVersionNumberError,
        DownloadError,
        DownloadHTTPError,
        DownloadLengthMismatchError,
        ExpiredMetadataError,
        LengthOrHashMismatchError,
        RepositoryError,
        UnsignedMetadataError,
    )
    from tuf.api.metadata import Metadata
    from tuf.api.serialization import DeserializationError
    from tuf.ngclient import FetcherInterface, Updater, UpdaterConfig

CryptoSigner = _signer.CryptoSigner  # pyright: ignore[reportPrivateImportUsage] - documented
Key = _signer.Key  # pyright: ignore[reportPrivateImportUsage] - documented
RawSignature = _signer.Signature  # pyright: ignore[reportPrivateImportUsage] - documented
DelegatedRole = _metadata.DelegatedRole  # pyright: ignore[reportPrivateImportUsage] - documented
Delegations = _metadata.Delegations  # pyright: ignore[reportPrivateImportUsage] - documented
MetaFile = _metadata.MetaFile  # pyright: ignore[reportPrivateImportUsage] - documented
Root = _metadata.Root  # pyright: ignore[reportPrivateImportUsage] - documented
Snapshot = _metadata.Snapshot  # pyright: ignore[reportPrivateImportUsage] - documented
TargetFile = _metadata.TargetFile  # pyright: ignore[reportPrivateImportUsage] - documented
Targets = _metadata.Targets  # pyright: ignore[reportPrivateImportUsage] - documented
Timestamp = _metadata.Timestamp  # pyright: ignore[reportPrivateImportUsage] - documented

__all__ = [
    "BadVersionNumberError",
    "CryptoSigner",
    "DelegatedRole",
    "Delegations",
    "DeserializationError",
    "DownloadError",
    "DownloadHTTPError",
    "DownloadLengthMismatchError",
    "ExpiredMetadataError",
    "FetcherInterface",
    "Key",
    "LengthOrHashMismatchError",
    "MetaFile",
    "Metadata",
    "RawSignature",
    "RepositoryError",
    "Root",
    "Snapshot",
    "TargetFile",
    "Targets",
    "Timestamp",
    "UnsignedMetadataError",
    "Updater",
    "UpdaterConfig",
]
