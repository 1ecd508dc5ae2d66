"""Run against the installed wheel in a clean environment without extras: python smoke_test.py CHECKOUT.

Not collected by pytest: `make wheel` and continuous integration run it.
"""

import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("motion_data", "rewards", "anyskill_envs", "agents")
DATA = (
    "motion_data/assets/humanoid.xml",
    "motion_data/assets/authored.yaml",
    "anyskill_envs/weights/llc.onnx",
    "anyskill_envs/weights/motion_encoder.onnx",
    "anyskill_envs/weights/latents.npz",
    "rewards/weights/state_projection.onnx",
    "rewards/weights/text_head.onnx",
)


def check(holds: bool, what: str) -> None:
    print(("ok      " if holds else "FAILED  ") + what, flush=True)
    if not holds:
        sys.exit(1)


def command(*words: str) -> subprocess.CompletedProcess[str]:
    anyskill = Path(sys.executable).with_name("anyskill")
    return subprocess.run([str(anyskill), *words], capture_output=True, text=True, timeout=300)


def main(checkout: Path) -> None:
    start = time.perf_counter()
    import gymnasium as gym

    import anyskill_envs

    print(f"import anyskill_envs took {time.perf_counter() - start:.2f} s")
    site = Path(anyskill_envs.__file__).parents[1]
    check(checkout not in site.parents or ".venv" in site.parts, "the wheel is imported, not the checkout")
    check(find_spec("torch") is None and find_spec("stable_baselines3") is None, "the core needs no torch")
    for package in PACKAGES:
        check((site / package / "py.typed").is_file(), f"{package} is installed and typed")
    for name in DATA:
        check((site / name).is_file(), f"{name} is in the wheel")
    check(list((site / "anyskill_envs/weights").glob("*.md")) != [], "the weights have a model card")
    check(not (site / "tests").exists() and not (site / "examples").exists(), "tests and examples are not installed")

    env = gym.make("HumanoidLatent-v0")
    observation, _ = env.reset(seed=0)
    observation, _, terminated, _, info = env.step(env.action_space.sample())
    check(observation.shape == (223,) and not terminated and "latent" in info, "HumanoidLatent-v0 steps")
    envs = gym.make_vec("HumanoidLatent-v0", num_envs=8)
    envs.reset(seed=0)
    check(envs.step(envs.action_space.sample())[0].shape == (8, 223), "eight in one batch step")

    check(command("--help").returncode == 0, "anyskill --help")
    check("stand" in command("motions", "list").stdout, "anyskill motions list names the authored clips")
    doctor = command("doctor")
    check(doctor.returncode == 0, f"anyskill doctor finds the core healthy\n{doctor.stdout}")
    train = command("train", "squat down")
    helpful = train.returncode == 2 and 'pip install "anyskill-envs[train]"' in train.stderr
    check(helpful and "Traceback" not in train.stderr, "training without its extra names the pip command")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
