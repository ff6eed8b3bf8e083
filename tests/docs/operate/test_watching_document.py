"""docs/operate/operations.md, Watching: its artifacts, figures, events and automations are the program's."""

import re
from pathlib import Path
from typing import get_args
from uuid import uuid4

import pytest
import yaml
from prefect.blocks import notifications
from prefect.blocks.abstract import NotificationBlock
from prefect.events.schemas.automations import AutomationCore

from specs.data.run_report import Verdict
from specs.job_kinds import JOB_KINDS
from tasks.progress.log_lines import LogFormat
from tasks.simulate.batch.metrics import ChunkWork, metric_rows, metrics_of
from tasks.storage.jobs.records import _STATUSES, JobTransition
from tests.repository import ROOT

SECTION = (ROOT / "docs/operate/operations.md").read_text().split("\n## Watching\n")[1].split("\n## ")[0]
EXAMPLE = ROOT / "examples/automations/what-went-wrong.yaml"


def told_events() -> dict[str, set[str]]:
    rows = re.findall(r"^\| `simyard\.([a-z-]+)\.\*` \| ([^;\n]*)", SECTION, flags=re.MULTILINE)
    return {kind: set(re.findall(r"`(\w+)`", statuses)) for kind, statuses in rows}


def test_every_artifact_has_a_row() -> None:
    sources = [path.read_text() for folder in ("tasks", "flows") for path in (ROOT / folder).rglob("*.py")]
    created = re.compile(
        r'create_(?:table|markdown|image)_artifact\([^)]*?key=(?:document_)?artifact_key\((?:[a-z.]+, )?"([a-z-]+)"',
        re.DOTALL,
    )
    made = {key for text in sources for key in created.findall(text)}
    rows = re.findall(r"^\| (`[a-z-]+`(?:, `[a-z-]+`)*) \|", SECTION, flags=re.MULTILINE)
    told = {key for row in rows for key in re.findall(r"`([^`]*)`", row)}
    assert made <= told
    assert {"batch-metrics", "batch-results"} <= made


@pytest.mark.parametrize("figure", [row["figure"] for row in metric_rows(metrics_of(ChunkWork(), 1.0, 1))])
def test_every_figure_is_named(figure: str) -> None:
    assert f"`{figure}`" in SECTION.replace("\n", " ")


def test_every_kind_of_event_has_a_row_of_statuses_that_there_are() -> None:
    events = told_events()
    assert set(events) == {*(declared.event for declared in JOB_KINDS.values()), "gate", "trend"}
    assert events.pop("gate") == set(get_args(Verdict))
    assert events.pop("trend") == {"Fell", "Rose"}
    assert {status for statuses in events.values() for status in statuses} <= _STATUSES


def test_every_fact_of_a_logged_change_and_every_format_is_named() -> None:
    assert [fact for fact in JobTransition._fields if f"`{fact}`" not in SECTION] == []
    assert [form for form in get_args(LogFormat) if form not in SECTION] == []


@pytest.mark.parametrize("example", [EXAMPLE, EXAMPLE.with_name("rate-fell.yaml")])
def test_the_example_is_one_that_prefect_takes_and_expects_events_that_there_are(example: Path) -> None:
    made = yaml.safe_load(example.read_text().replace("BLOCK", str(uuid4())))["automations"]
    automations = [AutomationCore.model_validate(each) for each in made]
    possible = {f"simyard.{kind}.{status}" for kind, statuses in told_events().items() for status in statuses}
    assert [event for each in made for event in each["trigger"]["expect"] if event not in possible] == []
    assert {action.type for each in automations for action in each.actions} == {"send-notification"}
    assert f"examples/automations/{example.name}" in SECTION


def test_the_example_expects_every_end_of_a_job_without_what_was_asked_of_it() -> None:
    made = yaml.safe_load(EXAMPLE.read_text())["automations"]
    expected = {event for each in made for event in each["trigger"]["expect"]}
    jobs = {kind: statuses for kind, statuses in told_events().items() if kind not in {"pipeline", "gate", "trend"}}
    ends = {"Failed", "TimedOut", "Canceled"}
    assert {f"simyard.{kind}.{status}" for kind, statuses in jobs.items() for status in statuses & ends} <= expected


@pytest.mark.parametrize("block", ["SlackWebhook", "SendgridEmail", "CustomWebhookNotificationBlock"])
def test_the_blocks_are_notification_blocks(block: str) -> None:
    assert issubclass(getattr(notifications, block), NotificationBlock)
