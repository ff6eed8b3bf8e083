"""Batches of two versions, really simulated: what flipped, and its ways on a map."""

import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from typer.testing import CliRunner

from flows.batch.compare_batches import common_episodes, find_batch, flip_maps
from flows.cli.shell import app
from specs.errors import DocumentError, StageFailed
from tasks.results.playback.plan_drawings import plan_page
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.factories.batches import PENS, closed_batch, pushing_plan, slower_pusher
from tests.factories.planned_batches import begun

pytestmark = pytest.mark.long

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def batches(tmp_path_factory: pytest.TempPathFactory) -> tuple[OpenBatch, OpenBatch]:
    """One version in recorded episodes; another one in the same worlds of another generation, not recorded."""
    folder = tmp_path_factory.mktemp("compare")
    store = open_store((folder / "store").as_uri())
    worlds = {f"again/{name.partition('/')[2]}": world for name, world in PENS.items()}
    first = closed_batch(store, pushing_plan(store), "first")
    plan = pushing_plan(store, robot=slower_pusher(folder), worlds=worlds)
    quiet = plan.model_copy(update={"recordings": plan.recordings.model_copy(update={"episodes": "none"})})
    return first, closed_batch(store, quiet, "second")


Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(batches: tuple[OpenBatch, OpenBatch]) -> Run:
    """Runs the command on the two batches, in that order or the reverse."""

    def go(*options: str, backwards: bool = False) -> tuple[int, str]:
        names = [batch.id for batch in batches][:: -1 if backwards else 1]
        result = CliRunner().invoke(app, ["compare", *names, "--store", batches[0].store.url, *options])
        return result.exit_code, result.output

    return go


def test_versions_are_compared_on_the_worlds_and_seeds_that_they_share(run: Run):
    code, output = run("--json")
    found = json.loads(output)
    assert found["pairs"]["pairs"] == 32
    assert found["pairs"]["origins"][0] == "robot_version: 1 -> 2"
    flips = found["pairs"]["flips"]
    assert flips
    assert all(bool(flip["before"]) != bool(flip["after"]) for flip in flips)
    assert {flip["world"] for flip in flips} <= {"again/pen-0", "again/pen-1"}
    assert code == {"NO WORSE": 0, "WORSE": 1, "INCONCLUSIVE": 4}[found["answer"]]


def test_no_worse_within_a_margin_is_0_and_not_shown_to_be_is_4(run: Run):
    assert run("--margin", "0.99")[0] == 0
    code, output = run("--margin", "0")
    assert code == 4
    assert "McNemar p = " in output


def test_each_flip_is_told_with_its_reason(run: Run):
    _, output = run()
    _, backwards = run(backwards=True)
    lost = [line for line in output.splitlines() if line.startswith("lost ")]
    gained = [line for line in backwards.splitlines() if line.startswith("gained ")]
    assert len(lost) == len(gained)
    assert all(": passed -> " in line for line in lost)


def test_a_map_shows_both_ways_whether_they_were_recorded_or_not(
    batches: tuple[OpenBatch, OpenBatch], run: Run, tmp_path: Path
):
    first, second = (find_batch(batch.store, batch.id) for batch in batches)
    flips = common_episodes(first, second).flips
    drawn = list(flip_maps(first, second, flips))
    assert {each.world for each in drawn} == {flip.world for flip in flips}
    root = ET.fromstring(drawn[0].svg)  # noqa: S314 - our own document
    lines = [each for each in root.iter(f"{SVG}polyline") if each.get("class") in {"first", "second"}]
    shown = min(6, sum(flip.world == drawn[0].world for flip in flips))
    assert [each.get("class") for each in lines] == ["first", "second"] * shown
    page = plan_page(drawn[0].svg)
    ends = [
        page.at(float(batch.rows.column(name)[index].as_py()) for name in ("final_x_m", "final_y_m"))
        for flip in [flip for flip in flips if flip.world == drawn[0].world][:6]
        for batch, index in ((first, flip.first), (second, flip.second))
    ]
    for line, end in zip(lines, ends, strict=True):
        points = [tuple(map(float, point.split(","))) for point in (line.get("points") or "").split()]
        assert points[0] == pytest.approx(page.at((0.0, 0.0)), abs=0.06)  # where the scenario starts
        assert points[-1] == pytest.approx(end, abs=0.06)
    run("--output", str(tmp_path / "maps"))
    assert len(list((tmp_path / "maps").glob("flips-again-pen-*.svg"))) == len(drawn)


def test_a_batch_without_tables_is_refused(file_store: Store):
    with pytest.raises(DocumentError, match="a batch that has its tables; this one is InProgress"):
        find_batch(file_store, begun(file_store).id)


def test_batches_without_a_common_episode_are_refused(batches: tuple[OpenBatch, OpenBatch]):
    store = batches[0].store
    other = closed_batch(store, pushing_plan(store, seeds=(900, 901)), "other")
    with pytest.raises(DocumentError, match=r"900, 901 only in the second.*batches with episodes in common"):
        common_episodes(find_batch(store, batches[0].id), find_batch(store, other.id))


