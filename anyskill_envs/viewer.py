"""A window that shows one humanoid, for `render_mode="human"`."""

from __future__ import annotations

import os
import platform
import time
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import RenderingError, set_pose

NO_SCREEN_HELP = (
    'render_mode="human" opens a window, and there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is set). '
    'Use render_mode="rgb_array" for pictures without a window.'
)


def check_screen() -> None:
    """Check that a window can be opened here.

    Raises:
        RenderingError: there is no screen.
    """
    if platform.system() == "Linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RenderingError(NO_SCREEN_HELP)


class HumanoidViewer:
    """MuJoCo's viewer, following the pelvis, paced to real time. The window opens with the first pose.

    Args:
        frame_time: seconds between two poses.
        scene: the objects that stand beside it.

    Raises:
        RenderingError: there is no screen.
    """

    def __init__(self, frame_time: float, scene: Scene) -> None:
        check_screen()
        self._frame_time = frame_time
        self._model = scene.model
        self._data = mujoco.MjData(self._model)
        self._handle: Any = None
        self._next_frame = 0.0

    def show(self, qpos: NDArray[np.float64]) -> None:
        """Show a pose of the scene, ``(pose_size,)``; nothing once the window is closed.

        Waits, so that poses follow each other in real time.

        Raises:
            RenderingError: the window does not open.
        """
        if self._handle is None:
            self._open()
        if not self._handle.is_running():
            return
        with self._handle.lock():
            set_pose(self._model, self._data, qpos)
            mujoco.mj_camlight(self._model, self._data)
            self._handle.cam.lookat[:] = qpos[:3]  # the user's mouse turns the camera about the pelvis
        self._handle.sync()
        wait = self._next_frame - time.perf_counter()
        if wait > 0:
            time.sleep(wait)
        self._next_frame = max(self._next_frame, time.perf_counter() - self._frame_time) + self._frame_time

    def _open(self) -> None:
        # Imported here: it loads GLFW, which complains where there is no screen.
        import mujoco.viewer

        try:
            self._handle = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
        except Exception as error:  # GLFW, or macOS without `mjpython`
            raise RenderingError(f"The window does not open: {error}") from error
        with self._handle.lock():
            camera = self._handle.cam
            camera.distance, camera.azimuth, camera.elevation = 3.5, 150.0, -10.0

    def close(self) -> None:
        """Close the window."""
        if self._handle is not None:
            self._handle.close()
            self._handle = None
