"""Train a text skill with Stable-Baselines3's PPO; `anyskill train` adds a warm start, a report and a video.

python examples/train_with_sb3.py --text "raise both arms above the head" --decisions 100000
"""

import argparse
from pathlib import Path

from stable_baselines3 import PPO

from agents.sb3 import make_sb3_env

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--text", default="raise both arms above the head")
parser.add_argument("--humanoids", type=int, default=128)
parser.add_argument("--decisions", type=int, default=100_000, help="of all humanoids together, six a second each")
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--output", type=Path, default=Path("policy.zip"))
arguments = parser.parse_args()

env = make_sb3_env("HumanoidText-v0", arguments.humanoids, seed=arguments.seed, text=arguments.text)
model = PPO(
    "MlpPolicy",
    env,
    n_steps=16,
    batch_size=4 * arguments.humanoids,
    gamma=0.95,
    policy_kwargs={"log_std_init": -2.3, "net_arch": [256, 128]},  # a latent has unit length: small noise
    seed=arguments.seed,
    device="cpu",  # small networks learn fastest there
    verbose=1,
)
model.learn(arguments.decisions)
model.save(arguments.output)
env.close()
print(f"The policy is in {arguments.output}.")
