"""The modules that the agent needs: those that it imports, and those that they import.

Read from the source rather than from a running agent, so that what is imported late, as S3 and the verification are, is
part of it. The agent's wheel holds these and nothing else: a robot has no use for a simulator.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path(__file__).parents[3]
_FIRST_PARTY = frozenset({"specs", "tasks", "flows"})
AGENT_MODULE = "tasks.deploy.robot.agent"


def agent_sources() -> dict[str, bytes]:
    """Returns the source of each module that the agent may import, by its path in a wheel, sorted."""
    found: dict[str, bytes] = {}
    left = [AGENT_MODULE]
    while left:
        path = _path(left.pop())
        if path is None or path.as_posix() in found:
            continue
        found[path.as_posix()] = (_ROOT / path).read_bytes()
        left += _imports(found[path.as_posix()])
    return dict(sorted(found.items()))


def third_party(sources: dict[str, bytes]) -> set[str]:
    """Returns the top-level packages that sources import, the standard library's among them, Simyard's not."""
    names = {name.partition(".")[0] for source in sources.values() for name in _imports(source)}
    return names - _FIRST_PARTY


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


def _path(module: str) -> Path | None:
    """Returns where a module of Simyard's lies below the root; None for what is none, such as a function."""
    if module.partition(".")[0] not in _FIRST_PARTY:
        return None
    path = Path(*module.split("."))
    files = (path / "__init__.py", path.with_suffix(".py"))
    return next((file for file in files if (_ROOT / file).is_file()), None)
