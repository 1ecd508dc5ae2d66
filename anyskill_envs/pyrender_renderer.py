"""Pictures of the humanoid by pyrender: physically based shading and a skinned agent, for videos beside the simulation.

Needs pyrender2 and trimesh: `pip install "anyskill-envs[mesh]"`. (The older package pyrender pins a PyOpenGL with which
MuJoCo cannot draw.)
"""

from __future__ import annotations

import contextlib
import os
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from anyskill_envs.agent_mesh import body_meshes, body_transform
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import FRONT_CAMERA, NO_GL_HELP, Camera, Look, RenderingError, choose_backend, set_pose
from motion_data.skeleton import load_model

_TILE = 1.0
"""Side of a tile of the floor in metres."""
_TILES = 24
_FLOOR_COLOURS = np.array([[214, 219, 224, 255], [194, 201, 209, 255]], np.uint8)
_DISPLAY_GAMMA = 2.2
_SKY = (0.86, 0.90, 0.94)


class PyrenderRenderer:
    """Draws the humanoid in a pose; takes the place of :class:`anyskill_envs.rendering.HumanoidRenderer`.

    The GL context is created with the first picture.

    Args:
        width: Pixels.
        height: Pixels.
        scene: Draws the objects of this scene as well.
        look: "mannequin" or "simulation"; see :func:`anyskill_envs.agent_mesh.body_meshes`.
        shadows: Draw shadows.

    Raises:
        ImportError: pyrender2 or trimesh is not installed.
        RenderingError: This machine has no GL library.
        ValueError: A size that is not positive, or another look.
    """

    def __init__(
        self,
        width: int = 224,
        height: int = 224,
        scene: Scene | None = None,
        look: Look = "mannequin",
        shadows: bool = True,
    ) -> None:
        if width < 1 or height < 1:
            raise ValueError(f"The picture must have at least one pixel, not {width} x {height}.")
        self.backend = choose_backend()
        # pyrender reads it when it is imported; the same library as MuJoCo's, for a process can hold only one.
        if self.backend in ("egl", "osmesa"):
            os.environ["PYOPENGL_PLATFORM"] = self.backend
        else:
            os.environ.pop("PYOPENGL_PLATFORM", None)
        try:
            import pyrender
        except ImportError as error:
            raise ImportError(f'This renderer needs {error.name}: pip install "anyskill-envs[mesh]".') from error
        self._pyrender: Any = pyrender
        self.width = int(width)
        self.height = int(height)
        self.model = load_model() if scene is None else scene.model
        self._data = mujoco.MjData(self.model)
        self._object_bodies = [] if scene is None else [part.body for part in scene.parts.values()]
        self._flags = pyrender.RenderFlags.SHADOWS_DIRECTIONAL if shadows else pyrender.RenderFlags.NONE
        self._drawing: Any = None
        self._build(look)

    def _build(self, look: Look) -> None:
        pyrender = self._pyrender
        self._scene = pyrender.Scene(bg_color=(*_SKY, 1.0), ambient_light=(0.22, 0.23, 0.25))
        self._nodes = []
        for body, mesh in body_meshes(self.model, look):
            smooth = len(mesh.faces) > 12  # a box has edges
            self._nodes.append((body, self._scene.add(self._drawable(mesh, smooth))))
        self._floor = self._scene.add(self._drawable(_floor(), smooth=False))
        camera = pyrender.PerspectiveCamera(
            yfov=np.radians(float(self.model.vis.global_.fovy)), aspectRatio=self.width / self.height, znear=0.05
        )
        self._camera = self._scene.add(camera)
        self._lights = [
            (self._scene.add(pyrender.DirectionalLight(color=np.ones(3), intensity=strength)), np.array(direction))
            for strength, direction in ((3.1, (-0.45, 0.35, -1.0)), (1.0, (0.8, -0.9, -0.5)))
        ]

    def _drawable(self, mesh: Any, smooth: bool) -> Any:
        """A mesh of pyrender, whose shaders take colours for linear light."""
        drawable = self._pyrender.Mesh.from_trimesh(mesh, smooth=smooth)
        for primitive in drawable.primitives:
            primitive.color_0[:, :3] **= _DISPLAY_GAMMA
            primitive.material.metallicFactor, primitive.material.roughnessFactor = 0.05, 0.75
        return drawable

    def render(self, qpos: NDArray[np.float64], camera: Camera = FRONT_CAMERA) -> NDArray[np.uint8]:
        """Draw one pose.

        Args:
            qpos: a pose, shape (35,); a pose of the scene if there is one.
            camera: where the camera stands.

        Returns:
            The picture, uint8 (height, width, 3).

        Raises:
            ValueError: the pose has another shape.
            RenderingError: the GL context cannot be created.
        """
        qpos = np.asarray(qpos, dtype=np.float64)
        set_pose(self.model, self._data, qpos)
        if self._drawing is None:
            self._drawing = self._start()
        for body, node in self._nodes:
            self._scene.set_pose(node, body_transform(self._data, body))
        floor = np.eye(4)
        floor[:2, 3] = 2 * _TILE * np.round(qpos[:2] / (2 * _TILE))  # it walks along, tile upon tile of the same colour
        self._scene.set_pose(self._floor, floor)
        position, target = camera.placed(qpos, self._data.xpos[self._object_bodies])
        self._scene.set_pose(self._camera, looking(position, target))
        for node, direction in self._lights:
            self._scene.set_pose(node, looking(target - 4 * direction / np.linalg.norm(direction), target))
        picture, _ = self._drawing.render(self._scene, flags=self._flags)
        return np.ascontiguousarray(picture[..., :3])

    def _start(self) -> Any:
        try:
            return self._pyrender.OffscreenRenderer(self.width, self.height)
        except Exception as error:  # each platform fails with exceptions of its own
            raise RenderingError(f"pyrender does not start on {self.backend!r} ({error}). {NO_GL_HELP}") from error

    def close(self) -> None:
        """Free the GL context; a later `render` creates a new one."""
        if self._drawing is None:
            return
        drawing, self._drawing = self._drawing, None
        platform = drawing._platform
        platform.make_current()
        drawing._renderer.delete()
        if self.backend == "egl":
            # pyrender would shut down the display, which it shares with the contexts of MuJoCo in this process.
            from OpenGL.EGL import eglDestroyContext

            eglDestroyContext(platform._egl_display, platform._egl_context)
            platform._egl_display = platform._egl_context = None
        else:
            platform.delete_context()
        drawing._platform = None

    def __del__(self) -> None:
        """Free the GL context with the object, while Python is still whole."""
        with contextlib.suppress(Exception):  # at interpreter exit modules may be gone already
            self.close()


def looking(position: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose `(4, 4)` of a camera or light at `position` that looks at `target`: along its -z, its y upwards."""
    back = position - target
    back = back / max(float(np.linalg.norm(back)), 1e-9)
    side = np.cross([0.0, 0.0, 1.0], back)
    if np.linalg.norm(side) < 1e-6:  # straight down: any side will do
        side = np.array([0.0, 1.0, 0.0])
    side = side / np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = side, np.cross(back, side), back, position
    return pose


def _floor() -> Any:
    """A chequered floor around the origin."""
    import trimesh

    edges = _TILE * (np.arange(_TILES + 1) - _TILES // 2)
    corners = np.array([[x, y, 0.0] for x in edges for y in edges])
    first = (np.arange(_TILES)[:, None] * (_TILES + 1) + np.arange(_TILES)).ravel()
    quads = first[:, None] + np.array([0, _TILES + 1, _TILES + 2, 1])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    dark = (np.add.outer(np.arange(_TILES), np.arange(_TILES)) % 2).ravel()
    mesh: Any = trimesh.Trimesh(corners, faces, process=False)
    mesh.visual.face_colors = _FLOOR_COLOURS[np.concatenate([dark, dark])]
    return mesh
