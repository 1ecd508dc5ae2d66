"""What a reward is: a pure function of a batch, with every term by name, found by name in a registry."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]

# What a reward may ask for, and the field of the batch that answers.
NEED_FIELDS = {
    "state": "observation",
    "frames": "frames",
    "text": "text_feature",
    "latent": "latent",
    "style_latent": "style_latent",
    "previous_similarity": "previous_similarity",
}


@dataclass(frozen=True)
class RewardBatch:
    """Everything a reward may look at, for n humanoids at one controller step.

    Rows are independent, so several controller steps can be stacked into one batch and the result averaged outside, as
    AnySkill does over the five controller steps of a decision. Fields that no reward needs stay None.

    Attributes:
        observation: proprioception at the controller step, shape (n, 223).
        frames: rendered pictures, uint8 (n, height, width, 3), or short films (n, k, height, width, 3).
        text_feature: unit feature of the wanted text, shape (n, d), or (d,) if it is the same for all.
        image_feature: unit feature of the picture or of the state, shape (n, d). If it is given, rewards use it as it is;
            otherwise they compute it with their encoder. Stored rollouts keep it, so that rewards can be recomputed.
        latent: unit latent that drives the controller, shape (n, 64).
        style_latent: a latent of the motion library to stay near to, shape (n, 64).
        previous_similarity: text similarity at the controller step before, shape (n,).
    """

    observation: FloatArray | None = None
    frames: NDArray[np.uint8] | None = None
    text_feature: FloatArray | None = None
    image_feature: FloatArray | None = None
    latent: FloatArray | None = None
    style_latent: FloatArray | None = None
    previous_similarity: FloatArray | None = None

    def __len__(self) -> int:
        """Number of humanoids n."""
        for item in fields(self):
            value = getattr(self, item.name)
            if value is not None and not (item.name == "text_feature" and value.ndim == 1):
                return len(value)
        raise ValueError("The reward batch is empty: give at least an observation or frames.")

    def require(self, needs: frozenset[str]) -> None:
        """Check that every need is supplied and that the lengths agree.

        Raises:
            ValueError: a needed field is None, or two fields disagree about n.
        """
        missing = []
        for need in sorted(needs):
            name = NEED_FIELDS[need]
            replaced = need in ("state", "frames") and self.image_feature is not None
            if getattr(self, name) is None and not replaced:
                missing.append(name)
        if missing:
            raise ValueError(
                f"The reward needs {', '.join(missing)} in its RewardBatch, but the batch does not carry it."
            )
        count = len(self)
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None or (item.name == "text_feature" and value.ndim == 1):
                continue
            if len(value) != count:
                raise ValueError(f"RewardBatch.{item.name} has {len(value)} rows where the others have {count}.")


@dataclass(frozen=True)
class RewardOutput:
    """A reward and where it comes from.

    Attributes:
        total: the reward, shape (n,), float32.
        terms: every term by name, shape (n,) each; they add up to `total`.
        similarity: cosine of text and picture or state, shape (n,), if the reward is about a text.
    """

    total: FloatArray
    terms: dict[str, FloatArray] = field(default_factory=dict)
    similarity: FloatArray | None = None

    @classmethod
    def from_terms(cls, terms: dict[str, Any], similarity: FloatArray | None = None) -> RewardOutput:
        """Add the terms up; every value has shape (n,)."""
        arrays = {name: np.asarray(value, dtype=np.float32) for name, value in terms.items()}
        total: FloatArray = np.stack(list(arrays.values())).sum(axis=0, dtype=np.float32)
        return cls(total=total, terms=arrays, similarity=similarity)


@runtime_checkable
class RewardFn(Protocol):
    """A pure batched reward.

    `needs` is a subset of {"state", "frames", "text", "latent", "style_latent", "previous_similarity"}; whoever calls the
    reward supplies those fields and renders only if "frames" is among them.
    """

    needs: frozenset[str]

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward a batch of n humanoids."""
        ...

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts, to be given back in `RewardBatch.text_feature`."""
        ...


# Heavy modules are named, not imported: `import rewards` must not load onnxruntime.
_REWARDS: dict[str, str | Callable[..., RewardFn]] = {"clip": "rewards.clip:ClipReward"}


def resolve(target: str | Callable[..., Any]) -> Callable[..., Any]:
    """Turn "package.module:Name" into the object it names; a callable stays what it is."""
    if not isinstance(target, str):
        return target
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def reward_names() -> list[str]:
    """Names that `make_reward` knows, sorted."""
    return sorted(_REWARDS)


def register_reward(name: str, target: str | Callable[..., RewardFn]) -> None:
    """Make a reward known by name.

    Args:
        name: the name for `make_reward` and `gym.make(..., reward=name)`.
        target: a callable that builds the reward, or "package.module:Name" of one.

    Raises:
        ValueError: the name is taken.
    """
    if name in _REWARDS:
        raise ValueError(f"A reward named {name!r} exists already; choose another name.")
    _REWARDS[name] = target


def make_reward(name: str, **kwargs: Any) -> RewardFn:
    """Build a reward by name.

    Args:
        name: one of `reward_names()`.
        **kwargs: arguments of the reward's constructor, for instance `encoder` or weights.

    Raises:
        ValueError: no reward has this name; the message lists those that exist.
    """
    if name not in _REWARDS:
        raise ValueError(f"Unknown reward {name!r}; the rewards that exist are: {', '.join(reward_names())}.")
    reward: RewardFn = resolve(_REWARDS[name])(**kwargs)
    return reward
