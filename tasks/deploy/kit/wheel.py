"""The agent as a wheel of its own, the same bytes for the same sources.

A wheel is a zip of what lies in site-packages, with its metadata (binary distribution format,
packaging.python.org/specifications/binary-distribution-format). Nothing has to be built, so no builder is needed.
"""

import base64
import hashlib
import re
import zipfile
from collections.abc import Iterator, Mapping
from importlib import metadata
from io import BytesIO

from tasks.deploy.kit.closure import AGENT_MODULE, agent_sources

_NAME = "simyard_agent"
_ALWAYS = frozenset({"pydantic", "tuf", "securesystemslib", "cryptography"})
_FOR_S3 = frozenset({"s3fs", "botocore"})
_DISTRIBUTION = re.compile(r"[A-Za-z0-9._-]+")
_WHEEL = "Wheel-Version: 1.0\nGenerator: simyard\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say


def wheel_name() -> str:
    """Returns the wheel's file name."""
    return f"{_NAME}-{metadata.version('simyard')}-py3-none-any.whl"


def agent_wheel() -> bytes:
    """Returns the wheel; it installs the command ``simyard-agent``, and needs what `agent_requirements` says."""
    files = {**agent_sources(), **_metadata()}
    record = f"{_NAME}-{metadata.version('simyard')}.dist-info/RECORD"
    lines = [f"{name},sha256={_hash(body)},{len(body)}" for name, body in files.items()]
    return _zip({**files, record: "\n".join([*lines, f"{record},,", ""]).encode()})


def agent_requirements() -> Iterator[str]:
    """Yields what the agent needs, as Simyard itself asks for it; what only a store on S3 needs is the extra ``s3``."""
    for requirement in metadata.requires("simyard") or ():
        named = _DISTRIBUTION.match(requirement)
        if named and ";" not in requirement:
            if named[0] in _ALWAYS:
                yield requirement
            elif named[0] in _FOR_S3:
                yield f'{requirement} ; extra == "s3"'


def _metadata() -> Mapping[str, bytes]:
    own, version = metadata.metadata("simyard"), metadata.version("simyard")
    lines = [
        "Metadata-Version: 2.1",
        "Name: simyard-agent",
        f"Version: {version}",
        "Summary: Runs on a robot what a Simyard fleet's deployments ask for.",
        f"Requires-Python: {own['Requires-Python']}",
        "Provides-Extra: s3",
        *(f"Requires-Dist: {requirement}" for requirement in agent_requirements()),
    ]
    folder = f"{_NAME}-{version}.dist-info"
    return {
        f"{folder}/METADATA": "\n".join([*lines, ""]).encode(),
        f"{folder}/WHEEL": _WHEEL.encode(),
        f"{folder}/entry_points.txt": f"[console_scripts]\nsimyard-agent = {AGENT_MODULE}:main\n".encode(),
    }


def _hash(body: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(body).digest()).rstrip(b"=").decode()


def _zip(files: Mapping[str, bytes]) -> bytes:
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, body in files.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, body, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
