"""How good a controller is: per clip through the encoder, and all other measurements in one result."""

from typing import Any

import numpy as np

from agents.controller.bars import bars
from agents.controller.fidelity import evaluate_naming, evaluate_smoothness, evaluate_symmetry
from agents.controller.reference import ReferenceMotions
from agents.controller.robustness import (
    evaluate_frozen,
    evaluate_get_up,
    evaluate_interpolation,
    evaluate_pushes,
    evaluate_random,
)
from agents.controller.rollout import Controller, Encoder, perform, renewed, start
from agents.controller.selection import (
    ACROBATIC,
    FLIGHT,
    base_name,
    on_feet_clips,
    standing_clips,
    unmirrored_clips,
)
from agents.controller.steering import evaluate_steering
from agents.controller.tracking import tracking_distance

FAILURE_DISTANCE = 0.4
"""Mean distance of the bodies from the reference (metres) at which an episode counts as not survived."""

_PERFORMANCES = 3  # of each clip on record, for the classifier, foot skate and jerk


def evaluate_clips(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, episodes: int = 20, limit: int = 300
) -> dict[str, dict[str, float]]:
    """Performs each clip through the encoder: z = E(window), renewed at 6 Hz; the policy sees no reference.

    Episodes start from evenly spaced phases of the first half of the clip, with small noise, and last to its end (at most
    ``limit`` controller steps).

    Returns:
        For each clip: ``survival`` (share of episodes whose mean body distance from the reference stays below 0.4 m),
        ``frames`` (share of frames until then), ``error_mm`` (mean body distance in the heading frame, root-relative with
        height, while it survives).
    """
    clips = np.repeat(np.arange(len(motions.names)), episodes)
    room = np.maximum(motions.lengths[clips] - 1 - 30, 0) / 2
    frame = motions.starts[clips] + (np.tile(np.linspace(0, 1, episodes), len(motions.names)) * room).astype(int)
    length = np.minimum(motions.last[frame] - frame, limit)
    simulation = start(motions, frame, np.random.default_rng(0))
    latent_at = renewed(lambda step: encoder.encode(motions.windows(frame)))
    alive = np.ones(len(clips), bool)
    survived, error = np.zeros(len(clips)), np.zeros(len(clips))
    targets = np.zeros((len(clips), 28), np.float32)
    for step in range(int(length.max())):
        # What has failed or ended is not measured any more, so it need not move either.
        running = alive & (step < length)
        if not running.any():
            break
        targets[running] = controller.act(simulation.observation()[running], latent_at(step)[running])
        simulation.step(targets, active=running)
        frame = motions.ahead(frame, 1)
        distance = tracking_distance(simulation.observation(), motions.observations[frame])
        alive &= ~(running & ~(distance < FAILURE_DISTANCE))
        survived += alive & running
        error += np.where(alive & running, distance, 0)
    result = {}
    for clip, name in enumerate(motions.names):
        mine = clips == clip
        result[name] = {
            "survival": float(alive[mine].mean()),
            "frames": float((survived / length)[mine].mean()),
            "error_mm": float(1000 * error[mine].sum() / max(1, survived[mine].sum())),
        }
    return result


def _summary(rows: list[dict[str, float]]) -> dict[str, float]:
    return {
        "clips": len(rows),
        "survival": float(np.mean([row["survival"] for row in rows])),
        "lowest_survival": float(np.min([row["survival"] for row in rows])),
        "error_mm": float(np.mean([row["error_mm"] for row in rows])),
    }


def _groups(motions: ReferenceMotions) -> dict[str, list[str]]:
    """Names of the clips by kind, then (overlapping) those without acrobatics: all, in place, and travelling ones."""
    groups: dict[str, list[str]] = {}
    overall: dict[str, list[str]] = {"all_but_acrobatic": [], "in_place": [], "locomotion": []}
    for clip in motions.clips:
        base = base_name(clip.name)
        made = clip.source.split()[0]
        if made in ("planned", "joined"):
            kind = made
        elif made == "authored":
            kind = "authored_in_place" if "act_in_place" in clip.categories else "authored_moving"
        elif base in ACROBATIC:
            kind = "real_acrobatic"
        else:
            kind = "real_with_flight" if base in FLIGHT else "real_without_flight"
        groups.setdefault(kind, []).append(clip.name)
        if base not in ACROBATIC:
            overall["all_but_acrobatic"].append(clip.name)
            for category, group in (("act_in_place", "in_place"), ("move_around", "locomotion")):
                if category in clip.categories:
                    overall[group].append(clip.name)
    return {**dict(sorted(groups.items())), **{kind: names for kind, names in overall.items() if names}}


def evaluate_controller(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, episodes: int = 20
) -> dict[str, Any]:
    """All measurements of the controller, ready for JSON; None stands for what these motions cannot measure.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions.
        episodes: Episodes per clip. The number of episodes of the other measurements is in proportion; with 20 it is
            their default.

    Returns:
        ``clips`` (see :func:`evaluate_clips`) and their means by kind of clip, ``summary``; ``frozen_falls`` by upright
        clip, their mean and highest over the standing ones and their mean over the others; ``random_falls`` (latents of
        standing clips), ``random_upright_falls`` (of all clips on the feet), ``uniform_falls``, ``interpolation_falls``,
        ``push_falls``, ``get_up`` (see :mod:`agents.controller.robustness`); ``naming``, ``smoothness``,
        ``mirror_difference_degrees`` (:mod:`agents.controller.fidelity`); ``steering``
        (:mod:`agents.controller.steering`); ``bars`` (:mod:`agents.controller.bars`).
    """
    both = controller, encoder, motions

    def share(usual: int) -> int:
        return max(1, round(usual * episodes / 20))

    clips = evaluate_clips(*both, episodes)
    frozen = evaluate_frozen(*both, episodes=episodes)
    standing_names = {motions.names[clip] for clip in standing_clips(motions)}
    standing = [rate for name, rate in frozen.items() if name in standing_names]
    stepping = [rate for name, rate in frozen.items() if name not in standing_names]
    on_feet = on_feet_clips(motions)
    unmirrored = np.repeat(unmirrored_clips(motions), min(_PERFORMANCES, episodes))
    performance = perform(*both, unmirrored, np.random.default_rng(0))
    result = {
        "summary": {kind: _summary([clips[name] for name in names]) for kind, names in _groups(motions).items()},
        "frozen_falls_mean": float(np.mean(standing)) if standing else None,
        "frozen_falls_highest": float(np.max(standing)) if standing else None,
        "frozen_falls_stepping": float(np.mean(stepping)) if stepping else 0.0,
        "random_falls": evaluate_random(*both, episodes=share(200)) if standing else None,
        "random_upright_falls": evaluate_random(*both, episodes=share(200), clips=on_feet) if len(on_feet) else None,
        "uniform_falls": evaluate_random(*both, episodes=share(200), uniform=True) if standing else None,
        "interpolation_falls": evaluate_interpolation(*both, episodes=share(100)),
        "push_falls": evaluate_pushes(*both, episodes=share(100)),
        "get_up": evaluate_get_up(*both, episodes=share(50)),
        "naming": evaluate_naming(performance, motions),
        "smoothness": evaluate_smoothness(performance, motions),
        "mirror_difference_degrees": evaluate_symmetry(*both),
        "steering": evaluate_steering(*both),
        "frozen_falls": frozen,
        "clips": clips,
    }
    return {"bars": bars(result), **result}
