"""The layout of a batch: which episode stands where in its plan, computed for any place and never written out.

Episodes are numbered by request, world, parameter set, seed and, where several share a world, robot. Those that share a
program form a group, in the order of their numbers, and a group is cut into chunks of as many as there are lanes. A
batch that may be ended early is shuffled before it is cut. Versions that are compared are two programs, and take turns
on the same shuffled episodes.
"""

import bisect
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from specs.base import digest
from specs.data.episode import EpisodeRequest
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.chunks import Chunk, ProgramKey, Shuffle, program_key, split_environment

_VERSIONS = 2


@dataclass(frozen=True)
class _Block:
    """The episodes of one template that share a program: all its worlds and seeds, with some of the settings."""

    template: int
    settings: Sequence[int]
    size: int


@dataclass(frozen=True)
class _Group:
    """All episodes that share a program.

    Attributes:
        blocks: What it is made of.
        starts: The position at which each block begins.
        size: How many episodes there are.
        first_chunk: The number of its first chunk.
        every: Its next chunk comes so many numbers later.
    """

    blocks: tuple[_Block, ...]
    starts: tuple[int, ...]
    size: int
    first_chunk: int
    every: int = 1

    def number(self, turn: int) -> int:
        """Returns the number of one of its chunks, which are counted from 0."""
        return self.first_chunk + turn * self.every


