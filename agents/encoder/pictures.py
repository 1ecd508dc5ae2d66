"""Renders short motions as films, and trains the image tower to see in them what the state tower knows."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional
from tqdm import tqdm

from agents.encoder.dataset import FILM_FRAMES, MotionSet
from agents.encoder.networks import ImageTower
from agents.encoder.scenes import ObjectLayout
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import FRONT_CAMERA, SCENE_CAMERA, Camera, HumanoidRenderer
from motion_data.files import write_whole
from rewards.bundled import shrink

log = logging.getLogger(__name__)

# The environments draw 224 pixels; the smaller size keeps the tower from relying on one way of shrinking.
_RENDERED_SIZES = (224, 224, 128)


@dataclass(frozen=True)
class CameraRange:
    """Where the cameras stand that an image tower is trained with.

    Attributes:
        front: share of films from AnySkill's camera itself.
        angle: most that a camera stands aside of the front, radians.
        distance: shortest and longest distance, metres.
        height: lowest and highest camera, metres.
    """

    front: float = 1 / 3
    angle: float = 0.44
    distance: tuple[float, float] = (2.5, 3.6)
    height: tuple[float, float] = (0.7, 1.5)

    def draw(self, rng: np.random.Generator) -> Camera:
        """A camera from this range."""
        if rng.random() < self.front:
            return FRONT_CAMERA
        angle, distance = rng.uniform(-self.angle, self.angle), rng.uniform(*self.distance)
        height = float(rng.uniform(*self.height))
        return Camera((float(distance * np.cos(angle)), float(distance * np.sin(angle)), height))

    def of_scene(self, rng: np.random.Generator) -> Camera:
        """A camera for a scene with objects: near the one that stands beside humanoid and object."""
        across, along, height = SCENE_CAMERA.position
        position = (
            float(across + rng.normal(0, 0.3)),
            float(along * rng.uniform(0.9, 1.1)),
            float(height + rng.normal(0, 0.1)),
        )
        return replace(SCENE_CAMERA, position=position)


def render_films(
    motions: MotionSet,
    size: int,
    rng: np.random.Generator,
    cache: Path | None = None,
    cameras: CameraRange | None = None,
    layout: ObjectLayout | None = None,
) -> NDArray[np.uint8]:
    """Films of short motions, `(n, 4, size, size, 3)`.

    Args:
        motions: the motions.
        size: pixels per side.
        rng: draws cameras.
        cache: a file that keeps the films; what it holds already is not drawn again.
        cameras: where the cameras stand; always AnySkill's camera, or that of scenes, if None.
        layout: the objects that the motions' scenes hold.

    Returns:
        The films, a memory map if there is a cache.
    """
    shape = (len(motions), len(FILM_FRAMES), size, size, 3)
    done = 0
    films: NDArray[np.uint8]
    if cache is not None:
        count = cache.with_suffix(".count")
        resume = cache.is_file() and count.is_file() and np.load(cache, mmap_mode="r").shape == shape
        done = int(count.read_text()) if resume else 0
        films = np.lib.format.open_memmap(cache, "r+" if resume else "w+", dtype=np.uint8, shape=shape)
    else:
        films = np.empty(shape, np.uint8)
    renderers: dict[tuple[int, int], HumanoidRenderer] = {}
    scenes = [Scene()] if layout is None else [*layout.scenes.values(), Scene()]  # the last one is index -1
    try:
        for row in tqdm(range(done, len(motions)), desc="drawing films", initial=done, total=len(motions)):
            pixels = _RENDERED_SIZES[0 if cameras is None else rng.integers(3)]
            scene = scenes[motions.scenes[row]]
            key = (pixels, int(motions.scenes[row]))
            if key not in renderers:
                renderers[key] = HumanoidRenderer(pixels, pixels, scene=scene)
            if cameras is None:
                camera = SCENE_CAMERA if scene else FRONT_CAMERA
            else:
                camera = cameras.of_scene(rng) if scene else cameras.draw(rng)
            poses = motions.films[row, :, : scene.pose_size].astype(np.float64)
            film = np.stack([renderers[key].render(pose, camera) for pose in poses])
            films[row] = np.round(shrink(film[None], size)[0])
            if cache is not None and row % 200 == 199:
                count.write_text(str(row + 1))
    finally:
        for renderer in renderers.values():
            renderer.close()
    if cache is not None:
        count.write_text(str(len(motions)))
    return films


def picture_index(motions: MotionSet, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Which motions to draw: half uniform, half with every concept alike."""
    uniform = rng.choice(len(motions), size=min(count // 2, len(motions)), replace=False)
    fulfilling = [index for index in (np.flatnonzero(column > 0.6) for column in motions.truths.T) if len(index)]
    chosen = [rng.choice(fulfilling[place % len(fulfilling)]) for place in range(count - len(uniform))]
    return np.concatenate([uniform, np.array(chosen, dtype=np.int64)])


def mirror_images(films: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Films `(n, frames, size, size, 3)` in the mirror.

    Red and blue are exchanged, too: the right limbs are orange and the left ones blue, of nearly the same numbers in
    opposite order, so that in the mirror a right arm is orange again. The floor gets another tint.
    """
    return np.ascontiguousarray(films[:, :, :, ::-1, ::-1])


def train_image_tower(
    films: NDArray[np.uint8],
    features: NDArray[np.float32],
    text_features: NDArray[np.float32],
    checkpoint: Path,
    epochs: int,
    batch: int,
    learning_rate: float,
    seed: int,
    width: int = 24,
    mirrored: NDArray[np.float32] | None = None,
) -> ImageTower:
    """Trains the image tower towards the features of the state tower.

    The loss is one minus the cosine with the state's feature, plus the squared difference of the similarities to texts:
    what the features are used for.

    Args:
        films: `(n, 4, size, size, 3)`.
        features: unit features of their states, `(n, d)`.
        text_features: unit features of texts, `(k, d)`.
        checkpoint: file of the last state of the training.
        epochs: passes over the films.
        batch: films per step.
        learning_rate: highest learning rate.
        seed: seed of weights and order.
        width: channels of the first convolution.
        mirrored: features of the mirrored states, `(n, d)`, NaN where a film has no mirror image; half of the others are
            then seen in the mirror, see :func:`mirror_images`.

    Returns:
        The trained tower.
    """
    torch.manual_seed(seed)
    tower = ImageTower(features.shape[1], frames=films.shape[1], width=width, size=films.shape[2])
    optimiser = torch.optim.AdamW(tower.parameters(), lr=learning_rate, weight_decay=1e-3)
    steps_per_epoch = len(films) // batch
    total = epochs * steps_per_epoch
    first = 0
    if checkpoint.is_file():
        stored = torch.load(checkpoint, weights_only=True)
        tower.load_state_dict(stored["tower"])
        optimiser.load_state_dict(stored["optimiser"])
        first = int(stored["epoch"])
    texts = torch.from_numpy(text_features)
    progress = tqdm(total=total, initial=first * steps_per_epoch, desc="image tower")
    tower.train()
    started = time.monotonic()
    for epoch in range(first, epochs):
        order = np.random.default_rng([seed, epoch]).permutation(len(films))
        mirror_rng = np.random.default_rng([seed, epoch, 1])
        for place in range(steps_per_epoch):
            chosen = np.sort(order[place * batch : (place + 1) * batch])
            step = epoch * steps_per_epoch + place
            for group in optimiser.param_groups:
                rate = learning_rate * min(1.0, (step + 1) / 100) * 0.5 * (1.0 + np.cos(np.pi * step / total))
                group["lr"] = float(rate) + 1e-6
            drawn, goal = films[chosen], features[chosen]
            if mirrored is not None:
                turned = mirror_rng.random(batch) < 0.5
                turned &= ~np.isnan(mirrored[chosen, 0])
                drawn[turned] = mirror_images(drawn[turned])
                goal[turned] = mirrored[chosen[turned]]
            wanted = torch.from_numpy(goal)
            with torch.autocast("cpu", dtype=torch.bfloat16):
                found = tower(torch.from_numpy(drawn))
            cosine = functional.cosine_similarity(found, wanted)
            graded = ((found - wanted) @ texts.T).pow(2).mean()
            optimiser.zero_grad()
            ((1.0 - cosine).mean() + 10.0 * graded).backward()
            optimiser.step()
            progress.update()
            if place % 20 == 0:
                progress.set_postfix(cosine=f"{cosine.mean().item():.3f}")
        stored = {"tower": tower.state_dict(), "optimiser": optimiser.state_dict(), "epoch": epoch + 1}
        write_whole(checkpoint, partial(torch.save, stored))
    progress.close()
    log.info("image tower trained in %.0f s", time.monotonic() - started)
    return tower.eval()
