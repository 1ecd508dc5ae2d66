"""Text rewards as pure batched functions, and the encoders they compare text and motion with.

`make_reward("clip")` builds a reward by name, `load_encoder("bundled")` an encoder. Importing this package loads neither
torch nor onnxruntime: an encoder reads its weights when it is first used.
"""

from rewards.base import RewardBatch, RewardFn, RewardOutput, make_reward, register_reward, reward_names
from rewards.encoders import Encoder, encoder_names, load_encoder, register_encoder

__all__ = [
    "Encoder",
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
