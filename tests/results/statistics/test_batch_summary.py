"""What is printed of a batch."""

from collections.abc import Sequence

from hypothesis import given

from specs.data.episode import EpisodeRequest, EpisodeResult
from tasks.results.statistics.batch_summary import BatchSummary, EpisodeTally, summary_note, summary_rows
from tasks.results.statistics.intervals import IntervalFamily, percent_range, wilson
from tests.factories.episodes import canceled, collided, crashed, episodes, passed, request
from tests.results.estimands import without_estimand

REQUESTS = [
    request(index, world=f"wgj-1/world-{index % 2}-1", environment={"MAX_SPEED": speed, "MODE": "a"})
    for index, speed in enumerate(["0.3", "0.3", "0.6", "0.6", "0.6"])
]
RESULTS = [passed(0), passed(1), collided(2), crashed(3), canceled(4)]


def summarise(
    requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult], variables: Sequence[str] = ()
) -> BatchSummary:
    tally = EpisodeTally(variables)
    tally.add(requests, results)
    return tally.summary()


def test_groups_are_worlds_and_the_values_of_what_varies():
    summary = summarise(REQUESTS, RESULTS, ["MAX_SPEED"])
    assert [(group.label, group.successes, group.episodes) for group in summary.by_world] == [
        ("wgj-1/world-0-1", 1, 2),
        ("wgj-1/world-1-1", 1, 2),
    ]
    [(name, groups)] = summary.by_variable
    assert name == "MAX_SPEED"
    assert [(group.label, group.rate) for group in groups] == [("0.3", 1.0), ("0.6", 0.0)]


def test_reasons_are_counted_and_cancels_told_apart():
    total = summarise(REQUESTS, RESULTS).total
    assert total.reasons == (("RobotApplicationCrash", 1), ("collision", 1))
    assert (total.episodes, total.canceled) == (4, 1)


def test_a_table_has_a_row_for_the_whole_and_for_each_group():
    rows = summary_rows(summarise(REQUESTS, RESULTS, ["MAX_SPEED"]))
    assert rows[0][:2] == ("all", "2/4")
    assert rows[-1][0] == "MAX_SPEED=0.6"
    assert rows[-1][-1] == "1 RobotApplicationCrash, 1 collision, 1 canceled"


def test_the_intervals_of_its_groups_hold_together_and_a_note_says_so():
    summary = summarise(REQUESTS, RESULTS, ["MAX_SPEED"])
    family = IntervalFamily(size=4, confidence=0.95)
    rows = {row[0]: row[3] for row in summary_rows(summary)}
    assert rows["all"] == percent_range(wilson(2, 4, 0.95))
    assert rows["MAX_SPEED=0.3"] == percent_range(family.interval(2, 2))
    note = summary_note(summary)
    assert note.startswith(
        "Rates in these 2 worlds, that of a world in it alone; 95 % intervals. 4 intervals of groups"
    )
    assert without_estimand("\n\n".join([note, "| " + " | ".join(rows.values())])) == []


@given(episodes())
def test_the_worlds_add_up_to_the_total(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    summary = summarise(*drawn)
    assert sum(group.episodes for group in summary.by_world) == summary.total.episodes
    assert sum(group.successes for group in summary.by_world) == summary.total.successes


@given(episodes())
def test_parts_add_up_to_the_whole(drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    requests, results = drawn
    parts, by_index = EpisodeTally(["MODE"]), {result.index: result for result in results}
    for start in range(0, len(requests), 3):
        part = requests[start : start + 3]
        parts.add(part, [by_index[request.index] for request in part])
    assert parts.summary() == summarise(requests, results, ["MODE"])


def test_why_not_tells_the_most_frequent_reason_first_and_what_the_first_such_episode_said():
    tally = EpisodeTally()
    tally.add([request(index) for index in range(4)], [crashed(0), crashed(1), collided(2), passed(3)])
    assert [(name, count) for name, count, _ in tally.why_not()] == [("RobotApplicationCrash", 2), ("collision", 1)]
    assert tally.why_not()[0][2] == "the controller returned a control that is no number"
    assert tally.simulated_s == 4 * 31.5


def test_worlds_stand_in_the_order_of_the_batch_and_not_of_the_alphabet():
    requests = [request(index, world=f"g/world-{number}-1") for index, number in enumerate((1, 2, 10))]
    summary = summarise(requests, [passed(index) for index in range(3)])
    assert [group.label for group in summary.by_world] == ["g/world-1-1", "g/world-2-1", "g/world-10-1"]
