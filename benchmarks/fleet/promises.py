"""What was tried of the promises of fleets, as `make soak` wrote it down, as a table.

.venv/bin/python -m benchmarks.fleet.promises soak.jsonl [--document docs/operate/fleet.md]
"""

import json
from collections.abc import Mapping
from pathlib import Path

from benchmarks.harness import machine, markdown, options, show

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
    parser = options(__doc__)
    parser.add_argument("report", type=Path, help="what make soak wrote")
    given = parser.parse_args()
    show("promises", f"{machine()}\n\n{table(given.report.read_text())}", given.document)


if __name__ == "__main__":
    main()
