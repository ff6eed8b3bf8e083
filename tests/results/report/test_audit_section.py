"""The parity audit in a report: what it measured, what it names, and nothing where it says nothing."""

from typing import cast

from pydantic import JsonValue

from tasks.results.report.report_view import audit_view
from tasks.simulate.audit.audit_report import (
    ApartQuantiles,
    AuditControl,
    AuditFlipRate,
    AuditReport,
    Flip,
    FlipShare,
    TotalShare,
)

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


def test_directions_have_their_intervals_and_the_control_says_what_is_chaos():
    report = AuditReport(
        verdict="SOUND",
        sentence="",
        compared=32,
        false_passes=FlipShare(lanes=24, flips=2, chaotic=1, rate=0.08, lower=0.01, upper=0.27, chance=0.3),
        false_alarms=FlipShare(lanes=8, rate=0.0, lower=0.0, upper=0.37, chance=1.0),
        total=TotalShare(rate=0.075, lower=0.0, upper=0.2),
        control=AuditControl(lanes=32, drives=2, flips=3, rate=0.04, lower=0.0, upper=0.1),
        flips=(
            Flip(index=1, row="Passed", reference="timeout", chaotic=True),
            Flip(index=9, row="Passed", reference="collision", chaotic=False),
        ),
        others=(Flip(index=4, row="stuck", reference="timeout"),),
    )
    lines = {line.label: line.text for line in audit_view(report.model_dump(mode="json")).lines}
    assert lines["False passes"] == "2 of 24 passes fail on C MuJoCo (8.0 %, 95 % interval 1.0 to 27.0 %)"
    assert lines["False alarms"] == "0 of 8 failures pass on C MuJoCo (0.0 %, 95 % interval 0.0 to 37.0 %)"
    assert "Missed contacts" not in lines
    assert lines["In the whole batch"].endswith("in 7.5 %, 95 % interval 0.0 to 20.0 %")
    assert lines["C MuJoCo against itself"] == (
        "two of its drives, a micrometre apart, differ in success in 4.0 %, 95 % interval 0.0 to 10.0 %; "
        "1 of 2 flips are of lanes that it flips itself; "
        "an engine as good as it has so many false passes in 30.0 % of such audits"
    )
    assert lines["Came to another end"] == (
        "job 1: Passed, not timeout (C MuJoCo itself flips it); job 9: Passed, not collision"
    )
    assert lines["Ended otherwise, with the same success"] == "job 4: stuck, not timeout"


def test_the_first_episodes_that_flipped_are_named_and_the_others_counted():
    text = next(line.text for line in audit_view(AUDIT).lines if line.label == "Came to another end")
    assert text.startswith("job 0: Passed, not collision; job 1: ")
    assert text.endswith("job 7: Passed, not collision, and 2 more")


def test_only_what_speaks_against_the_numbers_is_an_alarm():
    verdicts = ("SOUND", "NOT COMPARED", "SUSPECT", "NOT RUN")
    assert [audit_view({**AUDIT, "verdict": verdict}).alarming for verdict in verdicts] == [False, False, True, True]


def test_an_audit_that_could_not_be_made_has_no_figures():
    assert audit_view({"verdict": "NOT RUN", "sentence": "no memory"}).lines == ()
