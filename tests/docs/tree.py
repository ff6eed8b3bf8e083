"""The lists of docs/architecture.md that the code decides: its folders, their layers, its size, and the keys of
the store.

``python -m tests.docs.tree`` writes them into the page.
"""

import ast
import itertools
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

from benchmarks.house.house import house
from specs.job_kinds import JOB_KINDS
from tests.repository import ROOT

PAGE = ROOT / "docs/architecture.md"
ROOTS = ("specs", "tasks", "flows", "simyard")
KEYS = Path("tasks/storage/base/keys.py")


def packages() -> Iterator[Path]:
    """Yields the folders of the code, relative to the root, each before those inside it."""
    for root in ROOTS:
        yield from sorted(init.parent.relative_to(ROOT) for init in (ROOT / root).rglob("__init__.py"))


def first_line(package: Path) -> str:
    """Returns the first line of a folder's docstring; empty where it has none."""
    text = ast.get_docstring(ast.parse((ROOT / package / "__init__.py").read_text())) or ""
    return text.partition("\n")[0]


@cache
def lists() -> Mapping[str, str]:
    """Returns what stands in the page between ``<!-- name -->`` and ``<!-- end of name -->``, by name."""
    keys = {**_described_keys(), **_job_keys()}
    return {
        "tree": _block(map(_line, packages())),
        "layers": _block(_layers()),
        "keys": _block(sorted(keys.values())),
        "house": _block(_size()),
    }


def between(page: str, name: str) -> str:
    """Returns what the page has of a list."""
    _, _, rest = page.partition(f"<!-- {name} -->\n")
    return rest.partition(f"<!-- end of {name} -->")[0]


def write() -> None:
    """Writes the lists into the page."""
    page = PAGE.read_text()
    for name, text in lists().items():
        page = page.replace(f"<!-- {name} -->\n{between(page, name)}", f"<!-- {name} -->\n{text}")
    PAGE.write_text(page)


def _line(package: Path) -> str:
    """Returns a folder with what lives in it; who may import it stands in the folder alone."""
    what, _, _ = first_line(package).rpartition(". ")
    return f"{package.as_posix():<31} {what}"


def _layers() -> Iterator[str]:
    """Yields a line for each contract about layers inside a package: the highest layer first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    for layers in (contract["layers"] for contract in contracts if contract["type"] == "layers"):
        inside = [layer.replace(".", "/").split(" | ") for layer in layers]
        package = os.path.commonpath([path for paths in inside for path in paths])
        if package:
            below = (" | ".join(path.removeprefix(f"{package}/") for path in paths) for paths in inside)
            yield f"{package:<21} {' > '.join(below)}"


def _size() -> Iterator[str]:
    """Yields how large the house is, rounded, so that not every change writes the page anew."""
    found = house(ROOT)
    yield f"{'modules':<27} {round(found.modules, -1)}"
    yield f"{'median lines of a module':<27} {round(found.median_lines, -1):.0f}"
    yield f"{'modules with one importer':<27} {round(found.one_importer * 20) * 5} %"
    yield f"{'names that stand twice':<27} {found.names_twice}"


def _described_keys() -> dict[str, str]:
    """Returns the lines of the keys that have a docstring, by their form."""
    body = ast.parse((ROOT / KEYS).read_text()).body
    return {
        form: _key_line(form, _text(after.value).rstrip("."))
        for each, after in itertools.pairwise(body)
        if isinstance(each, ast.Assign) and isinstance(after, ast.Expr) and (form := _text(each.value))
    }


def _job_keys() -> dict[str, str]:
    """Returns the lines of what the jobs of each kind keep, by their form."""
    return {
        form: _key_line(f"{'<s3Bucket>/<s3Prefix>/' if objects.in_bucket else ''}{form}", f"{objects.what} of a {kind}")
        for kind, declaration in JOB_KINDS.items()
        for objects in declaration.objects
        for form in objects.forms
    }


def _text(value: ast.expr) -> str:
    """Returns the text that an expression is; empty for any other."""
    return value.value if isinstance(value, ast.Constant) and isinstance(value.value, str) else ""


def _key_line(form: str, meaning: str) -> str:
    named = re.sub(r"{(\w+)(?::\w+)?}", r"<\1>", form)
    return f"{named:<58} {meaning}"


def _block(lines: Iterable[str]) -> str:
    text = "\n".join(lines)
    return f"```text\n{text}\n```\n"


if __name__ == "__main__":
    write()
