"""Processes that simulate: whose fault it is that one ends, and which compilations its listener hears of."""

import os

import pytest

from tasks.progress.listener import listen_to_progress
from tasks.simulate.sandbox import simulator
from tasks.simulate.sandbox.protocol import Answer, AuditWork, Compiles, Progress, SentWorlds
from tasks.simulate.sandbox.simulator import CapturedOutput, Compilations, Simulator, SimulatorNotStarted


def heard(*answers: Answer) -> list[tuple[str, int, int]]:
    told: list[tuple[str, int, int]] = []
    compilations = Compilations()
    with listen_to_progress(lambda *what: told.append(what)):
        for answer in answers:
            compilations.hear(answer)
    return told


def test_a_program_is_compiled_until_the_next_answer():
    assert heard(Progress(done=1), Compiles(), Progress(done=2), Progress(done=3)) == [
        ("Compilation", 0, 1),
        ("Compilation", 1, 1),
    ]


def test_the_next_program_is_counted_on():
    assert heard(Compiles(), Compiles())[-2:] == [("Compilation", 1, 1), ("Compilation", 1, 2)]


def test_an_application_cannot_fill_a_log_with_them():
    assert len(heard(*[Compiles()] * 10_000)) < 200


def test_a_process_that_ends_before_any_application_blames_the_machine(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(simulator, "_MODULE", "tasks.simulate.of_no_such_name")
    process = Simulator({})
    work = AuditWork(here=(), others=(), worlds=SentWorlds(new={}), bundles={}, lanes=8, engine="auto")
    try:
        with pytest.raises(SimulatorNotStarted, match=r"exit code 1; it printed last: .*of_no_such_name"):
            process.ask(work)
    finally:
        process.end()


def test_what_was_printed_before_it_is_asked_for_is_there_however_busy_the_machine_is():
    read, write = os.pipe()
    output = CapturedOutput(open(read, "rb"))  # noqa: SIM115, PTH123 - it closes it at the end
    for number in range(100):
        os.write(write, b"line %d\n" % number)
        assert output.take() == f"line {number}\n"
    os.close(write)
    output.wait(60.0)
    assert output.take() == ""