def test_a_comparison_of_what_did_not_change_is_a_warning(batches: tuple[OpenBatch, OpenBatch]):
    store = batches[0].store
    plan = pushing_plan(store)
    changed = closed_batch(store, pushing_plan(store, seeds=(plan.seeds[0], 900)), "changed")
    told = CliRunner().invoke(app, ["compare", batches[0].id, changed.id, "--store", store.url]).output
    assert "WARNING: " in told
    assert "900 only in the second" in told.split("WARNING: ")[1]
    same = CliRunner().invoke(app, ["compare", batches[0].id, batches[0].id, "--store", store.url]).output
    assert "WARNING: " not in same


def test_without_flips_no_map_is_written_and_it_is_said(batches: tuple[OpenBatch, OpenBatch], tmp_path: Path):
    name, maps = batches[0].id, tmp_path / "maps"
    told = CliRunner().invoke(app, ["compare", name, name, "--store", batches[0].store.url, "--output", str(maps)])
    assert f"nothing was written to {maps}: no episode came out differently" in told.output
    assert not maps.exists()


def test_results_that_are_not_what_the_batch_wrote_are_not_compared(batches: tuple[OpenBatch, OpenBatch]):
    store, record = batches[0].store, batches[0].record()
    key = str(record.detail["results_url"]).removeprefix(store.url + "/")
    before = store.get(key).body
    store.put(key, before + b" ")
    try:
        with pytest.raises(StageFailed, match=r"MismatchedEtag.*is not what the batch wrote"):
            find_batch(store, record.id)
    finally:
        store.put(key, before)


@pytest.fixture(scope="module")
def two_versions(batches: tuple[OpenBatch, OpenBatch], tmp_path_factory: pytest.TempPathFactory) -> OpenBatch:
    """A batch that drove both versions in the same worlds with the same seeds, as documents with noWorseThan ask."""
    store = batches[0].store
    newer = pushing_plan(store, robot=slower_pusher(tmp_path_factory.mktemp("two")))
    older = pushing_plan(store)
    (new,), (old,) = newer.templates, older.templates
    assert old.robot.version != new.robot.version
    return closed_batch(store, older.model_copy(update={"templates": (old, new)}), "both")


def test_a_batch_of_two_versions_is_not_paired_by_the_turn_of_its_episodes(
    batches: tuple[OpenBatch, OpenBatch], two_versions: OpenBatch
):
    names = sorted({template.robot.version for template in two_versions.plan.templates})
    which = " or ".join(f"{two_versions.id}@{name}" for name in names)
    for words in ([batches[0].id, two_versions.id], [two_versions.id, batches[0].id], [two_versions.id] * 2):
        with pytest.raises(DocumentError, match="this batch drove several, so name one: ") as refused:
            [find_batch(batches[0].store, word) for word in words]
        assert which in str(refused.value)


def test_one_batch_is_compared_with_itself_over_its_two_versions(
    batches: tuple[OpenBatch, OpenBatch], two_versions: OpenBatch
):
    store = batches[0].store
    old, new = (template.robot.version for template in two_versions.plan.templates)
    within = common_episodes(*(find_batch(store, f"{two_versions.id}@{name}") for name in (old, new)))
    between = common_episodes(*(find_batch(store, batch.id) for batch in batches))
    assert within.pairs == between.pairs == 32
    assert (within.first_passed, within.second_passed) == (between.first_passed, between.second_passed)
    assert [(flip.seed, flip.before, flip.after) for flip in within.flips] == [
        (flip.seed, flip.before, flip.after) for flip in between.flips
    ]
    assert (within.first_alone, within.second_alone) == (0, 0)


def test_ways_of_one_of_two_versions_are_its_own(batches: tuple[OpenBatch, OpenBatch], two_versions: OpenBatch):
    store = batches[0].store
    first, second = (
        find_batch(store, f"{two_versions.id}@{each.robot.version}") for each in two_versions.plan.templates
    )
    drawn, *_ = flip_maps(first, second, common_episodes(first, second).flips[:1])
    lines = [each for each in ET.fromstring(drawn.svg).iter(f"{SVG}polyline") if each.get("class") == "second"]  # noqa: S314 - our own document
    assert len(lines) == 1


def test_a_version_may_be_named_by_its_digest_and_one_that_was_not_driven_is_refused(two_versions: OpenBatch):
    digest = two_versions.plan.templates[1].robot.digest
    assert find_batch(two_versions.store, f"{two_versions.id}@{digest[:10]}").rows.num_rows == 32
    for name in ("99", "0000000000", ""):
        with pytest.raises(DocumentError, match="a version that this batch drove: "):
            find_batch(two_versions.store, f"{two_versions.id}@{name}")


def test_a_comment_for_a_pull_request_has_the_pairs_and_the_commands(batches: tuple[OpenBatch, OpenBatch], run: Run):
    code, text = run("--markdown", "--margin", "0.99")
    assert code == 0
    assert text.startswith("<!-- simyard compare -->\n## ✅ NO WORSE\n")
    first, second = (batch.record().arn.replace("-batch:", ":") for batch in batches)
    assert f"`simyard replay {first}/" in text
    assert f"`simyard replay {second}/" in text
    assert "`not the same: robot_version: 1 -> 2`" in text
    assert run("--markdown", "--json")[0] == 2
