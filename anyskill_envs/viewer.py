"""A window that shows one humanoid, for `render_mode="human"`."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
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

_COMPANION_COLOUR = np.array([0.25, 0.55, 0.95, 0.45], np.float32)
_ARROW_COLOUR = np.array([0.95, 0.45, 0.1, 0.9], np.float32)
_ARROW_WIDTH = 0.03


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
        on_key: called with the GLFW code of each key that is pressed; MuJoCo's own keys then change nothing.

    Raises:
        RenderingError: there is no screen.
    """

    def __init__(self, frame_time: float, scene: Scene, on_key: Callable[[int], None] | None = None) -> None:
        check_screen()
        self._frame_time = frame_time
        self._model = scene.model
        self._data = mujoco.MjData(self._model)
        self._on_key = on_key
        self._companion = mujoco.MjData(self._model)
        self._options: dict[str, Any] = {}
        self._handle: Any = None
        self._next_frame = 0.0

    @property
    def is_open(self) -> bool:
        """Whether the window has not been closed; it counts as open before the first pose."""
        return self._handle is None or self._handle.is_running()

    def show(
        self,
        qpos: NDArray[np.float64],
        companion: NDArray[np.float64] | None = None,
        arrow: NDArray[np.float64] | None = None,
    ) -> None:
        """Show a pose of the scene, ``(pose_size,)``; nothing once the window is closed.

        Waits, so that poses follow each other in real time.

        Args:
            qpos: the pose.
            companion: a second pose, drawn in a translucent colour.
            arrow: start and end of an arrow, ``(2, 3)`` metres.

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
            for name, value in self._options.items():
                getattr(self._handle.opt, name)[:] = value
            self._decorate(companion, arrow)
        self._handle.sync()
        wait = self._next_frame - time.perf_counter()
        if wait > 0:
            time.sleep(wait)
        self._next_frame = max(self._next_frame, time.perf_counter() - self._frame_time) + self._frame_time

    def _decorate(self, companion: NDArray[np.float64] | None, arrow: NDArray[np.float64] | None) -> None:
        """Put a second humanoid and an arrow into the picture."""
        scene = self._handle.user_scn
        scene.ngeom = 0
        if companion is not None:
            set_pose(self._model, self._companion, companion)
            only_moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            options = self._handle.opt
            mujoco.mjv_addGeoms(self._model, self._companion, options, mujoco.MjvPerturb(), only_moving, scene)
            for geom in scene.geoms[: scene.ngeom]:
                geom.rgba[:] = _COMPANION_COLOUR
        if arrow is not None and scene.ngeom < scene.maxgeom:
            geom = scene.geoms[scene.ngeom]
            kind = mujoco.mjtGeom.mjGEOM_ARROW.value
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), _ARROW_COLOUR)
            mujoco.mjv_connector(geom, kind, _ARROW_WIDTH, *arrow)
            scene.ngeom += 1

    def _open(self) -> None:
        # Imported here: it loads GLFW, which complains where there is no screen.
        import mujoco.viewer

        try:
            self._handle = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False, key_callback=self._on_key
            )
        except Exception as error:  # GLFW, or macOS without `mjpython`
            raise RenderingError(f"The window does not open: {error}") from error
        with self._handle.lock():
            camera = self._handle.cam
            camera.distance, camera.azimuth, camera.elevation = 3.5, 150.0, -10.0
            if self._on_key is not None:
                self._options = {name: getattr(self._handle.opt, name).copy() for name in ("geomgroup", "flags")}

    def close(self) -> None:
        """Close the window."""
        if self._handle is not None:
            self._handle.close()
            self._handle = None
