"""AnySkill's early termination: an episode in which the similarity with the text keeps falling is given up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

Rule = Literal["successive", "cumulative", "off"]
BoolArray = NDArray[np.bool_]


class DecreaseCounter:
    """Counts how often the similarity of n episodes fell, and says which of them are given up.

    AnySkill (Cui et al., CVPR 2024) describes the rule twice, and differently. Section 3.3, "successive": after 8 falls of
    the similarity in a row an episode ends with probability 0.8. Algorithm 1, "cumulative": the falls need not come in a
    row. In both, the count starts anew when it has reached 8, whether the episode ends or not. (The code that the authors
    released counts, but never ends an episode for it.)

    Args:
        count: number of episodes n.
        rule: "successive", "cumulative" or "off".
        patience: falls after which an episode may be given up.
        probability: probability that it then is.

    Raises:
        ValueError: an argument out of its range.
    """

    def __init__(self, count: int, rule: Rule, patience: int, probability: float) -> None:
        if rule not in ("successive", "cumulative", "off"):
            raise ValueError(
                f'The rule of early termination must be "successive", "cumulative" or "off", not {rule!r}.'
            )
        if patience < 1:
            raise ValueError(f"patience must be at least 1 step, not {patience}.")
        if not 0.0 <= probability <= 1.0:
            raise ValueError(f"probability must be between 0 and 1, not {probability}.")
        self._rule = rule
        self._patience = patience
        self._probability = probability
        self._falls = np.zeros(count, np.int64)
        self._last = np.full(count, -np.inf)
        self._rng = np.random.default_rng()

    def seed(self, seed: int | Sequence[int | None] | None) -> None:
        """Seed the draws; the environment's own randomness is left alone."""
        if isinstance(seed, Sequence):
            self._rng = np.random.default_rng([0 if item is None else item for item in seed])
        elif seed is not None:
            self._rng = np.random.default_rng(seed)

    def start(self, ids: int | NDArray[Any]) -> None:
        """Begin new episodes."""
        self._falls[ids] = 0
        self._last[ids] = -np.inf

    def given_up(self, info: dict[str, Any]) -> BoolArray:
        """Take in one step.

        Args:
            info: of the step, with the similarities ``(n,)``.

        Returns:
            Episodes that end here, ``(n,)``.

        Raises:
            ValueError: there is no similarity in `info`.
        """
        if self._rule == "off":
            return np.zeros(len(self._falls), bool)
        if "similarity" not in info:
            raise ValueError(
                'Early termination watches info["similarity"], which this environment does not give: use HumanoidText-v0, '
                "or wrap the environment in TextReward with a reward about a text first."
            )
        similarity = np.atleast_1d(np.array(info["similarity"], np.float64))  # a copy: the info is the user's
        fell = similarity < self._last
        self._last = similarity
        self._falls = np.where(fell, self._falls + 1, 0 if self._rule == "successive" else self._falls)
        over = np.flatnonzero(self._falls >= self._patience)
        self._falls[over] = 0
        ends = np.zeros(len(self._falls), bool)
        ends[over] = self._rng.random(len(over)) < self._probability
        return ends


