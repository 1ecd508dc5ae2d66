"""The command `anyskill controller calm`."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from agents.controller.calm.losses import TERMS, LossForm, Term


@dataclass(frozen=True)
class CalmTraining:
    """Trains a low-level controller by adversarial imitation, as CALM and AnySkill do."""

    clips: str
    """Names of motion clips, separated by commas; `anyskill motions list` shows them."""
    output: Path = Path("runs/calm")
    """Folder of checkpoint, curves and finished files; a run that was stopped goes on from there."""
    minutes: float = 60.0
    """Training time in minutes, over all sessions."""
    preset: Literal["laptop", "paper"] = "laptop"
    """`laptop` learns two to four clips on two cores; `paper` is Table A1 of AnySkill, made for a large GPU."""
    initial: Path | None = None
    """Weights (safetensors) of encoder and policy to begin with; `bundled` for those of the bundled controller."""
    num_humanoids: int | None = None
    """Humanoids simulated at once, if not the preset's number."""
    terms: tuple[Term, ...] = TERMS
    """Terms of the discriminator's loss (eq. 1); without `mismatched` it is the released configurations' binary loss."""
    form: LossForm = "equation"
    """How the terms are added up: as in eq. 1, or pooled as in the released code."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    version: str = "calm"
    """Version written into the files."""


def calm(config: CalmTraining) -> None:
    """Trains a low-level controller by adversarial imitation and writes llc.onnx, motion_encoder.onnx and curve.png."""
    from agents.controller.calm.config import PRESETS
    from agents.controller.calm.trainer import CalmTrainer
    from agents.controller.commands import STUDENT
    from agents.controller.export import export_student
    from agents.controller.reference import ReferenceMotions
    from motion_data.library import MotionLibrary

    if config.preset not in PRESETS:
        raise ValueError(f"Unknown preset '{config.preset}'. The presets are: {', '.join(PRESETS)}.")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    everything = MotionLibrary.default()
    library = MotionLibrary([everything[name.strip()] for name in config.clips.split(",")])
    settings = PRESETS[config.preset]()
    settings = replace(
        settings,
        minutes=config.minutes,
        num_humanoids=config.num_humanoids or settings.num_humanoids,
        terms=config.terms,
        form=config.form,
        seed=config.seed,
        threads=config.threads,
    )
    if config.initial:
        settings = settings.begun_with(STUDENT if config.initial == Path("bundled") else config.initial)
    motions = ReferenceMotions(library.clips)
    print(f"{len(library)} clips, {len(motions) / 30:.0f} s of motion; checkpoint in {config.output}")
    student = CalmTrainer(motions, config.output, settings, library.weights).train()
    source = f"{len(library)} clips: {', '.join(library.names)}"
    controller, encoder = export_student(student, motions, config.output, config.version, source)
    print(f"Wrote {controller} and {encoder}; curves in {config.output / 'curve.png'}.")
