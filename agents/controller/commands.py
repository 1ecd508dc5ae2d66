"""The commands `anyskill controller train | evaluate | show`."""

import json
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from agents.controller.card import model_card
from agents.controller.evaluate import evaluate_controller
from agents.controller.reference import ReferenceMotions
from agents.controller.selection import ACROBATIC, base_name
from anyskill_envs.controller import WEIGHTS, LowLevelController, MotionEncoder
from motion_data.clip import MotionClip
from motion_data.library import MotionLibrary, missing_mirrors

_TRAINED = Path(__file__).parent / "weights"
TRACKING_POLICY = _TRAINED / "tracking_policy.safetensors"
STUDENT = _TRAINED / "student.safetensors"
"""Networks of the stages that made the bundled controller: where training goes on by default."""


def read_clips(folder: Path) -> list[MotionClip]:
    """All clips (``.npz``) of a folder.

    Raises:
        ValueError: If there are none.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise ValueError(f"No motion clips (.npz) in '{folder}'. Import some with `anyskill motions import FILE`.")
    return [MotionClip.load(path) for path in paths]


def controller_clips(folder: Path | None, acrobatics: bool, mirrored: bool) -> list[MotionClip]:
    """The clips that a controller is trained on or measured with.

    Args:
        folder: A folder of clips; the project's library if None.
        acrobatics: Whether to include backflip, cartwheel, roll, spin and spinkick.
        mirrored: Whether to add mirror images. Training needs none: distillation mirrors what lacks an image.
    """
    clips: Sequence[MotionClip] = read_clips(folder) if folder else MotionLibrary.default(mirrored=mirrored).clips
    return [clip for clip in clips if acrobatics or base_name(clip.name) not in ACROBATIC]


@dataclass(frozen=True)
class ControllerTraining:
    """Trains the low-level controller: a tracking policy, its distillation into a latent space, fine-tuning, export."""

    output: Path = Path("runs/controller")
    """Folder of checkpoints and of the finished files; a run that was stopped goes on from there."""
    clips: Path | None = None
    """Folder of motion clips (.npz) to learn; the project's library if not given."""
    acrobatics: bool = False
    """Also learn backflip, cartwheel, roll, spin and spinkick; they cost the other clips training time."""
    teacher_minutes: float = 60.0
    """Minutes for the tracking policy."""
    rounds: int = 2
    """How often distillation and fine-tuning follow each other: what is rare in the library, fine-tuning forgets a little, and
    the next distillation, which begins with the fine-tuned weights, brings it back."""
    distill_minutes: float = 20.0
    """Minutes for each distillation."""
    finetune_minutes: float = 10.0
    """Minutes for each fine-tuning under held and random latents and pushes; 0 for none, and then one round does."""
    from_scratch: bool = False
    """Begin with random networks instead of those that made the bundled controller."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    version: str = "0.1"
    """Version written into the files."""


def train(config: ControllerTraining) -> None:
    """Trains a low-level controller and writes llc.onnx, motion_encoder.onnx and latents.npz."""
    from agents.controller.distill import DistillConfig, DistillTrainer
    from agents.controller.export import export_student, save_student
    from agents.controller.finetune import FinetuneConfig, FinetuneTrainer
    from agents.controller.teacher import TeacherConfig, TeacherTrainer

    if config.rounds < 1:
        raise ValueError(f"There must be at least one round of distillation and fine-tuning, not {config.rounds}.")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    clips = controller_clips(config.clips, config.acrobatics, mirrored=False)
    motions = ReferenceMotions(clips)
    print(f"{len(motions.names)} clips, {len(motions) / 30:.0f} s of motion; checkpoints in {config.output}")
    seed, threads = config.seed, config.threads
    first, begin = (None, None) if config.from_scratch else (TRACKING_POLICY, STUDENT)
    tracking = TeacherConfig(minutes=config.teacher_minutes, seed=seed, threads=threads, initial=first)
    teacher = TeacherTrainer(motions, config.output, tracking).train()
    both_sides = ReferenceMotions([*clips, *missing_mirrors(clips)]) if config.finetune_minutes else motions
    for number in range(1, config.rounds + 1):
        folder = config.output / f"round_{number}"
        distillation = DistillConfig(minutes=config.distill_minutes, seed=seed, threads=threads, initial=begin)
        student = DistillTrainer(teacher, motions, folder, distillation).train()
        if config.finetune_minutes:
            finetuning = FinetuneConfig(minutes=config.finetune_minutes, seed=seed, threads=threads)
            student = FinetuneTrainer(student, teacher, both_sides, folder, finetuning).train()
        begin = save_student(student, folder)
    source = f"{len(motions.names)} clips: {', '.join(motions.names)}"
    controller, encoder = export_student(student, motions, config.output, config.version, source)
    print(f"Wrote {controller} and {encoder}. Measure them: anyskill controller evaluate --weights {config.output}")


@dataclass(frozen=True)
class ControllerEvaluation:
    """Measures a controller: how well it performs each clip, keeps its balance, gets up and can be steered."""

    weights: Path = field(default=WEIGHTS)
    """Folder of llc.onnx and motion_encoder.onnx; the bundled ones if not given."""
    clips: Path | None = None
    """Folder of motion clips (.npz); the project's library if not given."""
    episodes: int = 20
    """Episodes per clip; those of the other measurements are in proportion. 5 are a quick look."""
    json: bool = False
    """Print everything as JSON instead of a table."""
    card: Path | None = None
    """Write a model card (Markdown) with the figures to this file."""
    compute: str = "not recorded"
    """One line for the model card on what the training cost."""


