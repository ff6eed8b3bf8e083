"""Names of python-tuf and securesystemslib, imported once for all.

Both re-export them from private modules without saying so to type checkers; said once here, and nowhere else.
"""

from securesystemslib import signer as _signer
from tuf.api import metadata as _metadata
from tuf.api.metadata import Metadata

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
    "CryptoSigner",
    "DelegatedRole",
    "Delegations",
    "Key",
    "MetaFile",
    "Metadata",
    "RawSignature",
    "Root",
    "Snapshot",
    "TargetFile",
    "Targets",
    "Timestamp",
]
