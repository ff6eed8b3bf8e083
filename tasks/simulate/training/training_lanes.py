"""Lanes for a trainer, from the host: actions go in, NumPy arrays come out of each control step."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Bool, Float32, Int

from specs.data.episode import CONTROL_S
from tasks.simulate.engines.program import LaneTransfer
from tasks.simulate.sensors.sensor import seed_words
from tasks.simulate.training.training_program import PackedTraining, Renewal, Standing, TrainingProgram

# A reward and two flags, and how the episode stands, go before what is seen.
_GIVEN, _FIRST = 3, 12


class LaneStep(NamedTuple):
    """What a step gives, lanes first; arrays of the caller's own."""

    observation: dict[str, Float32[np.ndarray, "lanes ..."]]
    reward: Float32[np.ndarray, "lanes"]
    terminated: Bool[np.ndarray, "lanes"]
    truncated: Bool[np.ndarray, "lanes"]


class EpisodeEnds(NamedTuple):
    """How episodes stand, lanes first; fields as in EpisodeResult."""

    reason: Int[np.ndarray, "lanes"]
    goals_reached: Int[np.ndarray, "lanes"]
    simulated_s: np.ndarray
    path_length_m: np.ndarray
    collisions: Int[np.ndarray, "lanes"]
    pose: np.ndarray


class TrainingLanes:
    """Lanes that a trainer steps.

    Attributes:
        program: What they share with others of the same task.
        count: How many there are.
    """

    def __init__(self, program: TrainingProgram, count: int) -> None:
        self.program, self.count = program, count
        mesh = program.compiled.mesh
        self._transfer = LaneTransfer(mesh)
        self._pool = jax.device_put(program.pool.arrays, NamedSharding(mesh, PartitionSpec()))
        self._lanes: PackedTraining = program.compiled.blank(self._pool, self._put(np.ones(count, bool)))
        self._first, self._seen = np.zeros((count, _FIRST), np.float32), np.zeros((count, 0), np.float32)

    @property
    def seen(self) -> Float32[np.ndarray, "lanes numbers"]:
        """Returns the last observation, one field's numbers after another's; the same memory as its fields."""
        return self._seen

    def reset(self, marked: Bool[np.ndarray, "lanes"], seeds: Sequence[int | None]) -> dict[str, np.ndarray]:
        """Begins the next episodes of some lanes, and returns all lanes' observations.

        Args:
            marked: Which lanes.
            seeds: A new seed for a lane, whose first episode it then begins; None for one that goes on.
        """
        fresh, words = np.zeros(self.count, bool), np.zeros((self.count, 2), np.uint32)
        for lane, seed in enumerate(seeds):
            if seed is not None and marked[lane]:
                fresh[lane], words[lane] = True, seed_words(int(seed))
        renewal = Renewal(self._put(marked), self._put(fresh), self._put(words))
        self._lanes, rows = self.program.compiled.renew(self._pool, self._lanes, renewal)
        self._keep(rows)
        return self._fields()

    def step(self, actions: Float32[np.ndarray, "lanes actions"]) -> LaneStep:
        """Drives all lanes a control step, and returns what it gives.

        Args:
            actions: Finite numbers.
        """
        self._lanes, rows = self.program.compiled.step(self._pool, self._lanes, self._put(actions))
        self._keep(rows)
        reward, terminated, truncated = self._first[:, :_GIVEN].T
        return LaneStep(self._fields(), reward.copy(), terminated > 0.0, truncated > 0.0)

    def ends(self) -> EpisodeEnds:
        """Returns how the lanes' episodes stand."""
        standing = self._standing()
        return EpisodeEnds(
            reason=standing.reason.astype(np.int32),
            goals_reached=standing.goal_index.astype(np.int32),
            simulated_s=np.round(standing.step.astype(np.int32) * CONTROL_S, 6),
            path_length_m=standing.path_length_m.copy(),
            collisions=standing.collisions.astype(np.int32),
            pose=standing.pose.copy(),
        )

    def episodes(self) -> Int[np.ndarray, "lanes"]:
        """Returns which episode of the pool each lane is in."""
        return self._standing().episode.astype(np.int32)

    def _put(self, array: np.ndarray) -> jax.Array:
        """Returns an array on the devices, with nothing for the lanes that only fill them."""
        whole = np.zeros((self.program.lanes, *array.shape[1:]), array.dtype)
        whole[: len(array)] = array
        return self._transfer.put(whole)

    def _keep(self, rows: jax.Array) -> None:
        # Copies: what an array on the host's own devices shows is used up by the next step.
        shares = self._transfer.fetch(rows)
        self._first = np.concatenate([share[:, :_FIRST] for share in shares])[: self.count]
        self._seen = np.concatenate([share[:, _FIRST:] for share in shares])[: self.count]

    def _standing(self) -> Standing:
        reason, goal, step, way_m, collisions, *pose, episode = self._first[:, _GIVEN:].T
        return Standing(reason, goal, step, way_m, collisions, np.stack(pose, axis=1), episode)

    def _fields(self) -> dict[str, np.ndarray]:
        fields: dict[str, np.ndarray] = {}
        begin = 0
        for name, bounds in self.program.bounds.items():
            end = begin + bounds.low.size
            fields[name] = self._seen[:, begin:end].reshape(self.count, *bounds.low.shape)
            begin = end
        return fields
