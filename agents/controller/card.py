"""The model card of a controller, written from its measurements."""

from typing import Any

_TEMPLATE = """# Low-level controller {version}

`llc.onnx` (policy), `motion_encoder.onnx` (motion window to latent) and `latents.npz` (latents of the training clips).

| | |
|---|---|
| What it does | PD targets of 28 hinges at 30 Hz from 223 numbers of proprioception and a unit latent of 64 |
| Body | `motion_data/assets/humanoid.xml`, SHA-256 `{digest}` |
| Method | motion tracking by PPO in the heading frame, then distillation (DAgger) into a latent that sees only the 2 s window of the reference, half of the samples mirrored |
| Compute | {compute} |
| Training data | {training_data} |
| Licence | {licence}; trained by this project. The mocap clips come with the package `pybullet` and are not part of the files |
| Intended use | the frozen low level of the environments of this package; its input is checked by a contract in the files' metadata |

## Measured quality

`anyskill controller evaluate --json`, {episodes} episodes per clip, latent renewed at 6 Hz from the reference window; the policy
sees no reference. Survival: the mean distance of the bodies from the reference, in the heading frame, stays below 0.4 m to the
end of the clip.

| group | clips | survival | lowest clip | body error (mm) |
|---|---|---|---|---|
{summary}

A standing clip keeps both feet planted.

| falls within 10 s (head below 0.6 m) | |
|---|---|
| frozen latent of a standing clip, mean over clips | {frozen_falls_mean:.1%} |
| frozen latent of a standing clip, worst clip | {frozen_falls_highest:.1%} |
| frozen latent of an upright clip that lifts or moves a foot, mean over clips | {frozen_falls_stepping:.1%} |
| random latents of standing clips, renewed at 6 Hz | {random_falls:.1%} |
| latents uniform on the sphere, renewed at 6 Hz | {uniform_falls:.1%} |

## Limits

First version: what is below 1 in the table fails that often. Acrobatics (backflip, cartwheel, roll, spin, spinkick) were not
trained. Bodies do not collide with themselves.

## Every clip

| clip | survival | frames survived | body error (mm) | falls, frozen latent |
|---|---|---|---|---|
{clips}
"""


def model_card(result: dict[str, Any], metadata: dict[str, str], episodes: int, compute: str) -> str:
    """Markdown of the card.

    Args:
        result: What :func:`agents.controller.evaluate.evaluate_controller` returned.
        metadata: Metadata of the controller's file.
        episodes: Episodes per clip of the evaluation.
        compute: One line on what the training cost.
    """
    summary = "\n".join(
        f"| {name.replace('_', ' ')} | {row['clips']} | {row['survival']:.2f} | {row['lowest_survival']:.2f} "
        f"| {row['error_mm']:.0f} |"
        for name, row in result["summary"].items()
    )
    frozen = result["frozen_falls"]
    clips = "\n".join(
        f"| {name} | {row['survival']:.2f} | {row['frames']:.2f} | {row['error_mm']:.0f} "
        f"| {f'{frozen[name]:.2f}' if name in frozen else ''} |"
        for name, row in sorted(result["clips"].items())
    )
    numbers = {key: value for key, value in result.items() if isinstance(value, float)}
    return _TEMPLATE.format(
        version=metadata["version"],
        digest=metadata["model_xml_sha256"],
        training_data=metadata["training_data"],
        licence=metadata["licence"],
        compute=compute,
        episodes=episodes,
        summary=summary,
        clips=clips,
        **numbers,
    )