def _load(folder: Path) -> tuple[LowLevelController, MotionEncoder]:
    return LowLevelController.load(folder / "llc.onnx"), MotionEncoder.load(folder / "motion_encoder.onnx")


def evaluate(config: ControllerEvaluation) -> None:
    """Prints survival and body error per clip, and which bars the controller passes."""
    controller, encoder = _load(config.weights)
    motions = ReferenceMotions(controller_clips(config.clips, acrobatics=True, mirrored=True))
    result = evaluate_controller(controller, encoder, motions, config.episodes)
    if config.card:
        config.card.write_text(
            model_card(result, controller.metadata, config.episodes, config.compute), encoding="utf-8"
        )
    if config.json:
        print(json.dumps(result, indent=1))
        return
    print(f"{'clip':34} survival  frames  error (mm)")
    for name, row in sorted(result["clips"].items(), key=lambda item: item[1]["survival"]):
        print(f"{name:34} {row['survival']:8.2f} {row['frames']:7.2f} {row['error_mm']:11.0f}")
    for name, row in result["summary"].items():
        print(f"{name}: {row['clips']} clips, survival {row['survival']:.2f}, error {row['error_mm']:.0f} mm")
    for bar in result["bars"]:
        value = "not measured" if bar["value"] is None else f"{bar['value']:.3g}"
        verdict = {True: "passed", False: "missed", None: ""}[bar["met"]]
        limit = f"at {'most' if bar['at_most'] else 'least'} {bar['limit']:g}"
        print(f"{bar['name']:62} {value:>12} ({limit} {bar['unit']}) {verdict}")


@dataclass(frozen=True)
class ControllerStrips:
    """Draws what a controller makes of each clip: a strip of the reference above the simulation."""

    output: Path = Path("runs/strips")
    """Folder of the pictures, NAME.png."""
    weights: Path = field(default=WEIGHTS)
    """Folder of llc.onnx and motion_encoder.onnx; the bundled ones if not given."""
    clip: tuple[str, ...] = ()
    """Names of the clips; all but mirror images if none is given."""
    clips: Path | None = None
    """Folder of motion clips (.npz); the project's library if not given."""
    frames: int = 10
    """Pictures in a row."""
    pages: Path | None = None
    """Folder of overviews, small copies of all strips on a few pages (.webp); none if not given."""


def show(config: ControllerStrips) -> None:
    """Writes a PNG for each clip: the reference above, what the controller does below, at the same moments."""
    from agents.controller.strips import draw_strips, write_pages

    controller, encoder = _load(config.weights)
    clips = MotionLibrary(controller_clips(config.clips, acrobatics=True, mirrored=True))
    names = config.clip or [name for name in clips.names if name == base_name(name)]
    motions = ReferenceMotions([clips[name] for name in names])
    paths = draw_strips(controller, encoder, motions, config.output, config.frames)
    print(f"Wrote {len(paths)} strips, such as {paths[0]}")
    if config.pages is not None:
        print(f"Wrote {len(write_pages(paths, config.pages))} pages into {config.pages}")
