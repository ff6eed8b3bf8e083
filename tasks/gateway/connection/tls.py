"""How connections are encrypted: by the certificate and the key that the owner names."""

import ssl
from pathlib import Path

from specs.base import Fault
from specs.errors import DocumentError


def tls_context(certificate: Path | None, key: Path | None) -> ssl.SSLContext | None:
    """Returns how to encrypt, TLS 1.2 or later; None if neither file is named.

    Raises:
        DocumentError: One of them is missing, cannot be read, or they do not belong to each other.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        raise _refused("--tls-certificate and --tls-key, both or neither")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except (OSError, ValueError) as exc:  # ssl.SSLError is an OSError
        raise _refused(f"PEM files that belong to each other, the key without a password: {exc}") from exc
    return context


def _no_password() -> str:
    # Without this, OpenSSL would ask the terminal, and a service has none.
    raise ValueError("the key has a password")


def _refused(allowed: str) -> DocumentError:
    return DocumentError([Fault(path="TLS", value="certificate and key", allowed=allowed)], source="simyard serve")
