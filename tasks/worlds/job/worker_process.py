"""A process that makes worlds: the order on the first line of its input, then indices, an answer for each line."""

import gc
import sys
from typing import BinaryIO

from tasks.worlds.job.production import INDICES, Order, answer, make

# A world is some ten thousand objects, none of which refers to itself: hardly anything is garbage to look for.
_OBJECTS_A_SEARCH = 50_000


def work(asked: BinaryIO, answers: BinaryIO) -> None:
    """Answers every line until the input ends, as it does when the job is killed."""
    order = Order.model_validate_json(asked.readline())
    warm = False
    for line in asked:
        answers.write(answer([make(order, each) for each in INDICES.validate_json(line)]))
        answers.flush()
        if not warm:
            # What is imported by now stays: looking through it for garbage again and again takes a twelfth of the time.
            gc.freeze()
            gc.set_threshold(_OBJECTS_A_SEARCH)
            warm = True


if __name__ == "__main__":
    work(sys.stdin.buffer, sys.stdout.buffer)
