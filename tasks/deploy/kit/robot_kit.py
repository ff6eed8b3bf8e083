"""The kit that an owner carries to a robot: the agent's wheel, the installer, the unit, settings, the root of trust.

The wheel holds the modules that the agent imports, and those that they import, and nothing else: a robot has no use
for a simulator. They are read from the source rather than from a running agent, so that what is imported late, as S3
and the verification are, is part of it. A wheel is a zip of what lies in site-packages, with its metadata (binary
distribution format, packaging.python.org/specifications/binary-distribution-format). Nothing has to be built, so no
builder is needed, and the same sources make the same bytes.
"""

import ast
import base64
import hashlib
import re
import shlex
import zipfile
from collections.abc import Iterator, Mapping
from importlib import metadata
from importlib.resources import files
from io import BytesIO
from pathlib import Path

from specs.errors import DocumentError
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM

_SOURCES = Path(__file__).parents[3]
_FIRST_PARTY = frozenset({"specs", "tasks", "flows"})
AGENT_MODULE = "tasks.deploy.robot.agent"
_NAME = "simyard_agent"
_ALWAYS = frozenset({"pydantic", "tuf", "securesystemslib", "cryptography"})
_FOR_S3 = frozenset({"s3fs", "botocore"})
_DISTRIBUTION = re.compile(r"[A-Za-z0-9._-]+")
_WHEEL = "Wheel-Version: 1.0\nGenerator: simyard\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can say
_ROBOT = files("tasks.deploy.kit") / "robot"
_UNIT = "simyard-agent@.service"
_INSTALLER = "install.sh"
_ROOT_OF_TRUST = "root.json"


def agent_sources() -> dict[str, bytes]:
    """Returns the source of each module that the agent may import, by its path in a wheel, sorted."""
    found: dict[str, bytes] = {}
    left = [AGENT_MODULE]
    while left:
        path = _source_path(left.pop())
        if path is None or path.as_posix() in found:
            continue
        found[path.as_posix()] = (_SOURCES / path).read_bytes()
        left += _imports(found[path.as_posix()])
    return dict(sorted(found.items()))


def _imports(source: bytes) -> Iterator[str]:
    """Yields each module that a source names in an import, and the packages around it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: count + 1]) for count in range(len(parts)))


def _source_path(module: str) -> Path | None:
    """Returns where a module of Simyard's lies below the root; None for what is none, such as a function."""
    if module.partition(".")[0] not in _FIRST_PARTY:
        return None
    path = Path(*module.split("."))
    files = (path / "__init__.py", path.with_suffix(".py"))
    return next((file for file in files if (_SOURCES / file).is_file()), None)


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


def write_kit(folder: Path, *, store_url: str, root_of_trust: bytes | None) -> tuple[Path, ...]:
    """Writes what a robot needs into a folder, made if it is missing; returns the files.

    The kit names no robot, so that one serves a fleet, and holds no secret.

    Args:
        folder: Where to.
        store_url: Where robots look, as seen from them.
        root_of_trust: ``root.json`` of the keys; None for robots that verify nothing.

    Raises:
        DocumentError: The folder holds something else.
    """
    settings = _settings(store_url, signed=root_of_trust is not None)
    contents = {
        wheel_name(): agent_wheel(),
        _UNIT: (_ROBOT / _UNIT).read_bytes(),
        _INSTALLER: (_ROBOT / _INSTALLER).read_bytes(),
        "agent.env": settings.encode(),
        **({_ROOT_OF_TRUST: root_of_trust} if root_of_trust is not None else {}),
    }
    _refuse_foreign(folder, set(contents) | {_ROOT_OF_TRUST})
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    for name, body in contents.items():
        (folder / name).write_bytes(body)
    (folder / _INSTALLER).chmod(0o755)
    return tuple(folder / name for name in contents)


def _refuse_foreign(folder: Path, ours: set[str]) -> None:
    if not folder.exists():
        return
    there = [path.name for path in folder.iterdir()] if folder.is_dir() else [""]
    if not all(name in ours or _is_wheel(name) for name in there):
        allowed = "a folder that is new, empty, or holds an older kit"
        raise DocumentError.of("FOLDER", str(folder), allowed)


def _is_wheel(name: str) -> bool:
    return name.partition("-")[0] == wheel_name().partition("-")[0] and name.endswith(".whl")


def _settings(store_url: str, *, signed: bool) -> str:
    """Returns the environment of the unit; systemd splits SIMYARD_TRUST into words."""
    trust = f"--root-of-trust /etc/simyard/{_ROOT_OF_TRUST}" if signed else "--unsigned"
    lines = [] if signed else [f"# {UNSIGNED_ALARM}"]
    lines += [
        f"SIMYARD_STORE={shlex.quote(store_url)}",
        f'SIMYARD_TRUST="{trust}"',
        "# A store on S3 needs these, too; this file is readable by root alone.",
        "#AWS_ACCESS_KEY_ID=",
        "#AWS_SECRET_ACCESS_KEY=",
        "#AWS_ENDPOINT_URL=",
        "",
    ]
    return "\n".join(lines)
