"""What a gate is going to judge by is told before the batch runs, as the gate will count it."""

from pathlib import Path

import pytest

from flows.preview.gate_plan import GateBasis, gate_basis
from specs.pipeline.gate_section import NoWorseThan
from tasks.storage.base.store import Store
from tests.factories.judged_batches import courier, delivery, ended
from tests.factories.planned_batches import plan, template

RULE = NoWorseThan(applicationVersion="1", margin=0.06)


class Shelf:
    """Versions of courier, and what asks a scenario of one."""

    def __init__(self, store: Store, folder: Path) -> None:
        self.old, self.new, self.third = (courier(store, folder, text) for text in ("old", "new", "third"))
        self.scenario = delivery(store, folder)

    def asks(self, robot: object, **changes: object):
        """Returns a request of a version."""
        return template(robot=robot, scenario=self.scenario, **changes)


@pytest.fixture
def shelf(file_store: Store, tmp_path: Path) -> Shelf:
    return Shelf(file_store, tmp_path)


def _judged(store: Store, shelf: Shelf, *templates: object, rule: NoWorseThan | None = RULE, **changes: object):
    return gate_basis(plan(store, templates=templates, **changes), rule, shelf.old.digest, store)


def test_of_both_versions_in_one_batch_the_tested_one_is_counted(file_store: Store, shelf: Shelf):
    both = [shelf.asks(shelf.new), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *both) == GateBasis(episodes=6, pairs=6)
    assert _judged(file_store, shelf, *both, sweep={"SPEED": ("1", "2")}) == GateBasis(episodes=12, pairs=12)


def test_only_episodes_that_are_the_same_are_pairs(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(shelf.new), shelf.asks(shelf.new, environment={"A": "1"}), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *asked) == GateBasis(episodes=12, pairs=6)


def test_without_a_comparison_all_are_counted(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(shelf.new), shelf.asks(shelf.old)]
    assert _judged(file_store, shelf, *asked, rule=None) == GateBasis(episodes=12, pairs=12)


def test_where_nobody_drove_the_other_version_it_is_said(file_store: Store, shelf: Shelf):
    assert _judged(file_store, shelf, shelf.asks(shelf.new)).no_baseline.startswith("no batch that Completed drove")
    ended(file_store, shelf.old, scenario=shelf.scenario)
    assert _judged(file_store, shelf, shelf.asks(shelf.new)) == GateBasis(episodes=6, pairs=6)
    assert _judged(file_store, shelf, shelf.asks(shelf.new), seeds=(900,)).pairs == 0


def test_two_tested_versions_leave_open_which_is_meant(file_store: Store, shelf: Shelf):
    asked = [shelf.asks(each) for each in (shelf.new, shelf.third, shelf.old)]
    assert _judged(file_store, shelf, *asked).no_baseline == "the batch tests several versions besides version 1"
