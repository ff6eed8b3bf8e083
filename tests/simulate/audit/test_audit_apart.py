"""An audit in another process is not ended by chunks that this process worked on besides."""

import pytest

from tasks.simulate.audit.audit_report import AuditReport, not_run
from tasks.simulate.audit.audit_run import ask_audit
from tasks.simulate.audit.audit_sample import SampledEpisode
from tasks.simulate.sandbox.protocol import Audited
from tasks.simulate.sandbox.simulator import SimulatorEnded
from tests.factories.episodes import passed, request
from tests.factories.worlds import apartment
from tests.simulate.ending_simulators import ended, use_simulators

REPORT = not_run("a test says so")


def audited() -> AuditReport:
    asked = request(0)
    return ask_audit([SampledEpisode(asked, passed(0), 1.0)], {asked.world: apartment()}, {}, lanes=8)


def test_an_audit_whose_process_ended_beside_chunks_ahead_is_asked_once_more(monkeypatch: pytest.MonkeyPatch):
    answer = Audited(report=REPORT.model_dump_json(), timings=())
    asked = use_simulators(monkeypatch, [ended(beside_others=True), answer])
    assert audited() == REPORT
    assert asked[0] == asked[1]


@pytest.mark.parametrize("ends", [[False], [True, False], [True, True]])
def test_an_audit_that_ends_its_process_itself_is_given_up(monkeypatch: pytest.MonkeyPatch, ends: list[bool]):
    asked = use_simulators(monkeypatch, [ended(beside_others=each) for each in ends])
    with pytest.raises(SimulatorEnded, match="exit code 3"):
        audited()
    assert len(asked) == len(ends)