class EarlyTermination(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Terminates episodes in which `info["similarity"]` keeps falling; see :class:`DecreaseCounter`.

    Steps are those of the wrapped environment: decisions of 1/6 s in `HumanoidText-v0`, each with the mean similarity of
    its controller steps. The paper's other rule, a head below 0.15 m, belongs to the environment (`minimum_head_height`).
    `info["early_termination"]` tells such an ending from others.

    Example:
        >>> import gymnasium as gym, anyskill_envs
        >>> from anyskill_envs.early_termination import EarlyTermination
        >>> env = EarlyTermination(gym.make("HumanoidText-v0", text="squat down"))  # doctest: +SKIP

    Args:
        env: an environment with the similarity in its `info`.
        rule: "successive" (the paper's text), "cumulative" (its algorithm 1), or "off".
        patience: falls of the similarity after which an episode may be given up.
        probability: probability that it then is.

    Raises:
        ValueError: an argument out of its range.
    """

    def __init__(
        self, env: gym.Env[Any, Any], rule: Rule = "successive", patience: int = 8, probability: float = 0.8
    ) -> None:
        RecordConstructorArgs.__init__(self, rule=rule, patience=patience, probability=probability)
        gym.Wrapper.__init__(self, env)
        self._counter = DecreaseCounter(1, rule, patience, probability)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start a new episode."""
        self._counter.seed(seed)
        self._counter.start(0)
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | {"early_termination": False}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step of the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        early = bool(self._counter.given_up(info)[0]) and not (terminated or truncated)
        return observation, reward, terminated or early, truncated, info | {"early_termination": early}


class VectorEarlyTermination(VectorWrapper[Any, Any, Any, Any, NDArray[Any]]):
    """Terminates episodes of a vector environment; the batched :class:`EarlyTermination`.

    The episodes that it ends are reset as the environment's autoreset mode says, through the reset option `reset_mask`.
    In "NextStep" mode the wrapped environment takes one more step with them, which nobody sees.

    Args:
        env: a vector environment with the similarity in its `info` and observations that are arrays.
        rule: "successive" (the paper's text), "cumulative" (its algorithm 1), or "off".
        patience: falls of the similarity after which an episode may be given up.
        probability: probability that it then is.

    Raises:
        ValueError: an argument out of its range.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, NDArray[Any]],
        rule: Rule = "successive",
        patience: int = 8,
        probability: float = 0.8,
    ) -> None:
        super().__init__(env)
        self._counter = DecreaseCounter(env.num_envs, rule, patience, probability)
        self._mode = env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        self._resetting = np.zeros(env.num_envs, bool)
        self._given_up = np.zeros(env.num_envs, bool)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start new episodes."""
        mask = np.array((options or {}).get("reset_mask", np.ones(self.num_envs, bool)))
        observations, infos = self.env.reset(seed=seed, options=options)
        self._counter.seed(seed)
        self._counter.start(mask)
        self._resetting[mask] = self._given_up[mask] = False
        return observations, self._told(infos, np.zeros(self.num_envs, bool))

    def step(self, actions: Any) -> tuple[Any, NDArray[Any], BoolArray, BoolArray, dict[str, Any]]:
        """Take a step of each environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if self._given_up.any():  # only in "NextStep" mode: this is the step in which they are reset
            mask = self._given_up
            observations, infos = self._reset_now(infos, mask)
            rewards = np.where(mask, 0.0, rewards)
            terminated, truncated = terminated & ~mask, truncated & ~mask
        early = self._counter.given_up(infos) & ~(terminated | truncated | self._resetting)
        terminated = terminated | early
        done = terminated | truncated
        infos = self._told(infos, early)
        if self._mode == AutoresetMode.SAME_STEP:
            if early.any():
                infos = _with_finals(infos, observations, early)
                observations, infos = self._reset_now(infos, early)
            self._counter.start(done)
        else:
            self._counter.start(self._resetting)
        if self._mode == AutoresetMode.NEXT_STEP:
            self._resetting, self._given_up = done, early
        return observations, rewards, terminated, truncated, infos

    def _reset_now(self, infos: dict[str, Any], mask: BoolArray) -> tuple[Any, dict[str, Any]]:
        """Reset some environments; returns all observations, and `infos` with the rows of these replaced."""
        observations, fresh = self.env.reset(options={"reset_mask": mask.copy()})
        return observations, _with_rows(infos, self._told(fresh, np.zeros(self.num_envs, bool)), mask)

    def _told(self, infos: dict[str, Any], early: BoolArray) -> dict[str, Any]:
        return infos | {"early_termination": early.copy(), "_early_termination": np.ones(self.num_envs, bool)}


def _with_rows(infos: dict[str, Any], others: dict[str, Any], mask: BoolArray) -> dict[str, Any]:
    """Vector info with the rows of `mask` taken from others; a key that is missing there loses these rows."""
    merged = {}
    for key, value in infos.items():
        other = others.get(key)
        if key in ("final_obs", "_final_obs", "final_info", "_final_info"):
            merged[key] = value
        elif isinstance(value, dict):
            merged[key] = _with_rows(value, other or {}, mask)
        else:
            merged[key] = np.array(value)
            if other is not None:
                merged[key][mask] = other[mask]
            elif key.startswith("_"):
                merged[key][mask] = False
    return merged


def _with_finals(infos: dict[str, Any], observations: NDArray[Any], early: BoolArray) -> dict[str, Any]:
    """Vector info of "SameStep" mode with the last observation and info of more episodes."""
    nobody = np.zeros(len(early), bool)
    last = infos.get("final_obs", np.full(len(early), None, dtype=object)).copy()
    for index in np.flatnonzero(early):
        last[index] = np.array(observations[index])
    present = {key: value for key, value in infos.items() if not key.removeprefix("_").startswith("final_")}
    ended = infos.get("_final_obs", nobody) | early
    final = _with_rows(_without_rows(present) | infos.get("final_info", {}), present, early)
    final["_early_termination"] = ended.copy()
    return infos | {"final_obs": last, "_final_obs": ended, "final_info": final, "_final_info": ended.copy()}


def _without_rows(infos: dict[str, Any]) -> dict[str, Any]:
    """Vector info with the keys of another and no rows."""
    return {
        key: _without_rows(value) if isinstance(value, dict) else np.zeros_like(value) for key, value in infos.items()
    }
