"""The gate's answer in a report, whichever version wrote it."""

import pytest
from pydantic import ValidationError

from specs.pipeline.gate_section import CollisionRate, Gate, SuccessRate
from tasks.results.gate.evidence import ApplicationEvidence, Baseline
from tasks.results.gate.shipped_builds import Shipment
from tasks.results.report.batch_facts import judgement_of, read_judgement
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store
from tests.results.gate.test_evidence import evidence

KEY = result_key("simb-1", "evidence.json")


def test_a_batch_without_evidence_was_not_judged(file_store: Store):
    assert read_judgement(file_store, "simb-1") is None


def test_what_the_gate_wrote_is_told_with_its_bar_and_its_rules(file_store: Store):
    written = evidence()
    file_store.put(KEY, written.model_dump_json().encode())
    found = read_judgement(file_store, "simb-1")
    assert found is not None
    assert (found.verdict, found.sentence, found.at_least) == (written.verdict, written.sentence, 0.9)
    assert [rule.name for rule in found.rules] == ["successRate"]
    (rule,) = written.rules
    assert found.interval is not None
    assert (found.rate, found.interval.lower, found.interval.upper) == (rule.estimate, rule.lower, rule.upper)
    assert found.method == "Wilson"


def test_a_gate_without_a_success_rate_has_no_bar_to_draw():
    other = evidence().model_copy(update={"rule": Gate(collisionRate=CollisionRate(atMost=0.1))})
    assert judgement_of(other).at_least is None


def test_the_confidence_is_the_one_of_the_rule():
    other = evidence().model_copy(update={"rule": Gate(successRate=SuccessRate(atLeast=0.5, confidence=0.8))})
    assert (judgement_of(other).at_least, judgement_of(other).confidence) == (0.5, 0.8)


def test_it_says_whether_the_rate_is_of_worlds_like_these_and_whether_the_batch_might_have_ended_early():
    other = evidence().model_copy(update={"rule": Gate(successRate=SuccessRate(atLeast=0.5, over="worlds"))})
    assert judgement_of(other).over_worlds
    early = evidence().model_copy(update={"rule": Gate(successRate=SuccessRate(atLeast=0.5), stopEarly=True)})
    assert not judgement_of(early).over_worlds


def test_of_a_batch_with_both_versions_the_judged_one_is_named():
    one = evidence()
    other = ApplicationEvidence(name="courier", version="2", digest="e" * 64)
    both = one.model_copy(update={"robots": (*one.robots, other)})
    against = Baseline(version="1", digest="a" * 64, batch=one.batch, sha256="f" * 64)
    assert (judgement_of(both).alone, judgement_of(both).digests) == ("", ())
    judged = judgement_of(both.model_copy(update={"baseline": against}))
    assert (judged.alone, judged.digests) == ("courier version 2", ("e" * 64,))
    elsewhere = against.model_copy(update={"batch": "simb-0"})
    assert judgement_of(one.model_copy(update={"baseline": elsewhere})).alone == ""


def test_what_ships_is_told_as_the_evidence_names_it():
    ships = Shipment(application="courier", version=3, digest="a" * 64)
    assert judgement_of(evidence()).ships == ()
    told = judgement_of(evidence().model_copy(update={"ships": ships})).ships
    assert told == ("courier version 3, one bundle for all architectures, aaaaaaaaaaaa",)


def test_what_is_no_evidence_is_not_taken_for_it(file_store: Store):
    file_store.put(KEY, b"{}")
    with pytest.raises(ValidationError):
        read_judgement(file_store, "simb-1")