@dataclass(frozen=True, eq=False)
class Layout:
    """The episodes of a plan and the chunks that they fall into."""

    plan: BatchPlan

    @cached_property
    def plan_digest(self) -> str:
        """SHA-256 of the plan."""
        return digest(self.plan)

    @cached_property
    def episodes(self) -> int:
        """How many episodes there are."""
        return self.offsets[-1]

    @cached_property
    def chunks(self) -> int:
        """How many chunks there are."""
        return sum(_chunks_in(group.size, self.plan.lanes) for group in self._groups)

    def request(self, index: int) -> EpisodeRequest:
        """Returns one episode.

        Raises:
            IndexError: There are fewer.
        """
        self._require(index, self.episodes, "episode")
        template = bisect.bisect_right(self.offsets, index) - 1
        rest, seed = divmod(index - self.offsets[template], self.turns)
        world, setting = divmod(rest, self.settings)
        return self._made(index, template, world, setting, seed)

    def whole(self, requests: Sequence[EpisodeRequest]) -> list[EpisodeRequest]:
        """Returns some of the episodes, each once, with all robots that share a world with theirs, side by side."""
        groups = dict.fromkeys((each.index - each.number, each.sharing) for each in requests)
        known = {each.index: each for each in requests}
        return [known.get(first + k) or self.request(first + k) for first, count in groups for k in range(count)]

    def requests(self, first: int = 0, end: int | None = None) -> Iterator[EpisodeRequest]:
        """Yields the episodes from ``first`` to before ``end``, or to the last."""
        yield from map(self.request, range(first, self.episodes if end is None else end))

    def programs(self) -> list[tuple[EpisodeRequest, int]]:
        """Returns an episode of each program, and how many episodes share it, in the order of their chunks."""
        return [(self._at(group, 0), group.size) for group in self._groups]

    def template_of(self, index: int) -> int:
        """Returns the position of the request that an episode came from."""
        return bisect.bisect_right(self.offsets, index) - 1

    def chunk(self, number: int) -> Chunk:
        """Returns one chunk, its episodes in the order of their numbers.

        Raises:
            IndexError: There are fewer.
        """
        group, turn = self._place(number)
        start, robots = turn * self.plan.lanes, self.plan.sharing
        positions: Sequence[int] = range(start, min(start + self.plan.lanes, group.size))
        if self.plan.shuffled:
            drawn = sorted(self._shuffle(group).order[start // robots : (start + self.plan.lanes) // robots])
            positions = [robots * together + number for together in drawn for number in range(robots)]
        return Chunk(number=number, requests=tuple(self._at(group, position) for position in positions))

    def chunk_size(self, number: int) -> int:
        """Returns how many episodes a chunk has.

        Raises:
            IndexError: There are fewer chunks.
        """
        group, turn = self._place(number)
        return min(self.plan.lanes, group.size - turn * self.plan.lanes)

    def looks(self) -> tuple[int, ...]:
        """Returns after how many episodes the gate is asked, if it knows the batch's end; of either version, of pairs.

        A batch that is not shuffled is only judged at its end.
        """
        if not self.plan.shuffled or not self._groups:
            return ()
        size = self._groups[0].size
        return (*range(self.plan.lanes, size, self.plan.lanes), size)

    def in_pairs(self) -> bool:
        """Returns whether there are two programs, and each episode of one is one of the other but for the robot."""
        if len(self._groups) != _VERSIONS:
            return False
        ours, theirs = ([self._asked(block) for block in group.blocks] for group in self._groups)
        return ours == theirs

    def chunk_of(self, index: int) -> int:
        """Returns the number of the chunk that holds an episode.

        Raises:
            IndexError: There are fewer episodes.
        """
        self._require(index, self.episodes, "episode")
        return self.chunks_between(index, index + 1)[0]

    def chunks_between(self, first: int, end: int) -> list[int]:
        """Returns the numbers of the chunks that hold episodes from ``first`` to before ``end``."""
        found: list[int] = []
        for group in self._groups:
            low, high = self._position(group, first), self._position(group, end)
            lanes, robots = self.plan.lanes, self.plan.sharing
            if low < high and self.plan.shuffled:
                turns = self._shuffle(group).turn[low // robots : -(-high // robots)]
                found += {group.number(robots * turn // lanes) for turn in turns}
            elif low < high:
                found += range(group.number(low // lanes), group.number((high - 1) // lanes) + 1)
        return sorted(found)

    def _place(self, number: int) -> tuple[_Group, int]:
        """Returns whose chunk has a number, and which of its chunks it is."""
        self._require(number, self.chunks, "chunk")
        if self.plan.shuffled == "pairs":
            return self._groups[number % _VERSIONS], number // _VERSIONS
        group = self._groups[bisect.bisect_right(self._first_chunks, number) - 1]
        return group, number - group.first_chunk

    def _asked(self, block: _Block) -> tuple[object, ...]:
        """Returns what is asked of the episodes of a block, whichever robot drives them."""
        asked = self.plan.templates[block.template]
        own, settings = (asked.environment, asked.judge_environment), tuple(block.settings)
        return asked.scenario, own, asked.duration_s, self.plan.worlds_of(asked), asked.seed, settings

    def _shuffle(self, group: _Group) -> Shuffle:
        return self._shuffles[self._first_chunks.index(group.first_chunk)]

    @cached_property
    def _shuffles(self) -> list[Shuffle]:
        seed, robots = digest(self.plan), self.plan.sharing
        if self.plan.shuffled == "pairs":  # both versions in the same order
            return [Shuffle(self._groups[0].size // robots, f"{seed}/0")] * _VERSIONS
        return [Shuffle(group.size // robots, f"{seed}/{group.first_chunk}") for group in self._groups]

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(sorted(self.plan.sweep))

    @cached_property
    def settings(self) -> int:
        """How many sets of values there are."""
        return math.prod(len(self.plan.sweep[name]) for name in self._names)

    @property
    def turns(self) -> int:
        """How many rows there are of a world and a set of values: one for each seed, and each of several robots."""
        return len(self.plan.seeds) * self.plan.sharing

    @cached_property
    def offsets(self) -> list[int]:
        """Returns the number of each template's first episode, and at the end the number of all."""
        of_world = self.settings * self.turns
        sizes = (len(self.plan.worlds_of(template)) * of_world for template in self.plan.templates)
        return list(itertools.accumulate(sizes, initial=0))

    @cached_property
    def _groups(self) -> tuple[_Group, ...]:
        blocks: dict[ProgramKey, list[_Block]] = {}
        kinds = self._kinds_of_settings()
        for number, template in enumerate(self.plan.templates):
            worlds = len(self.plan.worlds_of(template))
            if worlds == 0:
                continue
            for settings in kinds:
                request = self._made(0, number, 0, settings[0], 0)
                size = worlds * len(settings) * self.turns
                blocks.setdefault(program_key(request), []).append(_Block(number, settings, size))
        ordered = sorted(blocks.values(), key=lambda group: self._first_index(group[0]))
        return tuple(self._numbered(ordered))

    def _numbered(self, ordered: Sequence[Sequence[_Block]]) -> "list[_Group]":
        groups: list[_Group] = []
        chunk, pairs = 0, self.plan.shuffled == "pairs"
        for blocks in ordered:
            *starts, size = itertools.accumulate((block.size for block in blocks), initial=0)
            groups.append(_Group(tuple(blocks), tuple(starts), size, chunk, _VERSIONS if pairs else 1))
            chunk += 1 if pairs else _chunks_in(size, self.plan.lanes)
        return groups

    @cached_property
    def _first_chunks(self) -> list[int]:
        return [group.first_chunk for group in self._groups]

    def _kinds_of_settings(self) -> list[Sequence[int]]:
        """Returns the settings' numbers, those together that differ in numbers alone and so share a program."""
        kinds = {name: [_kind(name, value) for value in self.plan.sweep[name]] for name in self._names}
        if all(kind is None for each in kinds.values() for kind in each):
            return [range(self.settings)]
        found: dict[tuple[str | None, ...], list[int]] = {}
        for number, kind in enumerate(itertools.product(*kinds.values())):
            found.setdefault(kind, []).append(number)
        return list(found.values())

    def _first_index(self, block: _Block) -> int:
        return self.offsets[block.template] + block.settings[0] * self.turns

    def _at(self, group: _Group, position: int) -> EpisodeRequest:
        number = bisect.bisect_right(group.starts, position) - 1
        block = group.blocks[number]
        rest, seed = divmod(position - group.starts[number], self.turns)
        world, turn = divmod(rest, len(block.settings))
        setting = block.settings[turn]
        index = self.offsets[block.template] + (world * self.settings + setting) * self.turns + seed
        return self._made(index, block.template, world, setting, seed)

    def _position(self, group: _Group, index: int) -> int:
        """Returns how many episodes of a group have a lower number."""
        found = 0
        for block in group.blocks:
            if index <= self.offsets[block.template]:
                break
            found += min(self._below(block, index - self.offsets[block.template]), block.size)
        return found

    def _below(self, block: _Block, below: int) -> int:
        seeds = self.turns
        rest, seed = divmod(below, seeds)
        world, setting = divmod(rest, self.settings)
        turn = bisect.bisect_left(block.settings, setting)
        own = seed if turn < len(block.settings) and block.settings[turn] == setting else 0
        return (world * len(block.settings) + turn) * seeds + own

    def _made(self, index: int, template: int, world: int, setting: int, turn: int) -> EpisodeRequest:
        asked, (seed, number) = self.plan.templates[template], divmod(turn, self.plan.sharing)
        return EpisodeRequest(
            index=index,
            world=self.plan.worlds_of(asked)[world],
            seed=self.plan.seeds_of(asked)[seed],
            robot=asked.robot,
            scenario=asked.scenario,
            environment={**asked.environment, **(swept := self._values(setting))},
            judge_environment=asked.judge_environment and {**asked.judge_environment, **swept},
            duration_s=asked.duration_s,
            failure_behavior=asked.failure_behavior,
            people=self.plan.people,
            boxes=self.plan.boxes,
            robots=self.plan.robots,
            number=number,
        )

    def _values(self, setting: int) -> dict[str, str]:
        values: dict[str, str] = {}
        for name in reversed(self._names):  # the last name varies fastest
            setting, choice = divmod(setting, len(self.plan.sweep[name]))
            values[name] = self.plan.sweep[name][choice]
        return values

    @staticmethod
    def _require(number: int, count: int, what: str) -> None:
        if not 0 <= number < count:
            raise IndexError(f"{what} {number}: there are {count}")


def _chunks_in(size: int, lanes: int) -> int:
    return -(-size // lanes)


def _kind(name: str, value: str) -> str | None:
    """Returns what of a value decides the program: a text itself, of a number nothing."""
    return split_environment({name: value})[1].get(name)
