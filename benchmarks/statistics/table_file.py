"""Where tables are kept: in a file beside this module, and on the page that shows them."""

import json
from pathlib import Path

from benchmarks.harness import ROOT, markdown, show

TABLES = Path(__file__).parent / "tables.json"
PAGE = ROOT / "docs/reference/statistics.md"
Rows = list[list[str]]


def keep(name: str, rows: Rows) -> None:
    """Prints a table, writes it into the file, and puts it into its place on the page."""
    show(name, markdown(rows), PAGE)
    tables = json.loads(TABLES.read_text()) if TABLES.exists() else {}
    TABLES.write_text(json.dumps({**tables, name: rows}, indent=1) + "\n")


def per_cent(*shares: float) -> str:
    """Returns shares as per cent, one digit each, a stroke between them."""
    return " / ".join(f"{100.0 * share:.1f}" for share in shares)
