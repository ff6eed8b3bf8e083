"""How far a run is can be read while it goes on, in a terminal and in the log of a CI."""

import io

from rich.console import Console

from flows.cli.run_command import ProgressLines, progress_bars


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def lines(*told: tuple[float, str, int, int]) -> list[str]:
    console, clock = Console(file=io.StringIO(), record=True), Clock()
    shown = ProgressLines(console, clock)
    for now_s, stage, done, total in told:
        clock.now_s = now_s
        shown.listen(stage, done, total)
    return [line.strip() for line in console.export_text().splitlines()]


def test_a_log_has_a_line_at_a_stages_begin_and_end():
    assert lines((1.0, "Worlds", 0, 2), (1.5, "Worlds", 1, 2), (2.0, "Worlds", 2, 2)) == [
        "1.0 s  Worlds 0/2",
        "2.0 s  Worlds 2/2",
    ]


def test_a_stage_that_lasts_has_a_line_every_ten_seconds():
    told = [(float(second), "Episodes", second, 1_000) for second in range(35)]
    assert [line.rpartition(" ")[2] for line in lines(*told)] == ["0/1,000", "10/1,000", "20/1,000", "30/1,000"]


def test_what_was_said_is_not_said_again():
    assert (
        len(lines((0.0, "Worlds", 0, 2), (20.0, "Worlds", 0, 2), (21.0, "Worlds", 2, 2), (22.0, "Worlds", 2, 2))) == 2
    )


def test_a_file_gets_lines_while_the_run_goes_on():
    file = io.StringIO()
    with progress_bars(Console(file=file)) as listener:
        listener("Worlds", 0, 2)
        assert "Worlds 0/2" in file.getvalue()


def test_a_terminal_gets_bars():
    file = io.StringIO()
    with progress_bars(Console(file=file, force_terminal=True, width=100)) as listener:
        listener("Worlds", 1, 2)
    assert "1/2" in file.getvalue()
    assert " s  Worlds" not in file.getvalue()
