"""`anyskill play retrieval`: steer a humanoid with the keyboard, and switch its motion database while it runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.retrieval.config import named_databases
from agents.retrieval.retriever import Retriever, load_retriever, unlearned
from anyskill_envs.retrieval import RetrievalLocomotionVectorEnv
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.files import write_whole
from motion_data.skeleton import FRAME_RATE

# Codes of GLFW. Its package need not be there to read them.
RIGHT, LEFT, DOWN, UP, ENTER = 262, 263, 264, 265, 257
_DIGITS = {ord("1") + number: number for number in range(9)} | {321 + number: number for number in range(9)}

SPEED_STEP = 0.25
"""m/s for each press."""
TURN_STEP = np.radians(15)
"""Radians for each press."""
FASTEST = 4.0
"""m/s."""
_BESIDE = 1.2  # m to the left of the goal's direction: where the retrieved clip is drawn


class Steering:
    """What the keys have asked for so far: a goal, a database, a new start. Knows nothing of windows.

    Up and down change the speed, left and right turn the direction, 1 to 9 choose the database, Enter starts anew.

    Args:
        databases: Names of the databases, in the order of the digits.
        speed: Speed at the start, m/s.

    Attributes:
        speed: Wished speed, m/s.
        direction: Wished direction in the world, radians.
        database: Name of the wished database.
    """

    def __init__(self, databases: Sequence[str], speed: float = 1.0) -> None:
        self.databases = list(databases)
        self.speed = speed
        self.direction = 0.0
        self.database = self.databases[0]
        self._start_anew = False

    def press(self, key: int) -> bool:
        """Takes in a key.

        Args:
            key: Code of GLFW.

        Returns:
            Whether it means something.
        """
        if key in (UP, DOWN):
            self.speed = float(np.clip(self.speed + (SPEED_STEP if key == UP else -SPEED_STEP), 0.0, FASTEST))
        elif key in (LEFT, RIGHT):
            turned = self.direction + (TURN_STEP if key == LEFT else -TURN_STEP)
            self.direction = float((turned + np.pi) % (2 * np.pi) - np.pi)
        elif key in _DIGITS and _DIGITS[key] < len(self.databases):
            self.database = self.databases[_DIGITS[key]]
        elif key == ENTER:
            self._start_anew = True
        else:
            return False
        return True

    def apply(self, env: RetrievalLocomotionVectorEnv) -> None:
        """Tells the environment."""
        env.set_goal(self.speed, self.direction)
        if env.databases[env.clips.choice[0]] != self.database:
            env.use_database(self.database)

    def take_start(self) -> bool:
        """Whether a new start was asked for since the last call."""
        asked, self._start_anew = self._start_anew, False
        return asked

    def describe(self) -> str:
        """One line about what is wished."""
        styles = ", ".join(f"{number} {name}" for number, name in enumerate(self.databases, 1))
        degrees = np.degrees(self.direction)
        return f"{self.speed:.2f} m/s, {degrees:+.0f} degrees, {self.database} (keys: arrows; {styles}; Enter)"


def play(
    retriever: Annotated[Path | None, tyro.conf.Positional] = None,
    databases: tuple[str, ...] = (),
    controller: Path | None = None,
    speed: float = 1.0,
    video: Path | None = None,
    seconds: float = 20.0,
    seed: int = 0,
) -> int:
    """Steer a humanoid with the arrow keys; 1 to 9 switch its motion database. The retrieved clip walks beside it.

    Args:
        retriever: Run folder of `anyskill train-retrieval`, its policy.onnx, or a .zip file of Stable-Baselines3; all
            weights 1 if it is left out.
        databases: Motion databases, SOURCE or NAME=SOURCE each, in the order of the digits; "move_around&usual" of
            the library by default. Sources are saved databases (.npz), folders of motion files, categories of the motion
            library, and patterns of its clips' names.
        controller: Low-level controller (ONNX), with its motion encoder beside it; the bundled one by default.
        speed: Speed at the start, m/s.
        video: Write this .mp4 file, with goals and databases that change by chance, instead of opening a window.
        seconds: Length of the video.
        seed: Seed of start and goals.

    Returns:
        0.

    Raises:
        FileNotFoundError: There is no such retriever or controller.
        ValueError: An option has a bad value.
        RenderingError: This machine has no screen, or cannot draw.
    """
    if video is not None and video.suffix.lower() != ".mp4":
        raise ValueError(f"The video must be an .mp4 file, got '{video}'.")
    if not (np.isfinite(speed) and 0 <= speed <= FASTEST):
        raise ValueError(f"speed must be from 0 to {FASTEST:g} m/s, got {speed}.")
    if not 0 < seconds < np.inf:
        raise ValueError(f"seconds must be positive, got {seconds}.")
    act: Retriever = unlearned if retriever is None else load_retriever(retriever)
    if video is None:
        from anyskill_envs.viewer import check_screen

        check_screen()  # before the databases are made, which may take a while
    env = RetrievalLocomotionVectorEnv(
        databases=named_databases(databases),
        controller=controller,
        goal_seconds=None,
        record_controller_steps=True,
        autoreset_mode="SameStep",
    )
    steering = Steering(env.databases, speed)
    if video is None:
        _steer(env, act, steering, seed)
    else:
        qpos = drive(env, act, steering, seconds, seed)
        from agents.text.video import write_video

        video.parent.mkdir(parents=True, exist_ok=True)
        write_whole(video, lambda path: write_video(path, qpos, [f"retrieval: {', '.join(env.databases)}"]))
        print(f"Wrote {video}: {len(qpos) / FRAME_RATE:.0f} s.")
    env.close()
    return 0


def drive(
    env: RetrievalLocomotionVectorEnv, act: Retriever, steering: Steering, seconds: float, seed: int
) -> NDArray[np.float64]:
    """Steers with keys that are pressed by chance, four times in 3 s.

    Args:
        env: One humanoid.
        act: The retriever.
        steering: What the keys change.
        seconds: How long.
        seed: Seed of start and keys.

    Returns:
        Poses at 30 Hz, ``(T, 35)``.
    """
    rng = np.random.default_rng(seed)
    keys = [UP, DOWN, LEFT, RIGHT, *(ord("1") + number for number in range(min(9, len(env.databases))))]
    observation, _ = env.reset(seed=seed)
    poses = []
    for decision in range(round(seconds * FRAME_RATE / CONTROLLER_STEPS)):
        if decision % 18 == 17:
            for key in rng.choice(keys, 4):
                steering.press(int(key))
        steering.apply(env)
        observation, _, _, _, info = env.step(act(env.observations(slice(None))))
        poses.append(info["controller_qpos"][0])
    return np.concatenate(poses)


def _steer(env: RetrievalLocomotionVectorEnv, act: Retriever, steering: Steering, seed: int) -> None:
    """The window: one decision is simulated, then its five poses are shown in real time."""
    from anyskill_envs.viewer import HumanoidViewer

    def on_key(key: int) -> None:
        if steering.press(key):
            print(f"\r{steering.describe():<100}", end="", flush=True)

    viewer = HumanoidViewer(1 / FRAME_RATE, env.scene, on_key)
    print(steering.describe())
    env.reset(seed=seed)
    while viewer.is_open:
        if steering.take_start():
            env.reset()
        steering.apply(env)
        _, _, _, _, info = env.step(act(env.observations(slice(None))))
        beside, ahead = _offsets(steering)
        executed = int(info["controller_steps"][0])
        age = env.clips.age[0]
        for step, pose in enumerate(info["controller_qpos"][0, :executed]):
            # after a fall the clip is that of a new episode
            clip = env.clips.pose(0, max(0, age - executed + step + 1))
            clip[:2] += beside
            floor = np.array([*pose[:2], 0.05])
            viewer.show(pose, clip, np.stack([floor, floor + ahead]))
    viewer.close()
    print()


def _offsets(steering: Steering) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the clip is drawn, from the humanoid ``(2,)``, and the arrow of the goal ``(3,)``, both in metres."""
    along = np.array([np.cos(steering.direction), np.sin(steering.direction)])
    ahead = np.append(along * max(steering.speed, 0.05), 0.0)
    return _BESIDE * np.array([-along[1], along[0]]), ahead
