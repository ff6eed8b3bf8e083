"""Progress is told to the listener of the context, and to nobody outside it."""

from contextvars import copy_context

from tasks.progress.listener import listen_to_progress, report_progress


def test_a_listener_hears_what_is_told_inside_its_block_only():
    heard: list[tuple[str, int, int]] = []
    report_progress("Worlds", 0, 8)
    with listen_to_progress(lambda stage, done, total: heard.append((stage, done, total))):
        report_progress("Worlds", 1, 8)
    report_progress("Worlds", 2, 8)
    assert heard == [("Worlds", 1, 8)]


def test_a_task_in_a_copy_of_the_context_is_heard_too():
    heard: list[int] = []
    with listen_to_progress(lambda _stage, done, _total: heard.append(done)):
        copy_context().run(report_progress, "Episodes", 5, 9)
    assert heard == [5]
