"""A report in short, as Markdown: for Prefect's pages."""

import re
from collections.abc import Sequence

from tasks.results.report.rows import Row
from tasks.results.report.view import View

_MARKS = {"PASS": "✅", "FAIL": "❌", "INCONCLUSIVE": "❔"}
_ACTIVE = re.compile(r"([\\`*_{}\[\]<>()#+!|~&])")
_HEAD = ("group", "passed", "rate", "interval", "why not")


def report_markdown(view: View, url: str) -> str:
    """Returns the verdict, the rates and the reasons, and where the page is."""
    judged = view.facts.judgement
    title = f"# {_MARKS[judged.verdict]} {judged.verdict}" if judged else "# Not judged"
    told = judged.sentence.splitlines() if judged else ["No gate has judged this batch."]
    sentence = "\n".join([plain(told[0]), *(f"- {plain(line)}" for line in told[1:])])
    rows = [
        view.whole,
        *(row for column in view.columns for table in column for row in _marked(table.caption, table.rows)),
    ]
    reasons = [f"- {row.count:,} x {plain(row.reason)} ({row.share} of failures)" for row in view.reasons]
    return "\n\n".join([title, sentence, _table(rows), "\n".join(reasons) or "No failures.", f"Report: {plain(url)}"])


def plain(text: str) -> str:
    """Returns the text with what Markdown or HTML would take for more than text escaped, in one line."""
    return _ACTIVE.sub(r"\\\1", " ".join(text.split()))


def _marked(caption: str, rows: Sequence[Row]) -> list[Row]:
    return [row.model_copy(update={"label": f"{caption.removeprefix('By ')}: {row.label}"}) for row in rows]


def _table(rows: Sequence[Row]) -> str:
    lines = [(row.label, row.counts, row.rate, row.interval, row.why) for row in rows]
    return "\n".join(
        [_line(_HEAD), _line(["---"] * len(_HEAD)), *(_line([plain(cell) for cell in line]) for line in lines)]
    )


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
