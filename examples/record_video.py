"""Write a video of named latents, with a picture for every controller step (30 a second).

python examples/record_video.py walk wave_right_hand --output latents.mp4
"""

import argparse
from pathlib import Path

import gymnasium as gym
import imageio.v2 as imageio

import anyskill_envs
from anyskill_envs.rendering import Camera, HumanoidRenderer

gym.register_envs(anyskill_envs)

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("latents", nargs="*", default=["idle", "walk"], help="names, played one after the other")
parser.add_argument("--decisions", type=int, default=18, help="of each latent, six a second")
parser.add_argument("--size", type=int, default=320, help="pixels")
parser.add_argument("--output", type=Path, default=Path("latents.mp4"))
arguments = parser.parse_args()

env = gym.make("HumanoidLatent-v0", record_controller_steps=True, max_episode_steps=10_000)
renderer = HumanoidRenderer(arguments.size, arguments.size, "video")
camera = Camera(position=(3.0, -1.0, 1.2), follow="position")
env.reset(seed=0)
with imageio.get_writer(arguments.output, fps=30) as video:
    for name in arguments.latents:
        for _ in range(arguments.decisions):
            *_, terminated, _, info = env.step(env.unwrapped.latents[name])
            for qpos in info["controller_qpos"][: info["controller_steps"]]:
                video.append_data(renderer.render(qpos, camera))
            if terminated:
                env.reset()
env.close()
print(f"The video is in {arguments.output}.")
