"""The command `simyard`, here so that it says what hides Simyard's packages, if anything does."""

import os

from simyard.start import leave_quietly

# COLUMNS of programs that do not know how wide they are; rich would print nothing.
_NO_WIDTH = ("0", "1")


def main() -> None:
    """Runs the command line and exits with its codes; an interrupt while it is imported shows no traceback either."""
    leave_quietly()
    if os.environ.get("COLUMNS", "") in _NO_WIDTH:
        os.environ.pop("COLUMNS", None)
    from flows.cli.shell import app  # noqa: PLC0415 - takes a third of a second
    from flows.cli.terminal import end_process  # noqa: PLC0415 - same
    from tasks.progress.log_lines import log_in_chosen_format  # noqa: PLC0415 - same

    with end_process(), log_in_chosen_format():
        app()


if __name__ == "__main__":
    main()
