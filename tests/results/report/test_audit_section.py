"""The parity audit in a report: what it measured, what it names, and nothing where it says nothing."""

from typing import cast

from pydantic import JsonValue

from tasks.results.report.audit_section import audit_view
from tasks.simulate.audit.audit_report import ApartQuantiles, AuditFlipRate, Flip

AUDIT: dict[str, JsonValue] = {
    "verdict": "SUSPECT",
    "sentence": "outcomes flip",
    "engine": "planar",
    "reference": "mujoco",
    "compared": 16,
    "final": cast("JsonValue", ApartQuantiles(median_m=0.000012, p90_m=0.25, max_m=1.5).model_dump()),
    "spread": cast("JsonValue", AuditFlipRate(lanes=8, flips=2).model_dump()),
    "flips": [Flip(index=index, row="Passed", reference="collision").model_dump() for index in range(10)],
    "unreproduced": [3],
    "unlocked": [3, 4],
}


def test_every_figure_is_told():
    lines = {line.label: line.text for line in audit_view(AUDIT).lines}
    assert lines["Compared"] == "16 episodes of planar with mujoco"
    assert lines["Apart at the end"] == "median 1.2e-05 m, p90 0.25 m, max 1.5 m"
    assert lines["Spread over the batch"] == "2 of 8 came to another end"
    assert lines["Could not be made again"] == "job 3"
    assert lines["Lock-step did not hold"] == "job 3; job 4"


def test_the_first_episodes_that_flipped_are_named_and_the_others_counted():
    text = next(line.text for line in audit_view(AUDIT).lines if line.label == "Came to another end")
    assert text.startswith("job 0: Passed, not collision; job 1: ")
    assert text.endswith("job 7: Passed, not collision, and 2 more")


def test_only_what_speaks_against_the_numbers_is_an_alarm():
    verdicts = ("SOUND", "NOT COMPARED", "SUSPECT", "NOT RUN")
    assert [audit_view({**AUDIT, "verdict": verdict}).alarming for verdict in verdicts] == [False, False, True, True]


def test_an_audit_that_could_not_be_made_has_no_figures():
    assert audit_view({"verdict": "NOT RUN", "sentence": "no memory"}).lines == ()
