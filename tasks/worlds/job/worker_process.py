"""A process that makes worlds: the order on the first line of its input, then indices, a line of worlds for each."""

import gc
import sys
from typing import TextIO

from tasks.worlds.job.production import INDICES, MADE, Order, make


def work(asked: TextIO, answers: TextIO) -> None:
    """Answers every line until the input ends, as it does when the job is killed."""
    order = Order.model_validate_json(asked.readline())
    warm = False
    for line in asked:
        answers.write(MADE.dump_json([make(order, each) for each in INDICES.validate_json(line)]).decode() + "\n")
        answers.flush()
        if not warm:
            # What is imported by now stays: looking through it for garbage again and again takes a twelfth of the time.
            gc.freeze()
            warm = True


if __name__ == "__main__":
    work(sys.stdin, sys.stdout)
