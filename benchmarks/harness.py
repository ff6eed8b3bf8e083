"""What all benchmarks share: the repository, the machine, tables, and their place in a document."""

import argparse
import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]
_PROCESSORS = Path("/proc/cpuinfo")
_NAME = "model name"
_PACKAGES = {"MuJoCo": "mujoco", "JAX": "jax"}


def machine() -> str:
    """Returns the processor, how many cores of it may be used, and the versions of what steps robots."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    versions = ", ".join(f"{name} {version(package)}" for name, package in _PACKAGES.items())
    return f"{_processor()}, {cores} cores; Python {platform.python_version()}, {versions}."


def _processor() -> str:
    lines = _PROCESSORS.read_text().splitlines() if _PROCESSORS.exists() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith(_NAME))
    return next(names, platform.processor() or platform.machine())


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Returns a Markdown table, padded so that columns line up; the first row is its head, the first column text."""
    widths = [max(3, *(len(row[column]) for row in rows)) for column in range(len(rows[0]))]
    padded = [
        [cell.rjust(width) if n else cell.ljust(width) for n, (cell, width) in enumerate(zip(row, widths, strict=True))]
        for row in rows
    ]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [padded[0], rule, *padded[1:]])


def with_tables(document: str, name: str, tables: str) -> str:
    """Returns a document with what stands between ``<!-- name -->`` and ``<!-- end of name -->`` replaced.

    Raises:
        ValueError: The document has no such place, or several.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    if (document.count(begin), document.count(end)) != (1, 1):
        raise ValueError(f"the document needs one {begin} and one {end}")
    before, _, rest = document.partition(begin)
    return f"{before}{begin}\n\n{tables}\n\n{end}{rest.partition(end)[2]}"


def options(doc: str | None) -> argparse.ArgumentParser:
    """Returns a parser of a benchmark's options: its own are to be added, ``--document`` is there.

    Args:
        doc: The benchmark's docstring.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--document", type=Path, help="a document to put the tables into")
    return parser


def show(name: str, tables: str, document: Path | None) -> None:
    """Prints tables, and puts them into their place in a document if there is one."""
    print(f"{name}\n\n{tables}\n", flush=True)
    if document is not None:
        document.write_text(with_tables(document.read_text(), name, tables))
