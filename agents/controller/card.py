"""The model card of a controller, written from its measurements."""

from collections.abc import Iterable, Mapping
from typing import Any

_TEMPLATE = """# Low-level controller {version}

`llc.onnx` (policy), `motion_encoder.onnx` (motion window to latent) and `latents.npz` (latents of the training clips).

| | |
|---|---|
| What it does | PD targets of 28 hinges at 30 Hz from 223 numbers of proprioception and a unit latent of 64 |
| Body | `motion_data/assets/humanoid.xml`, SHA-256 `{digest}` |
| Method | motion tracking by PPO in the heading frame, then distillation (DAgger) into a latent that sees only the 2 s window of the reference, then PPO under held and changing latents and pushes with the labels of the first stage beside it (`docs/controller.md`); a clip and its left-right twin are one skill, and all but symmetric clips are mirrored in half of the samples |
| Compute | {compute} |
| Training data | {training_data} |
| Licence | {licence}; trained by this project. The mocap clips come with the package `pybullet` and are not part of the files |
| Intended use | the frozen low level of the environments of this package; its input is checked by a contract in the files' metadata |

## Bars

| measured | value | bar | passed |
|---|---|---|---|
{bars}

## Clips

`anyskill controller evaluate --json`, {episodes} episodes per clip, latent renewed at 6 Hz from the reference window; the policy
sees no reference. Survival: the mean distance of the bodies from the reference, in the heading frame, stays below 0.4 m to the
end of the clip. The first groups divide the clips, the last three overlap and leave acrobatics out.
`docs/strips` shows each bundled clip, reference above simulation (`anyskill controller show --pages docs/strips`).

| group | clips | survival | lowest clip | body error (mm) |
|---|---|---|---|---|
{summary}

A classifier of the reference clips (nearest neighbour of 2 s windows) names {naming} of the unmirrored clips from the simulated
motion. Feet slide at {skate} m/s while they touch the floor (reference: {reference_skate}); the jerk of the bodies is
{jerk} m/s^3 (reference: {reference_jerk}).

## Balance

A standing clip keeps both feet planted.

| falls (head below 0.6 m), within 10 s where nothing else is said | |
|---|---|
| frozen latent of a standing clip, mean over clips | {frozen_falls_mean} |
| frozen latent of a standing clip, worst clip | {frozen_falls_highest} |
| frozen latent of an upright clip that lifts or moves a foot, mean over clips | {frozen_falls_stepping} |
| frozen latent half-way between two standing clips | {interpolation_falls} |
| random latents of standing clips, renewed at 6 Hz | {random_falls} |
| random latents of all clips on the feet, renewed at 6 Hz | {random_upright_falls} |
| latents uniform on the sphere, renewed at 6 Hz | {uniform_falls} |
| push of 150 N for 0.2 s in a random direction while standing, within 5 s | {push_standing} |
| the same while walking | {push_walking} |

Getting up with the latents of a get-up clip, then of standing: {front} stand 6 s after lying on the front, {back} after lying on
the back, by the clip that serves best ({get_up_clips}). Mirrored states and latents change the mirrored PD targets by {mirror_difference_degrees:.1f} degrees on average.

## Steering

Each latent of the clips that travel or turn is held for 4 s; those under which the humanoid falls do not count.

| direction | fastest | latent of |
|---|---|---|
{fastest}

| wanted forward speed (m/s) | nearest latent (m/s) |
|---|---|
{nearest}

| latents of | forward (m/s) | leftward (m/s) | turn to the left (degrees/s) | reference | falls |
|---|---|---|---|---|---|
{steering}

## Limits

What is below 1 in the table fails that often. Acrobatics (backflip, cartwheel, roll, spin, spinkick) were not trained. Bodies do
not collide with themselves.

## Every clip

| clip | survival | frames survived | body error (mm) | falls, frozen latent | named | else taken for |
|---|---|---|---|---|---|---|
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
    frozen, naming, steering, smooth = (result[key] for key in ("frozen_falls", "naming", "steering", "smoothness"))
    shares = {
        key: _share(value)
        for key, value in result.items()
        if key.endswith(("_falls", "_falls_mean", "_falls_highest", "_falls_stepping")) and not isinstance(value, dict)
    }
    return _TEMPLATE.format(
        version=metadata["version"],
        digest=metadata["model_xml_sha256"],
        training_data=metadata["training_data"],
        licence=metadata["licence"],
        compute=compute,
        episodes=episodes,
        bars=_table(
            (row["name"], _amount(row["value"], row["unit"]), _limit(row), _PASSED[row["met"]])
            for row in result["bars"]
        ),
        summary=_table(
            (name.replace("_", " "), row["clips"], *_rounded(row, 2, "survival", "lowest_survival"), *_error(row))
            for name, row in result["summary"].items()
        ),
        naming=_share(naming["top1"]),
        skate=_number(smooth["foot_skate"]["simulation"], 3),
        reference_skate=_number(smooth["foot_skate"]["reference"], 3),
        jerk=_number(smooth["jerk"]["simulation"], 0),
        reference_jerk=_number(smooth["jerk"]["reference"], 0),
        push_standing=_share(result["push_falls"]["standing"]),
        push_walking=_share(result["push_falls"]["walking"]),
        front=_share(result["get_up"]["front"]),
        back=_share(result["get_up"]["back"]),
        get_up_clips=", ".join(f"{name} {_share(rate)}" for name, rate in result["get_up"]["clips"].items()),
        mirror_difference_degrees=result["mirror_difference_degrees"],
        fastest=_table(
            (
                name.replace("_", " "),
                _amount(row["speed"], "degrees/s" if name.startswith("turn") else "m/s"),
                row["clip"],
            )
            for name, row in steering["fastest"].items()
        ),
        nearest=_table((wanted, _number(speed, 2)) for wanted, speed in steering["nearest_forward"].items()),
        steering=_table(
            (
                name,
                *_rounded(row, 2, "forward", "leftward"),
                *_rounded(row, 0, "turn_left"),
                f"{row['reference_forward']:.2f}, {row['reference_leftward']:.2f}, {row['reference_turn_left']:.0f}",
                _share(row["falls"]),
            )
            for name, row in sorted(steering["clips"].items())
        ),
        clips=_table(
            (
                name,
                *_rounded(row, 2, "survival", "frames"),
                *_error(row),
                _number(frozen.get(name), 2),
                _number(naming["named"].get(name), 2),
                naming["taken_for"].get(name, ""),
            )
            for name, row in sorted(result["clips"].items())
        ),
        **shares,
    )


_PASSED = {True: "yes", False: "no", None: ""}


def _table(rows: Iterable[Iterable[object]]) -> str:
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _share(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.1%}"


def _rounded(row: Mapping[str, float | None], digits: int, *keys: str) -> list[str]:
    return [_number(row[key], digits) for key in keys]


def _error(row: Mapping[str, float | None]) -> list[str]:
    return _rounded(row, 0, "error_mm")


def _amount(value: float | None, unit: str) -> str:
    if value is None or unit == "share":
        return _share(value)
    return f"{value:.2f} {unit}" if unit in ("m/s", "times") else f"{value:.0f} {unit}"


def _limit(row: Mapping[str, Any]) -> str:
    return ("at most " if row["at_most"] else "at least ") + _amount(row["limit"], row["unit"])
