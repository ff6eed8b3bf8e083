"""How large the house is, and how far it is from the command line to a world and from YAML to a row.

Run: ``python -m benchmarks.house.house [FOLDER] [--static]``, for this repository or another checkout of it, which must
have its environment in ``.venv``. ``--static`` leaves out what needs a run.
"""

import ast
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import mean, median
from typing import NamedTuple

from benchmarks.harness import ROOT, markdown

TOPS = ("specs", "tasks", "flows", "simyard")
# Two worlds, four episodes, no gate: the least that makes rows.
DOCUMENT = """
name: house
worldGeneration:
  template: {template}
  worldCount: {{floorplanCount: 2, interiorCountPerFloorplan: 1}}
  seed: 7
simulationBatch:
  outputLocation: {{s3Bucket: results, s3Prefix: house}}
  matrix: {{worlds: all, seeds: 2}}
  createSimulationJobRequests:
    - maxJobDurationInSeconds: 20
      failureBehavior: Fail
      robotApplications: [{{application: courier, launchConfig: {{packageName: courier, launchFile: go_to_goal}}}}]
      simulationApplications: [{{application: delivery, launchConfig: {{packageName: delivery, launchFile: rooms}}}}]
"""


class House(NamedTuple):
    """What is counted of a checkout; lines are with comments, docstrings and blank ones.

    Attributes:
        modules: Of the product, without ``__init__``.
        product_lines: Of specs, tasks, flows and simyard.
        test_lines: Of tests.
        benchmark_lines: Of benchmarks.
        median_lines: Of a module.
        mean_lines: Of a module.
        mean_function: Lines of a function's body, without its docstring.
        import_share: Lines of imports, of all lines of modules.
        one_importer: Share of modules that exactly one other module imports.
        names_twice: Names that more than one module has.
    """

    modules: int
    product_lines: int
    test_lines: int
    benchmark_lines: int
    median_lines: float
    mean_lines: float
    mean_function: float
    import_share: float
    one_importer: float
    names_twice: int


class Way(NamedTuple):
    """What a run of two worlds and four episodes goes through.

    Attributes:
        frames_to_world: Calls of Simyard's own that are open when the first world is generated.
        files_to_row: Files whose functions lead from the document to the results' columns, in both processes.
        files_called: All files of which a function was called.
    """

    frames_to_world: int
    files_to_row: int
    files_called: int


def house(root: Path) -> House:
    """Returns what is counted of a checkout."""
    texts = {path: path.read_text() for top in TOPS for path in sorted((root / top).rglob("*.py"))}
    modules = {path: text for path, text in texts.items() if path.name != "__init__.py"}
    nodes = {path: list(ast.walk(ast.parse(text))) for path, text in modules.items()}
    lines = [text.count("\n") for text in modules.values()]
    importers = Counter(len(users) for users in _importers(root, nodes).values())
    stems = Counter(path.stem for path in modules)
    return House(
        modules=len(modules),
        product_lines=sum(text.count("\n") for text in texts.values()),
        test_lines=_lines(root / "tests"),
        benchmark_lines=_lines(root / "benchmarks"),
        median_lines=median(lines),
        mean_lines=mean(lines),
        mean_function=mean(size for each in nodes.values() for size in _function_sizes(each)),
        import_share=sum(map(_import_lines, nodes.values())) / sum(lines),
        one_importer=importers[1] / len(modules),
        names_twice=sum(count > 1 for count in stems.values()),
    )


def way(root: Path) -> Way:
    """Returns what a run goes through; it is driven for it, with the checkout's own environment."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        document, calls = folder / "house.yaml", folder / "calls"
        calls.mkdir()
        document.write_text(DOCUMENT.format(template=root / "examples/templates/two-rooms.json"))
        traced = {
            "SIMYARD_TRACE_FOLDER": str(calls),
            "SIMYARD_TRACE_ROOT": str(root),
            "PYTHONPATH": str(Path(__file__).parent),
            "SIMYARD_CONFINEMENT": "process",  # else the process that simulates may write nothing
        }
        command = [root / ".venv/bin/simyard", "run", document, "--direct", "--store", (folder / "store").as_uri()]
        subprocess.run(command, env={**os.environ, **traced}, check=True, stdout=subprocess.DEVNULL, cwd=folder)
        stacks = [json.loads(line) for file in calls.iterdir() for line in file.read_text().splitlines()]
    columns = [stack for stack in stacks if ":EpisodeColumns." in stack[-1]]
    return Way(
        frames_to_world=min(len(stack) for stack in stacks if stack[-1].endswith(":generate_world")),
        files_to_row=len({_file(call) for stack in columns for call in stack}),
        files_called=len({_file(stack[-1]) for stack in stacks}),
    )


def rows(found: House, gone: Way | None) -> list[tuple[str, str]]:
    """Returns the table: what is counted, and how much it is."""
    counted = [
        ("modules", f"{found.modules}"),
        ("lines of specs, tasks, flows, simyard", f"{found.product_lines:,}"),
        ("lines of tests", f"{found.test_lines:,}"),
        ("lines of benchmarks", f"{found.benchmark_lines:,}"),
        ("median lines of a module", f"{found.median_lines:.0f}"),
        ("mean lines of a module", f"{found.mean_lines:.0f}"),
        ("mean lines of a function", f"{found.mean_function:.1f}"),
        ("lines that import", f"{found.import_share:.1%}"),
        ("modules with one importer", f"{found.one_importer:.0%}"),
        ("names that stand twice", f"{found.names_twice}"),
    ]
    if gone is not None:
        counted += [
            ("frames from the command line to the first world", f"{gone.frames_to_world}"),
            ("files from YAML to a row", f"{gone.files_to_row}"),
            ("files called in a run", f"{gone.files_called}"),
        ]
    return counted


def _lines(folder: Path) -> int:
    return sum(path.read_text().count("\n") for path in folder.rglob("*.py"))


def _importers(root: Path, modules: dict[Path, list[ast.AST]]) -> dict[str, set[Path]]:
    """Returns the modules that import each module."""
    names = {".".join(path.relative_to(root).with_suffix("").parts): path for path in modules}
    users: defaultdict[str, set[Path]] = defaultdict(set, {name: set() for name in names})
    for path, nodes in modules.items():
        for name in _imported(nodes):
            if name in names and names[name] != path:
                users[name].add(path)
    return users


def _imported(nodes: list[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _function_sizes(nodes: list[ast.AST]) -> Iterator[int]:
    for node in nodes:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) and len(node.body) > 1 else node.body
            yield (body[-1].end_lineno or body[-1].lineno) - body[0].lineno + 1


def _import_lines(nodes: list[ast.AST]) -> int:
    imports = (node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom))
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)


def _file(call: str) -> str:
    return call.partition(":")[0]


def main(arguments: Sequence[str]) -> None:
    """Prints the table of a checkout."""
    folders = [Path(each).resolve() for each in arguments if not each.startswith("--")] or [ROOT]
    gone = None if "--static" in arguments else way(folders[0])
    print(markdown([("of the house", "now"), *rows(house(folders[0]), gone)]))


if __name__ == "__main__":
    main(sys.argv[1:])
