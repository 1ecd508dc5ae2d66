"""Fits a state projection to the image features of an encoder: states and pictures by rolling out the frozen controller."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from agents.encoder.networks import StateTower
from agents.encoder.rollouts import controller_tracks
from anyskill_envs.controller import LowLevelController
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_states, object_vectors
from anyskill_envs.rendering import Camera, HumanoidRenderer
from anyskill_envs.simulation import HumanoidSimulation
from rewards.encoders import Encoder
from rewards.projection import state_inputs

log = logging.getLogger(__name__)

_FRAMES = 120
_STRIDE = 8
"""Every eighth frame of a rollout of 4 s is a state: neighbours are too much alike to be worth a picture each."""
_BATCH = 128
_CHUNK = 64


@dataclass(frozen=True)
class States:
    """n states of rollouts.

    Attributes:
        poses: poses of the scenes, `(n, pose_size)`.
        inputs: inputs of the state tower side by side, `(n, 223 + m)`: the observation, then the objects.
        rollouts: which rollout a state is from, `(n,)`.
        object_sizes: numbers of the state of each object.
    """

    poses: NDArray[np.float64]
    inputs: NDArray[np.float32]
    rollouts: NDArray[np.int64]
    object_sizes: dict[str, int]


def collect_states(count: int, scene: Scene, controller: LowLevelController, rng: np.random.Generator) -> States:
    """States that the controller comes through with random latents of its library, standing, moving, falling and lying.

    Args:
        count: about how many.
        scene: objects beside the humanoid.
        controller: the frozen controller.
        rng: all randomness.
    """
    per_rollout = _FRAMES // _STRIDE
    rollouts = max(4, -(-count // per_rollout))
    sizes = {name: part.state_size for name, part in scene.parts.items()}
    poses, inputs, rows = [], [], []
    for start in range(0, rollouts, _CHUNK):
        size = min(_CHUNK, rollouts - start)
        tracks = controller_tracks(rng, size, _FRAMES, controller, scene=scene, pushed=True)
        simulation = HumanoidSimulation(size, num_threads=1, scene=scene)
        for frame in range(rng.integers(_STRIDE), _FRAMES, _STRIDE):
            simulation.reset(np.arange(size), tracks[0][frame], tracks[1][frame])
            states = object_states(scene, object_vectors(simulation))
            objects = {name: state.vector for name, state in states.items()}
            blocks = state_inputs(sizes, simulation.observation(), objects)
            poses.append(tracks[0][frame])
            rows.append(start + np.arange(size))
            inputs.append(np.concatenate(list(blocks.values()), axis=1))
    return States(np.concatenate(poses), np.concatenate(inputs), np.concatenate(rows), sizes)


def image_features(
    encoder: Encoder, poses: NDArray[np.float64], scene: Scene, camera: Camera, cache: Path | None = None
) -> NDArray[np.float32]:
    """Features `(n, d)` of pictures of poses, as an environment draws them.

    Args:
        encoder: the encoder.
        poses: poses of the scene, `(n, pose_size)`.
        scene: objects beside the humanoid.
        camera: where the camera stands.
        cache: a file that keeps the features; what it holds already is not drawn again.
    """
    shape = (len(poses), encoder.feature_size)
    done = 0
    features: NDArray[np.float32] = np.empty(shape, np.float32)
    if cache is not None:
        cache.parent.mkdir(parents=True, exist_ok=True)
        count = cache.with_suffix(".count")
        resume = cache.is_file() and count.is_file() and np.load(cache, mmap_mode="r").shape == shape
        done = int(count.read_text()) if resume else 0
        features = np.lib.format.open_memmap(cache, "r+" if resume else "w+", dtype=np.float32, shape=shape)
    renderer = HumanoidRenderer(scene=scene)
    try:
        starts = range(done, len(poses), _CHUNK)
        for start in tqdm(starts, desc="drawing and encoding pictures", unit=f"x{_CHUNK}"):
            chunk = poses[start : start + _CHUNK]
            features[start : start + len(chunk)] = encoder.encode_image(
                np.stack([renderer.render(pose, camera) for pose in chunk])
            )
            if cache is not None:
                count.write_text(str(start + len(chunk)))
    finally:
        renderer.close()
    return features


@dataclass(frozen=True)
class Fit:
    """A fitted projection and how well it does on rollouts that it was not fitted to.

    Attributes:
        tower: the network.
        cosine: mean cosine of projection and image feature.
        worst: the cosine that one in a hundred states falls short of.
        constant: mean cosine of the image feature with the mean feature: what a projection that knows nothing reaches.
        explained: share of the variance of the image features that the projection explains.
    """

    tower: StateTower
    cosine: float
    worst: float
    constant: float
    explained: float


def fit_projection(
    states: States,
    features: NDArray[np.float32],
    steps: int,
    rng: np.random.Generator,
    held_out: float = 0.15,
    hidden: int = 512,
) -> Fit:
    """Fits a state tower to image features.

    The loss is the share of the features' variance that stays unexplained. Features of a real CLIP lie close together:
    their mean alone has a high cosine with each (`anyskill encoder project` prints it), and what tells poses apart is in
    the rest.

    Args:
        states: the states.
        features: unit features of their pictures, `(n, d)`.
        steps: steps of gradient descent.
        rng: draws batches and the held-out rollouts.
        held_out: share of the rollouts that are kept for measuring.
        hidden: width of the hidden layers.
    """
    kinds = rng.permutation(np.unique(states.rollouts))
    kept = np.isin(states.rollouts, kinds[: max(1, round(held_out * len(kinds)))])
    inputs, wanted = states.inputs[~kept], features[~kept]
    mean, scale = inputs.mean(0), np.maximum(inputs.std(0), 0.02)
    torch.manual_seed(int(rng.integers(2**31)))
    tower = StateTower(mean, scale, features.shape[1], hidden)
    centre = wanted.mean(0)
    variance = float(((wanted - centre) ** 2).sum(1).mean()) + 1e-9
    last = tower.layers[-1]
    assert isinstance(last, torch.nn.Linear)
    with torch.no_grad():  # it begins as the mean feature
        last.weight.mul_(variance**0.5)
        last.bias.copy_(torch.from_numpy(centre))
    optimiser = torch.optim.AdamW(tower.parameters(), lr=1e-3, weight_decay=1e-4)
    tower.train()
    progress = tqdm(range(steps), desc="fitting the projection")
    for step in progress:
        for group in optimiser.param_groups:
            group["lr"] = 1e-3 * min(1.0, (step + 1) / 100) * (0.5 + 0.5 * np.cos(np.pi * step / steps)) + 1e-6
        chosen = rng.integers(len(inputs), size=_BATCH)
        found = tower(torch.from_numpy(inputs[chosen]))
        loss = (found - torch.from_numpy(wanted[chosen])).pow(2).sum(1).mean() / variance
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(tower.parameters(), 1.0)
        optimiser.step()
        if step % 50 == 0:
            progress.set_postfix(unexplained=f"{loss.item():.3f}")
    tower.eval()
    with torch.no_grad():
        found = tower(torch.from_numpy(states.inputs[kept])).numpy()
    return _measured(tower, found, features[kept], centre)


def _measured(
    tower: StateTower, found: NDArray[np.float32], features: NDArray[np.float32], centre: NDArray[np.float32]
) -> Fit:
    cosines = (found * features).sum(1)
    spread = ((features - features.mean(0)) ** 2).sum()
    return Fit(
        tower,
        float(cosines.mean()),
        float(np.quantile(cosines, 0.01)),
        float((features @ (centre / np.linalg.norm(centre))).mean()),
        float(1.0 - ((features - found) ** 2).sum() / max(float(spread), 1e-9)),
    )


def measure_speed(
    encoder: Encoder,
    poses: NDArray[np.float64],
    observations: NDArray[np.float32],
    scene: Scene,
    camera: Camera,
    pictures: int = 32,
) -> tuple[float, float]:
    """Seconds per state of drawing and encoding a picture, and of the encoder's projection, one after the other.

    Both are batched as rewards batch them: one call for 64 humanoids of the projection, one for all pictures.

    Args:
        encoder: an encoder with a state projection.
        poses: poses to draw, `(n, pose_size)`.
        observations: observations to project, `(k, 223)`.
        scene: objects beside the humanoid.
        camera: where the camera stands.
        pictures: how many pictures are drawn.
    """
    poses = poses[:pictures]
    renderer = HumanoidRenderer(scene=scene)
    try:
        encoder.encode_image(np.stack([renderer.render(poses[0], camera)]))  # the first picture builds the GL context
        start = time.perf_counter()
        encoder.encode_image(np.stack([renderer.render(pose, camera) for pose in poses]))
        drawn = (time.perf_counter() - start) / len(poses)
    finally:
        renderer.close()
    observations = observations[np.resize(np.arange(len(observations)), 64)]
    encoder.encode_state(observations)
    repeats = 50
    start = time.perf_counter()
    for _ in range(repeats):
        encoder.encode_state(observations)
    return drawn, (time.perf_counter() - start) / (repeats * len(observations))
