"""Trains an encoder: motions and captions, state and text towers, then the image tower, then export and measurement.

All stages keep their result in the run folder and are skipped when it is there, so that a stopped run goes on.
"""

from __future__ import annotations

import numpy as np
import torch

from agents.encoder.card import write_card
from agents.encoder.config import EncoderConfig
from agents.encoder.evaluation import evaluate
from agents.encoder.export import export_image_tower, export_towers
from agents.encoder.material import make_motions, motion_library, prepare_captions
from agents.encoder.pictures import picture_index, render_films, train_image_tower
from agents.encoder.scenes import ObjectLayout
from agents.encoder.symmetry import symmetric_tower
from agents.encoder.towers import train_towers
from rewards.bundled import BundledEncoder

HELD_OUT_PICTURES = 1000
"""Films that the image tower is measured on."""
HELD_OUT_TRACKS = 48
"""Tracks per source that both towers are measured on."""


def train(config: EncoderConfig) -> int:
    """Train the bundled encoder, or the evaluator, and write its files and model card.

    A run that was stopped goes on from its last checkpoint.

    Args:
        config: settings.

    Returns:
        0.
    """
    config = config.settled
    torch.set_num_threads(config.threads)
    out = config.folder
    config.run.mkdir(parents=True, exist_ok=True)
    clips, layout = motion_library(), ObjectLayout(config.objects)
    captions = prepare_captions(config, clips)
    motions = make_motions(config, clips, captions.concepts, layout)
    towers = train_towers(config, motions, captions, layout, config.run / "tokens.npz")
    state = symmetric_tower(config, towers.state, motions, layout, config.run / "symmetric.pt")
    told = f"{len(captions.training)} captions by rules, {config.lessons} lessons"
    trained_on = f"{len(motions)} short motions, {told}, seed {config.seed}"
    export_towers(out, state, towers.text, config.feature_size, trained_on, layout.sizes, config.caption_settings)
    rng = np.random.default_rng(config.seed + 4)
    drawn = motions.take(picture_index(motions, config.image_motions, rng))
    films = render_films(drawn, config.image_size, rng, config.run / "films.npy", config.cameras, layout)
    with torch.no_grad():
        features = state(torch.from_numpy(drawn.observations), torch.from_numpy(drawn.objects)).numpy()
    mirrored = np.roll(features, features.shape[1] // 2, axis=1)
    # The camera of scenes stands on one side.
    mirrored[drawn.scenes >= 0] = np.nan
    # The files are read back, so that what is measured is what a user gets.
    encoder = BundledEncoder(out, cache="")
    text_features = encoder.encode_text([concept.phrases[0] for concept in captions.concepts])
    image = train_image_tower(
        films,
        features,
        text_features,
        config.run / "image_tower.pt",
        config.image_epochs,
        config.image_batch,
        config.learning_rate,
        config.seed,
        config.image_width,
        mirrored,
    )
    export_image_tower(out, image, config.image_size, config.feature_size, f"{len(films)} films of 4 frames")
    report = evaluate(encoder, captions, HELD_OUT_PICTURES, HELD_OUT_TRACKS)
    write_card(out / "MODEL_CARD.md", config, report)
    print(report.table)
    return 0
