"""docs/guide/audit.md says what the code does: fields, verdicts, limits, and a document that is one."""

import math
import re
from typing import get_args

import pytest
import yaml

from specs.data.parity_audit import AuditReport, AuditVerdict, FlipShare
from specs.pipeline.simulation_section import AUDITED_LANES, MAX_AUDITED_LANES, Audit
from tasks.results.gate.gate_verdict import DOUBT_CHANCE
from tasks.results.statistics.intervals import lanes_needed
from tasks.simulate.audit.audit_drive import DISTURBANCES_M
from tasks.simulate.audit.audit_report import (
    APART_LIMIT_M,
    CALM_M,
    CHANCE,
    FAILED_FLIP_LIMIT,
    FLIP_LIMIT,
    PARTED_LIMIT,
    exceeds,
)
from tasks.simulate.audit.audit_sample import FAILED_ONE_IN
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
    assert AUDITED_LANES == 32
    assert FAILED_ONE_IN == 4


@pytest.mark.parametrize(("lanes", "flips", "limit"), [(24, 2, FLIP_LIMIT), (8, 3, FAILED_FLIP_LIMIT)])
def test_alarms_are_raised_where_it_says(lanes: int, flips: int, limit: float):
    assert f"{flips} of {lanes}" in TEXT
    assert exceeds(FlipShare(lanes=lanes, flips=flips), limit)
    assert not exceeds(FlipShare(lanes=lanes, flips=flips - 1), limit)


def test_limits_are_as_it_says():
    assert f"Above {APART_LIMIT_M} m among `unflipped` episodes the control is made" in TEXT
    assert f"that C MuJoCo keeps within {CALM_M} m of itself" in TEXT
    assert (CHANCE, DOUBT_CHANCE, PARTED_LIMIT) == (0.05, 0.2, 0.1)
    assert len(DISTURBANCES_M) == 2


@pytest.mark.parametrize(("lanes", "text"), [(24, "less than {} % of the passes are false"), (256, "and show {} %")])
def test_a_sample_without_flips_shows_what_it_says(lanes: int, text: str):
    assert text.format(math.ceil(1000 * (1 - 0.025 ** (1 / lanes))) / 10) in TEXT


def test_plan_asks_for_as_many_lanes_as_it_says():
    assert f"{lanes_needed(0.2, 0.95)} for a bar of 20 %, {lanes_needed(0.1, 0.95)} for 10 %" in TEXT
    assert f"{lanes_needed(0.05, 0.95)} for 5 %" in TEXT


def test_the_chance_to_see_false_passes_is_that_of_the_lanes():
    """Of 24 to 32 passed lanes, as there are more or fewer failures."""
    table = DOCUMENT.split("<!-- detection -->")[1].split("<!-- end of detection -->", maxsplit=1)[0]
    for rate in (0.01, 0.02, 0.05, 0.1):
        (row,) = re.findall(rf"^\| {100 * rate:g} % .*$", table, re.MULTILINE)
        seen = float(row.split("|")[4].strip(" %")) / 100
        assert 1 - (1 - rate) ** 24 - 0.05 < seen < 1 - (1 - rate) ** 32 + 0.05
