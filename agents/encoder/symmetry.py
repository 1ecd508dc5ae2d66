"""Makes one symmetric state tower of the trained one and its look into the mirror."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional
from tqdm import tqdm

from agents.encoder.config import EncoderConfig
from agents.encoder.dataset import MotionSet
from agents.encoder.networks import MirroredStateTower, StateTower, SymmetricStateTower
from agents.encoder.scenes import ObjectLayout
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_SIZE
from motion_data.files import write_whole

_BATCH = 1024
_RATE = 2e-3


def mirrored_tower(state: StateTower, layout: ObjectLayout) -> MirroredStateTower:
    """The tower that looks at states and at their mirror images."""
    index = np.concatenate([MIRROR_INDEX, OBSERVATION_SIZE + np.arange(layout.size)])
    sign = np.concatenate([MIRROR_SIGN, layout.mirror_sign])
    return MirroredStateTower(state, index, sign, [OBSERVATION_SIZE + column for column in layout.sided]).eval()


def symmetric_tower(
    config: EncoderConfig, state: StateTower, motions: MotionSet, layout: ObjectLayout, checkpoint: Path
) -> SymmetricStateTower:
    """A symmetric tower that has learned what the trained tower says of motions and of their mirror images.

    Two looks cost twice as much in every step of every environment; the student costs no more than one.

    Args:
        config: settings.
        state: the trained tower.
        motions: what to learn on.
        layout: the objects that the towers are told about.
        checkpoint: where the student is kept when it is done.
    """
    torch.manual_seed(config.seed)
    teacher = mirrored_tower(state, layout)
    student = SymmetricStateTower(teacher, config.feature_size, config.symmetric_hidden)
    if checkpoint.is_file():
        student.load_state_dict(torch.load(checkpoint, weights_only=True))
        return student.eval()
    optimiser = torch.optim.AdamW(student.parameters(), lr=_RATE, weight_decay=1e-4)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=config.symmetry_steps, pct_start=0.05)
    rng = np.random.default_rng(config.seed + 6)
    progress = tqdm(range(config.symmetry_steps), desc="symmetric tower")
    for step in progress:
        rows = np.sort(rng.integers(len(motions), size=min(_BATCH, len(motions))))
        inputs = torch.from_numpy(motions.observations[rows]), torch.from_numpy(motions.objects[rows])
        with torch.autocast("cpu", dtype=torch.bfloat16):
            with torch.no_grad():
                wanted = teacher(*inputs)
            found = student(*inputs)
        loss = 1.0 - functional.cosine_similarity(found, wanted.float()).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        rate.step()
        if step % 50 == 0:
            progress.set_postfix(cosine=f"{1.0 - loss.item():.4f}")
    write_whole(checkpoint, partial(torch.save, student.state_dict()))
    return student.eval()
