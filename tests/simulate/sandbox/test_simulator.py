"""Whoever listens to progress hears of each program that is compiled, and of no more than a process can have."""

from tasks.progress.listener import listen_to_progress
from tasks.simulate.sandbox.protocol import Answer, Compiles, Progress
from tasks.simulate.sandbox.simulator import Compilations


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
