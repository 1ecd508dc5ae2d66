"""Text rewards as pure batched functions, and the encoders they compare text and motion with.

`make_reward("clip")` builds a reward by name, `load_encoder("bundled")` an encoder, and `EpisodicReward` runs a reward
along episodes. Importing this package loads neither
torch nor onnxruntime: an encoder reads its weights when it is first used.
"""

from rewards.base import (
    HistoryRewardFn,
    RewardBatch,
    RewardFn,
    RewardOutput,
    make_reward,
    register_reward,
    reward_names,
)
from rewards.encoders import Encoder, encoder_names, load_encoder, register_encoder
from rewards.episodic import EpisodicReward

__all__ = [
    "Encoder",
    "EpisodicReward",
    "HistoryRewardFn",
    "RewardBatch",
    "RewardFn",
    "RewardOutput",
    "encoder_names",
    "load_encoder",
    "make_reward",
    "register_encoder",
    "register_reward",
    "reward_names",
]
