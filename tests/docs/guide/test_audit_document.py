"""docs/guide/audit.md says what the code does: fields, verdicts, limits, and a document that is one."""

import re
from typing import get_args

import pytest
import yaml

from specs.pipeline.simulation_section import AUDITED_LANES, MAX_AUDITED_LANES, Audit
from tasks.simulate.audit.audit_report import (
    APART_LIMIT_M,
    FAILED_FLIP_LIMIT,
    FLIP_LIMIT,
    AuditFlipRate,
    AuditReport,
    AuditVerdict,
)
from tests.repository import ROOT

DOCUMENT = (ROOT / "docs/guide/audit.md").read_text()
TEXT = " ".join(DOCUMENT.split())


def first_cells(heading: str) -> list[str]:
    table = DOCUMENT.split(f"| {heading} |")[1].split("\n\n", maxsplit=1)[0]
    return re.findall(r"^\| `?([\w ]+?)`? \|", table, re.MULTILINE)


def test_every_field_of_the_report_is_explained():
    assert first_cells("field | says") == list(AuditReport.model_fields)


def test_every_verdict_is_explained():
    assert first_cells("verdict | means") == list(get_args(AuditVerdict))


def test_the_document_is_one():
    (block,) = re.findall(r"```yaml\n(.*?)```", DOCUMENT, re.DOTALL)
    assert Audit.model_validate(yaml.safe_load(block)["simulationBatch"]["audit"]) == Audit()
    assert f"the default; 0 to {MAX_AUDITED_LANES}, and 0 turns it off" in block
    assert AUDITED_LANES == 16


@pytest.mark.parametrize(("lanes", "flips", "limit"), [(16, 2, FLIP_LIMIT), (8, 3, FAILED_FLIP_LIMIT)])
def test_alarms_are_raised_where_it_says(lanes: int, flips: int, limit: float):
    assert f"{flips} of {lanes}" in TEXT
    assert AuditFlipRate(lanes=lanes, flips=flips).exceeds(limit)
    assert not AuditFlipRate(lanes=lanes, flips=flips - 1).exceeds(limit)


def test_robots_may_be_as_far_apart_as_it_says():
    assert f"Above {APART_LIMIT_M} m among `unflipped` episodes the alarm is raised" in TEXT


def test_a_sample_without_flips_shows_what_it_says():
    assert f"the rate is below {100 * (1 - 0.05 ** (1 / 16)):.0f} % (95 % confidence)" in TEXT
