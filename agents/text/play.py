"""`anyskill play`: watch a trained skill in a window, or write a video of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from agents.text.config import TrainConfig
from agents.training.run_folder import RunFolder
from anyskill_envs.rendering import VideoLook
from motion_data.files import write_whole

if TYPE_CHECKING:
    from agents.text.export import OnnxPolicy


def play(
    run: Annotated[Path, tyro.conf.Positional],
    video: Path | None = None,
    episodes: int = 1,
    seed: int = 0,
    look: VideoLook = "simulation",
) -> int:
    """Watch a trained skill in a window, or write a video of it.

    Needs neither torch nor Stable-Baselines3: it plays policy.onnx.

    Args:
        run: The run folder.
        video: Write this .mp4 file instead of opening a window.
        episodes: How many episodes of 10 s, one after the other.
        seed: Seed of the start states.
        look: What a video shows: the shapes of the simulation, a mannequin, or both beside each other; the mannequin needs
            `pip install "anyskill-envs[mesh]"`.

    Returns:
        0.

    Raises:
        FileNotFoundError: There is no finished run.
        ValueError: The video's name does not end in .mp4, episodes is not positive, or another look without a video.
        RenderingError: This machine has no screen, or cannot draw.
    """
    from agents.text.evaluate import scene_of
    from agents.text.export import OnnxPolicy
    from agents.text.train import environment_id
    from anyskill_envs.objects.state import observation_bounds
    from anyskill_envs.observation import OBSERVATION_SIZE

    folder = RunFolder.existing(run)
    if video is not None and video.suffix.lower() != ".mp4":
        raise ValueError(f"The video must be an .mp4 file, got '{video}'.")
    if video is None and look != "simulation":
        raise ValueError(f"A window shows the simulation; give --video FILE.mp4 for --look {look}.")
    if episodes < 1:
        raise ValueError(f"episodes must be 1 or more, got {episodes}.")
    config = TrainConfig.from_json(json.loads(folder.config.read_text(encoding="utf-8")))
    scene = scene_of(environment_id(config))
    observed = 0 if config.blind or not scene else len(observation_bounds(scene))
    policy = OnnxPolicy(folder.onnx, OBSERVATION_SIZE + observed)
    if video is None:
        _show(config, policy, episodes, seed)
        return 0
    import numpy as np

    from agents.text.clock import ClockedPolicy
    from agents.text.evaluate import run_episodes
    from agents.text.train import environment_options
    from agents.text.video import write_video

    options = environment_options(config)
    recorded = run_episodes(ClockedPolicy(policy), config.text, episodes, seed, environment_id(config), **options)
    qpos = np.concatenate([episode.qpos for episode in recorded])
    video.parent.mkdir(parents=True, exist_ok=True)
    write_whole(video, lambda path: write_video(path, qpos, [config.text], scene, look=look))
    print(f"Wrote {video}: {len(recorded)} episode(s) of {config.text!r}.")
    return 0


def _show(config: TrainConfig, policy: OnnxPolicy, episodes: int, seed: int) -> None:
    import gymnasium as gym

    from agents.text.clock import ClockedPolicy
    from agents.text.train import environment_id, environment_options

    env = gym.make(environment_id(config), text=config.text, render_mode="human", **environment_options(config))
    for episode in range(episodes):
        observation, _ = env.reset(seed=seed + episode)
        act = ClockedPolicy(policy)
        ended = False
        while not ended:
            observation, _, terminated, truncated, _ = env.step(act(observation[None])[0])
            ended = terminated or truncated
    env.close()
