"""Play random latents of the motion library: what the low-level controller does without any high-level policy.

python examples/random_latents.py --steps 60
python examples/random_latents.py --window        # watch it; needs a screen
"""

import argparse

import gymnasium as gym

import anyskill_envs

gym.register_envs(anyskill_envs)

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--steps", type=int, default=60, help="decisions, six a second")
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--window", action="store_true", help="show the humanoid")
arguments = parser.parse_args()

env = gym.make("HumanoidLatent-v0", render_mode="human" if arguments.window else None)
observation, info = env.reset(seed=arguments.seed)
latents = env.unwrapped.latents
names = sorted(latents)

for step in range(arguments.steps):
    if step % 12 == 0:  # another motion every two seconds
        name = names[env.unwrapped.np_random.integers(len(names))]
    observation, reward, terminated, truncated, info = env.step(latents[name])
    if step % 12 == 11:
        print(f"{name:<32} head {info['head_height']:.2f} m, {info['distance_from_origin']:.2f} m from the origin")
    if terminated or truncated:
        print(f"{name:<32} the episode ends: {'fallen' if terminated else 'time is up'}")
        observation, info = env.reset()
env.close()
