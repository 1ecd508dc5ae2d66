"""What a reward is: a pure function of a batch, with every term by name, found by name in a registry."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rewards.object_state import ObjectState

FloatArray = NDArray[np.float32]

# What a reward may ask for, and the field of the batch that answers.
NEED_FIELDS = {
    "state": "observation",
    "frames": "frames",
    "text": "text_feature",
    "latent": "latent",
    "style_latent": "style_latent",
    "library_latents": "library_latents",
    "velocity": "velocity",
    "facing": "facing",
    "objects": "objects",
    "object_angle": "objects",  # of an object with joints
    "past_features": "past_features",
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
        library_latents: the latents of the motion library that all rows share, shape (k, 64).
        velocity: horizontal velocity of the body in the world, m/s, shape (n, 2).
        facing: horizontal unit vector in which the body faces in the world, shape (n, 2).
        objects: states of the objects beside the humanoids, by name, in the order of the scene.
        past_features: unit image features of the w steps before this one, oldest first, shape (n, w, d). At the start of
            an episode they are those of the state in which it starts. :class:`rewards.episodic.EpisodicReward` keeps them.
    """

    observation: FloatArray | None = None
    frames: NDArray[np.uint8] | None = None
    text_feature: FloatArray | None = None
    image_feature: FloatArray | None = None
    latent: FloatArray | None = None
    style_latent: FloatArray | None = None
    library_latents: FloatArray | None = None
    velocity: FloatArray | None = None
    facing: FloatArray | None = None
    objects: Mapping[str, ObjectState] | None = None
    past_features: FloatArray | None = None

    def __len__(self) -> int:
        """Number of humanoids n."""
        for _, value in self._fields_with_rows():
            return len(value)
        raise ValueError("The reward batch is empty: give at least an observation or frames.")

    def _fields_with_rows(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Name and value of each field that is there and has a row for every humanoid."""
        for item in fields(self):
            value = getattr(self, item.name)
            shared = item.name == "library_latents" or (item.name == "text_feature" and np.ndim(value) == 1)
            if isinstance(value, Mapping):
                yield from ((f"{item.name}[{name!r}]", state.position) for name, state in value.items())
            elif value is not None and not shared:
                yield item.name, value

    def require(self, needs: frozenset[str]) -> None:
        """Check that every need is supplied and that the lengths agree.

        Raises:
            ValueError: a needed field is None, or two fields disagree about n.
        """
        missing = []
        for need in sorted(needs):
            name = NEED_FIELDS[need]
            replaced = need in ("state", "frames") and self.image_feature is not None
            if getattr(self, name) is None and not replaced and name not in missing:
                missing.append(name)
        if missing:
            raise ValueError(
                f"The reward needs {', '.join(missing)} in its RewardBatch, but the batch does not carry it."
            )
        count = len(self)
        for name, value in self._fields_with_rows():
            if len(value) != count:
                raise ValueError(f"RewardBatch.{name} has {len(value)} rows where the others have {count}.")


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

    `needs` holds keys of `NEED_FIELDS`; whoever calls the reward supplies those fields of the batch and renders only if
    "frames" is among them.
    """

    needs: frozenset[str]

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward a batch of n humanoids."""
        ...

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts, to be given back in `RewardBatch.text_feature`."""
        ...


@runtime_checkable
class HistoryRewardFn(RewardFn, Protocol):
    """A reward that also looks back.

    `history` is the number of earlier steps whose features it needs, in `RewardBatch.past_features`; 0 for none.
    """

    history: int

    def image_feature(self, batch: RewardBatch) -> FloatArray:
        """Unit features (n, d) of what the batch shows, to be kept for the steps that follow."""
        ...


class TextFreeReward:
    """Base of rewards that read no text: features of texts are empty."""

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Nothing, (k, 0)."""
        return np.zeros((len(texts), 0), np.float32)


# Heavy modules are named, not imported: `import rewards` must not load onnxruntime.
_REWARDS: dict[str, str | Callable[..., RewardFn]] = {
    "approach": "rewards.object_tasks:ApproachReward",
    "avgpool": "rewards.avgpool:AvgPoolReward",
    "clip": "rewards.clip:ClipReward",
    "clip-s": "rewards.clip_s:ClipScoreReward",
    "delta": "rewards.delta:DeltaReward",
    "open": "rewards.object_tasks:OpenReward",
    "sit": "rewards.object_tasks:SitReward",
    "strike": "rewards.object_tasks:StrikeReward",
    "style": "rewards.style:StyleReward",
    "velocity": "rewards.velocity:VelocityReward",
    "vlm-rm": "rewards.vlm_rm:VlmRmReward",
}


def resolve(target: str | Callable[..., Any]) -> Callable[..., Any]:
    """Turn "package.module:Name" into the object it names; a callable stays what it is."""
    if not isinstance(target, str):
        return target
    module, _, name = target.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def reward_names() -> list[str]:
    """Names that `make_reward` knows, sorted."""
    return sorted(_REWARDS)


def register_reward(name: str, target: str | Callable[..., RewardFn]) -> None:
    """Make a reward known by name.

    Args:
        name: the name for `make_reward` and `gym.make(..., reward=name)`.
        target: a callable that builds the reward, or "package.module:Name" of one. If it has an argument `encoder`, it
            gets the encoder that the user chose.

    Raises:
        ValueError: the name is taken.
    """
    if name in _REWARDS:
        raise ValueError(f"A reward named {name!r} exists already; choose another name.")
    _REWARDS[name] = target


def make_reward(
    reward: str | Mapping[str, float] | RewardFn, *, encoder: Any = None, num_threads: int | None = None, **kwargs: Any
) -> RewardFn:
    """Build a reward.

    Args:
        reward: one of `reward_names()`; or weights by name, such as ``{"clip": 0.8, "velocity": 0.2}``, for the weighted
            sum of several, which can also be spelled ``"0.8*clip+0.2*velocity"``; or a reward that is made already.
        encoder: the encoder or its name, for rewards that have one; each reward's default if None.
        num_threads: threads of an encoder that is given by name; see `rewards.load_encoder`.
        **kwargs: further arguments of the reward's constructor; for a sum the arguments of each part, by its name, as in
            ``velocity={"speed": 1.0}``, and `source` for all.

    Raises:
        ValueError: no reward has this name; the message lists those that exist.
        TypeError: an argument that the reward does not have.
    """
    if isinstance(reward, str) and reward not in _REWARDS and set(reward) & set("+*"):
        from rewards.weighted_sum import parse_weights

        reward = parse_weights(reward)
    if isinstance(encoder, str) and num_threads is not None and isinstance(reward, str | Mapping):
        names = [reward] if isinstance(reward, str) else list(reward)
        if any(name in _REWARDS and takes_argument(name, "encoder") for name in names):
            from rewards.encoders import load_encoder

            encoder = load_encoder(encoder, num_threads=num_threads)
    if isinstance(reward, Mapping):
        from rewards.weighted_sum import WeightedSum

        return WeightedSum(reward, encoder=encoder, **kwargs)
    if not isinstance(reward, str):
        if kwargs:
            raise TypeError(f"The reward is made already: {', '.join(kwargs)} must be given to its constructor.")
        return reward
    if reward not in _REWARDS:
        raise ValueError(f"Unknown reward {reward!r}; the rewards that exist are: {', '.join(reward_names())}.")
    if encoder is not None and takes_argument(reward, "encoder"):
        kwargs["encoder"] = encoder
    made: RewardFn = resolve(_REWARDS[reward])(**kwargs)
    return made


def takes_argument(name: str, argument: str) -> bool:
    """Whether the constructor of a registered reward has an argument of this name."""
    parameters = inspect.signature(resolve(_REWARDS[name])).parameters.values()
    return any(each.name == argument or each.kind == inspect.Parameter.VAR_KEYWORD for each in parameters)
