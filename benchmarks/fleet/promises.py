"""What was tried of the promises of fleets, as `make soak` wrote it down, as a table.

.venv/bin/python -m benchmarks.fleet.promises soak.jsonl [--document docs/operate/fleet.md]
"""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.tables import markdown, with_tables

_PROMISES: Mapping[int, str] = {
    1: "killed at any step",
    2: "many create one object",
    3: "the store is killed",
    4: "paused, and replaced",
    5: "random fleets",
    6: "attacks",
    7: "hostile bundles",
    8: "secrets",
    9: "robots that were away",
}
_OWN = ("promise", "store", "seconds")


def table(report: str) -> str:
    """Returns the report's lines as a Markdown table, in the order of the promises."""
    lines = [json.loads(line) for line in report.splitlines()]
    rows = [["promise", "store", "tried", "seconds"]]
    for line in sorted(lines, key=lambda each: (each["promise"], each["store"])):
        tried = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in line.items() if name not in _OWN)
        rows.append([f"{line['promise']} {_PROMISES[line['promise']]}", line["store"], tried, f"{line['seconds']:.0f}"])
    return markdown(rows)


def main() -> None:
    """Shows the table, and puts it into a document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path, help="what make soak wrote")
    parser.add_argument("--document", type=Path, help="a document to put the table into")
    options = parser.parse_args()
    text = f"{machine()}\n\n{table(options.report.read_text())}"
    sys.stdout.write(f"{text}\n")
    if options.document:
        options.document.write_text(with_tables(options.document.read_text(), "promises", text))


if __name__ == "__main__":
    main()
