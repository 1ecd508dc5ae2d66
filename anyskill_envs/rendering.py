"""Pictures of the humanoid: presets, cameras, and a GL context that is created only when the first picture is asked for."""

from __future__ import annotations

import contextlib
import copy
import ctypes
import importlib
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects.scene import Scene
from motion_data.skeleton import HUMANOID_XML, heading, load_model

Preset = Literal["clip_fast", "video"]
Follow = Literal["heading", "position", "world"]
Look = Literal["simulation", "mannequin"]
"""What is shown of the humanoid: the shapes that the physics knows, or a skinned mannequin."""
VideoLook = Literal["simulation", "mannequin", "beside"]
"""What a video shows: one of the looks, or both beside each other."""

NO_GL_HELP = (
    "No OpenGL library for pictures without a screen was found. Install one (Debian and Ubuntu: "
    "`apt-get install libegl1 libgl1`, or `libosmesa6`), or choose one with the environment variable MUJOCO_GL "
    "(egl, osmesa or glfw)."
)


class RenderingError(RuntimeError):
    """No picture can be drawn here; the message says what to install or to set."""


@dataclass(frozen=True)
class Camera:
    """Where the camera stands; it looks at the pelvis, or at what is between pelvis and object.

    The default is AnySkill's: (3, 0, 1) m, so that the humanoid is seen from the front.

    Attributes:
        position: metres. x and y count from the pelvis ("heading", "position") or from the origin ("world"), z from the
            floor.
        follow: "heading" walks around with the humanoid, x being where it faces; "position" walks along but keeps the
            direction of the world's axes; "world" stands still.
        look_at_height: height of the point looked at in metres; None for that of the pelvis.
        frame_objects: put the middle between pelvis and nearest object in the place of the pelvis, and step back as far
            as it takes to have both in the picture; an object more than 3 m away is let go.
    """

    position: tuple[float, float, float] = (3.0, 0.0, 1.0)
    follow: Follow = "heading"
    look_at_height: float | None = None
    frame_objects: bool = False

    def __post_init__(self) -> None:
        """Check the values."""
        if self.follow not in ("heading", "position", "world"):
            raise ValueError(f'Camera.follow must be "heading", "position" or "world", not {self.follow!r}.')
        if len(self.position) != 3 or not np.isfinite(self.position).all():
            raise ValueError(f"Camera.position must be three finite numbers in metres, not {self.position}.")

    def placed(
        self, qpos: NDArray[np.float64], objects: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the camera stands and what it looks at.

        Args:
            qpos: a pose, of which the first 7 numbers are those of the pelvis.
            objects: positions of the objects in the scene, (k, 3) world metres.

        Returns:
            Camera and target, both (3,) in world metres.
        """
        pelvis = np.array(qpos[:3], dtype=np.float64)
        position = np.array(self.position, dtype=np.float64)
        if self.frame_objects and objects is not None and len(objects):
            offset = min((objects - pelvis)[:, :2], key=lambda each: float(np.hypot(*each)))
            apart = float(np.hypot(*offset))
            shown = offset * min(1.0, _FRAMED / max(apart, 1e-9))
            pelvis[:2] += 0.5 * shown
            position[:2] *= max(1.0, (0.5 * min(apart, _FRAMED) + _MARGIN) / (_VIEW * float(np.hypot(*position[:2]))))
        if self.follow == "heading":
            yaw = float(heading(qpos[3:7]))
            cosine, sine = np.cos(yaw), np.sin(yaw)
            position[:2] = cosine * position[0] - sine * position[1], sine * position[0] + cosine * position[1]
        if self.follow != "world":
            position[:2] += pelvis[:2]
        target = pelvis
        if self.look_at_height is not None:
            target[2] = self.look_at_height
        return position, target


FRONT_CAMERA = Camera()
SCENE_CAMERA = Camera(position=(1.1, -3.2, 1.4), look_at_height=0.92, frame_objects=True)
"""For scenes with objects: from the humanoid's right side, a little from ahead, so that neither hides the other."""
_FRAMED = 3.0
"""Metres between pelvis and object up to which the camera shows both."""
_MARGIN = 0.55
"""Metres that are shown beyond both."""
_VIEW = float(np.tan(np.radians(22.5)))
"""Half the width of a square picture at a distance of 1 m; MuJoCo's cameras see 45 degrees."""


def camera_of(fields: Mapping[str, Any] | None, scene: Scene) -> Camera:
    """The camera with these fields; None stands for the default, which depends on whether there are objects."""
    if fields is None and scene:
        return SCENE_CAMERA
    return Camera(**(fields or {}))


def choose_backend() -> str:
    """Name of the GL backend for pictures without a window: "egl", "osmesa", "glfw" or "cgl".

    MUJOCO_GL decides if it is set. Otherwise Linux uses EGL, then OSMesa, then (with a screen) GLFW.

    Raises:
        RenderingError: MUJOCO_GL switches rendering off or has an unknown value, or no GL library is installed.
    """
    wish = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wish in ("disable", "disabled", "off", "false", "0"):
        raise RenderingError(f"MUJOCO_GL={wish} switches rendering off; unset it, or set it to egl, osmesa or glfw.")
    system = platform.system()
    libraries = {"egl": ("libEGL.so.1", "libEGL.so"), "osmesa": ("libOSMesa.so.8", "libOSMesa.so", "libOSMesa.so.6")}
    if wish in libraries and system == "Linux":
        if not _loadable(libraries[wish]):
            raise RenderingError(f"MUJOCO_GL={wish}, but its library is not installed. {NO_GL_HELP}")
        return wish
    if wish in ("glfw", "glx", "wgl"):
        return "glfw"
    if wish == "cgl" and system == "Darwin":
        return "cgl"
    if wish not in ("", "enable", "enabled", "on", "true", "1"):
        raise RenderingError(f"MUJOCO_GL={wish} is not known on {system}; set it to egl, osmesa or glfw, or unset it.")
    if system == "Darwin":
        return "cgl"
    if system != "Linux":
        return "glfw"
    for name, files in libraries.items():
        if _loadable(files):
            return name
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return "glfw"
    raise RenderingError(NO_GL_HELP)


def _loadable(files: tuple[str, ...]) -> bool:
    for file in files:
        try:
            ctypes.CDLL(file)
        except OSError:
            continue
        return True
    return False


def _create_context(backend: str, width: int, height: int) -> Any:
    """A current GL context of the backend.

    Raises:
        RenderingError: the backend does not start; the message carries its reason.
    """
    # MuJoCo reads MUJOCO_GL when it is imported, long before a picture is wanted: its backend modules are used directly.
    if backend in ("egl", "osmesa"):
        os.environ["PYOPENGL_PLATFORM"] = backend
    try:
        context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
        context.make_current()
    except Exception as error:  # each backend fails with exceptions of its own
        raise RenderingError(f"The OpenGL backend {backend!r} does not start ({error}). {NO_GL_HELP}") from error
    return context


def set_pose(model: mujoco.MjModel, data: mujoco.MjData, pose: NDArray[np.float64]) -> None:
    """Puts a pose of a scene into `data` and computes where all bodies are.

    Raises:
        ValueError: the pose has another shape.
    """
    size = model.nq + 7 * model.nmocap
    if pose.shape != (size,):
        raise ValueError(f"A pose must have the shape ({size},), not {pose.shape}.")
    data.qpos[:] = pose[: model.nq]
    anchors = pose[model.nq :].reshape(-1, 7)
    data.mocap_pos[:], data.mocap_quat[:] = anchors[:, :3], anchors[:, 3:]
    mujoco.mj_kinematics(model, data)


class Renderer(Protocol):
    """What draws a humanoid, with whatever library."""

    width: int
    height: int

    def render(self, qpos: NDArray[np.float64], camera: Camera = FRONT_CAMERA) -> NDArray[np.uint8]:
        """Draw one pose, `(35,)` or that of a scene; the picture is uint8 `(height, width, 3)`."""
        ...

    def close(self) -> None:
        """Free the GL context; a later `render` creates a new one."""
        ...


def check_look(look: str) -> None:
    """Raises ValueError if there is no such look."""
    if look not in get_args(Look):
        raise ValueError(f'Unknown look {look!r}; choose "simulation" or "mannequin".')


def make_renderer(
    look: Look = "simulation",
    width: int = 224,
    height: int = 224,
    preset: Preset = "clip_fast",
    scene: Scene | None = None,
) -> Renderer:
    """A renderer by what it shows.

    Args:
        look: "simulation" shows the shapes that the physics knows, drawn by MuJoCo: what encoders are trained on.
            "mannequin" shows the humanoid in a skin, with physically based shading by pyrender, for people.
        width: pixels.
        height: pixels.
        preset: "clip_fast" or "video"; "clip_fast" has no shadows.
        scene: draws the objects of this scene as well.

    Raises:
        ImportError: pyrender2 or trimesh is not installed.
        RenderingError: this machine has no GL library.
        ValueError: another look or preset, or a size that is not positive.
    """
    check_look(look)
    if look == "simulation":
        return HumanoidRenderer(width, height, preset, scene=scene)
    from anyskill_envs.pyrender_renderer import PyrenderRenderer

    return PyrenderRenderer(width, height, scene, shadows=preset == "video")


class HumanoidRenderer:
    """Draws the humanoid in a pose.

    Presets: "clip_fast" for encoders (no multisampling, shadows, reflections or sky: faster in software),
    "video" for people.

    The GL context is created with the first picture, so that an environment which is never rendered does not pay for it.
    """

    def __init__(
        self,
        width: int = 224,
        height: int = 224,
        preset: Preset = "clip_fast",
        xml: str | Path = HUMANOID_XML,
        scene: Scene | None = None,
    ) -> None:
        """Choose size and preset.

        Args:
            width: pixels.
            height: pixels.
            preset: "clip_fast" or "video".
            xml: the MJCF to draw.
            scene: draws the objects of this scene as well, instead of an MJCF.

        Raises:
            ValueError: an unknown preset, or a size that is not positive.
            RenderingError: this machine has no GL library.
        """
        if preset not in ("clip_fast", "video"):
            raise ValueError(f'Unknown render preset {preset!r}; choose "clip_fast" or "video".')
        if width < 1 or height < 1:
            raise ValueError(f"The picture must have at least one pixel, not {width} x {height}.")
        self.width = int(width)
        self.height = int(height)
        self.preset = preset
        self.backend = choose_backend()
        model = load_model(xml) if scene is None else scene.model
        self.model = copy.deepcopy(model)  # the loaded model is shared, and the preset changes it
        self._object_bodies = [] if scene is None else [part.body for part in scene.parts.values()]
        self.model.vis.global_.offwidth = self.width
        self.model.vis.global_.offheight = self.height
        self.model.vis.quality.offsamples = 4 if preset == "video" else 0
        if preset == "clip_fast":
            self.model.vis.quality.shadowsize = 0
        else:
            self.model.vis.quality.shadowsize = 4096
            self.model.stat.extent = 3.0  # metres that the shadow map covers; less leaves seams on the floor
        self._data = mujoco.MjData(self.model)
        self._context: Any = None
        self._drawing: Any = None
        self._scene: Any = None

    def _start(self) -> None:
        self._context = _create_context(self.backend, self.width, self.height)
        self._drawing = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._drawing)
        self._scene = mujoco.MjvScene(self.model, maxgeom=200)
        fancy = self.preset == "video"
        for flag in (
            mujoco.mjtRndFlag.mjRND_SHADOW,
            mujoco.mjtRndFlag.mjRND_REFLECTION,
            mujoco.mjtRndFlag.mjRND_SKYBOX,
            mujoco.mjtRndFlag.mjRND_HAZE,
        ):
            self._scene.flags[flag] = fancy
        self._option = mujoco.MjvOption()
        self._perturbation = mujoco.MjvPerturb()
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FREE

    def render(self, qpos: NDArray[np.float64], camera: Camera = FRONT_CAMERA) -> NDArray[np.uint8]:
        """Draw one pose.

        Args:
            qpos: root position, root quaternion (w first) and 28 hinge angles, shape (35,); a pose of the scene if there
                is one.
            camera: where the camera stands.

        Returns:
            The picture, uint8 (height, width, 3), a copy of its own.

        Raises:
            ValueError: the pose has another shape.
            RenderingError: the GL context cannot be created.
        """
        qpos = np.asarray(qpos, dtype=np.float64)
        set_pose(self.model, self._data, qpos)
        if self._context is None:
            self._start()
        self._context.make_current()
        mujoco.mj_camlight(self.model, self._data)
        position, target = camera.placed(qpos, self._data.xpos[self._object_bodies])
        ray = target - position
        self._view.lookat[:] = target
        self._view.distance = np.linalg.norm(ray)
        self._view.azimuth = np.degrees(np.arctan2(ray[1], ray[0]))
        self._view.elevation = np.degrees(np.arcsin(ray[2] / max(self._view.distance, 1e-9)))
        mujoco.mjv_updateScene(
            self.model,
            self._data,
            self._option,
            self._perturbation,
            self._view,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        for index in range(self._scene.nlight):  # shadows are drawn around a light: it walks along
            self._scene.lights[index].pos[:2] += qpos[:2].astype(np.float32)
        viewport = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(viewport, self._scene, self._drawing)
        picture = np.empty((self.height, self.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(picture, None, viewport, self._drawing)
        return picture[::-1].copy()  # OpenGL counts rows from below

    def close(self) -> None:
        """Free the GL context; a later `render` creates a new one."""
        if self._context is not None:
            self._context.make_current()
            self._drawing.free()
            self._context.free()
            self._context = self._drawing = self._scene = None

    def __getstate__(self) -> dict[str, Any]:
        """Size, preset and model; a GL context does not travel to another process."""
        state = self.__dict__.copy()
        for name in ("_context", "_drawing", "_scene", "_option", "_perturbation", "_view"):
            state[name] = None
        return state

    def __del__(self) -> None:
        """Free the GL context with the object, while Python is still whole."""
        with contextlib.suppress(Exception):  # at interpreter exit modules may be gone already
            self.close()
