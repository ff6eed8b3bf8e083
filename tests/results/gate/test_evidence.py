"""Evidence: everything the verdict rests on, the same bytes for the same facts, other bytes for any other."""

from pathlib import Path

from specs.pipeline.gate_section import Gate, SuccessRate
from tasks.results.gate.evidence import (
    Evidence,
    encode_evidence,
    evidence_digest,
    gather,
    read_evidence,
    tested_batch,
    write_evidence,
)
from tasks.results.gate.gate_verdict import judge
from tasks.results.gate.rules.rule import GateMaterial
from tasks.storage.store_url import open_store
from tests.factories.episodes import ROBOT, SCENARIO, batch, counted

GATE = Gate(successRate=SuccessRate(atLeast=0.9))
WORLDS = {"wgj-1/world-1-1": "c" * 64, "wgj-1/world-2-1": "d" * 64}
FILES = {"results.parquet": "f" * 64}


def evidence(successes: int = 40, worlds: dict[str, str] | None = None, seeds: tuple[int, ...] = (2, 0, 1)) -> Evidence:
    facts = tested_batch(
        robots=[ROBOT, ROBOT],
        simulations=[SCENARIO],
        worlds=worlds or WORLDS,
        seeds=seeds,
        variables={"MODE": ["fast", None], "MAX_SPEED": ["0.6", "0.3"]},
        metadata={"engine": "planar", "device": "cpu", "lanes": "192", "mujoco": "3.17.0"},
        files=FILES,
    )
    return gather("simb-1", GATE, judge(GATE, GateMaterial(counted(batch(successes, 40 - successes)))), facts)


def test_it_names_applications_worlds_seeds_and_files():
    found = evidence()
    assert [(robot.name, robot.digest) for robot in found.robots] == [("courier", "a" * 64)]
    assert [simulation.digest for simulation in found.simulations] == ["b" * 64]
    assert (found.worlds, found.seeds, found.files) == (WORLDS, (0, 1, 2), FILES)
    assert found.environments == {"MAX_SPEED": ("0.3", "0.6"), "MODE": ("fast",)}
    assert (found.engine, found.device, found.lanes) == ("planar", "cpu", 192)
    assert found.versions == {"mujoco": "3.17.0"}


def test_the_same_facts_give_the_same_bytes():
    assert encode_evidence(evidence()) == encode_evidence(
        evidence(worlds=dict(reversed(WORLDS.items())), seeds=(0, 1, 2))
    )


def test_one_other_world_or_episode_gives_another_digest():
    digests = {
        evidence_digest(found)
        for found in (evidence(), evidence(39), evidence(worlds={**WORLDS, "wgj-1/world-1-1": "0" * 64}))
    }
    assert len(digests) == 3


def test_it_is_read_back_as_it_was_written(tmp_path: Path):
    store = open_store(tmp_path.as_uri())
    assert write_evidence(store, evidence()) == f"{store.url}/results/simb-1/evidence.json"
    assert read_evidence(store, "simb-1") == evidence()
