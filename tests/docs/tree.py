"""The two lists of docs/architecture.md that the code decides: its folders, and the keys of the store.

``python -m tests.docs.tree`` writes them into the page.
"""

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

from tasks.storage.base import keys
from tests.repository import ROOT

PAGE = ROOT / "docs/architecture.md"
ROOTS = ("specs", "tasks", "flows")


def packages() -> Iterator[Path]:
    """Yields the folders of the code, relative to the root, each before those inside it."""
    for root in ROOTS:
        yield from sorted(init.parent.relative_to(ROOT) for init in (ROOT / root).rglob("__init__.py"))


def first_line(package: Path) -> str:
    """Returns the first line of a folder's docstring; empty where it has none."""
    text = ast.get_docstring(ast.parse((ROOT / package / "__init__.py").read_text())) or ""
    return text.partition("\n")[0]


def lists() -> Mapping[str, str]:
    """Returns what stands in the page between ``<!-- name -->`` and ``<!-- end of name -->``, by name."""
    _, *described = (keys.__doc__ or "").strip().split("\n\n")
    return {"tree": _block("\n".join(map(_line, packages()))), "keys": _block("\n\n".join(described))}


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


def _block(text: str) -> str:
    return f"```text\n{text}\n```\n"


if __name__ == "__main__":
    write()
