"""The bodies of a scene as triangle meshes: to be drawn by any renderer, or exported.

Needs trimesh: `pip install "anyskill-envs[mesh]"`.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from anyskill_envs.rendering import Look, check_look, set_pose
from motion_data.skeleton import BODY_NAMES, load_model

if TYPE_CHECKING:
    import trimesh

_SKIN_STEP = 0.025
"""Longest edge of the mannequin's skin in metres."""
_SMOOTHING_ROUNDS = 12
_JOINT_SHARE = 0.92
"""Radius of a joint as a share of that of the thinner limb beside it."""
_NECK_RADIUS = 0.052


def body_meshes(model: mujoco.MjModel | None = None, look: Look = "mannequin") -> list[tuple[int, trimesh.Trimesh]]:
    """Meshes of the bodies in their own frames, in metres, coloured.

    Args:
        model: The scene; the humanoid alone if None. Floors (planes) have no mesh.
        look: "simulation" gives the very shapes that the physics knows. "mannequin" gives the humanoid a skin instead, one
            for each body: the hull of its shapes and its joints, smoothed, so that limbs meet where they bend. Other bodies
            keep their shapes.

    Returns:
        Number of the body, and a mesh of it; a body has several where colours differ.

    Raises:
        ImportError: trimesh is not installed.
        ValueError: Another look.
    """
    check_look(look)
    model = load_model() if model is None else model
    found = []
    humanoid = {model.body(name).id for name in BODY_NAMES}
    for body in range(model.nbody):
        geoms = np.flatnonzero(model.geom_bodyid == body).tolist()
        skinned: list[int] = []
        if look == "mannequin" and body in humanoid:
            # Markers such as the visor touch nothing: they stay on top of the skin.
            skinned = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom]]
            found.append((body, _skin(model, body, skinned)))
        for geom in geoms:
            mesh = None if geom in skinned else geom_mesh(model, geom)
            if mesh is not None:
                found.append((body, mesh))
    return found


def agent_mesh(qpos: NDArray[np.float64], look: Look = "mannequin") -> trimesh.Scene:
    """The humanoid in a pose as a scene of trimesh, which exports it: `agent_mesh(qpos).export("agent.glb")`.

    Args:
        qpos: The pose, `(35,)`.
        look: See :func:`body_meshes`.

    Raises:
        ImportError: trimesh is not installed.
        ValueError: The pose has another shape, or another look.
    """
    trimesh = _trimesh()
    model = load_model()
    data = mujoco.MjData(model)
    set_pose(model, data, np.asarray(qpos, dtype=np.float64))
    scene = trimesh.Scene()
    for number, (body, mesh) in enumerate(body_meshes(model, look)):
        scene.add_geometry(mesh, node_name=f"{model.body(body).name}_{number}", transform=body_transform(data, body))
    return scene


def body_transform(data: mujoco.MjData, body: int) -> NDArray[np.float64]:
    """Where a body is, as a matrix `(4, 4)`."""
    transform = np.eye(4)
    transform[:3, :3] = data.xmat[body].reshape(3, 3)
    transform[:3, 3] = data.xpos[body]
    return transform


def geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """The shape of one geom in the frame of its body; None for a plane, or a shape of no size."""
    trimesh = _trimesh()
    size = model.geom_size[geom]
    kinds = mujoco.mjtGeom
    kind = model.geom_type[geom]
    if kind == kinds.mjGEOM_SPHERE:
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    elif kind == kinds.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=[24, 24])
        mesh.apply_translation(-mesh.bounds.mean(0))
    elif kind == kinds.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=32)
    elif kind == kinds.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * size)
    elif kind == kinds.mjGEOM_ELLIPSOID:
        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_scale(size)
    elif kind == kinds.mjGEOM_MESH:
        number = model.geom_dataid[geom]
        vertices = slice(model.mesh_vertadr[number], model.mesh_vertadr[number] + model.mesh_vertnum[number])
        faces = slice(model.mesh_faceadr[number], model.mesh_faceadr[number] + model.mesh_facenum[number])
        mesh = trimesh.Trimesh(model.mesh_vert[vertices], model.mesh_face[faces])
    else:
        return None
    place = np.eye(4)
    place[:3, :3] = Rotation.from_quat(model.geom_quat[geom], scalar_first=True).as_matrix()
    place[:3, 3] = model.geom_pos[geom]
    mesh.apply_transform(place)
    mesh.visual.vertex_colors = _colour(model, geom)
    return mesh


def _colour(model: mujoco.MjModel, geom: int) -> NDArray[np.uint8]:
    material = model.geom_matid[geom]
    colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return np.round(255 * np.asarray(colour)).astype(np.uint8)


def _skin(model: mujoco.MjModel, body: int, geoms: list[int]) -> trimesh.Trimesh:
    """Smooth hull of a body's shapes and of the joints that it shares with its neighbours."""
    trimesh = _trimesh()
    parts = [mesh for geom in geoms if (mesh := geom_mesh(model, geom)) is not None]
    for neighbour, place in _joints(model, body):
        radius = _JOINT_SHARE * min(_thickness(model, body), _thickness(model, neighbour))
        if "head" in (model.body(body).name, model.body(neighbour).name):
            radius = _NECK_RADIUS
        joint = trimesh.creation.icosphere(subdivisions=2, radius=radius)
        joint.apply_translation(place)
        parts.append(joint)
    hull = trimesh.util.concatenate(parts).convex_hull.subdivide_to_size(_SKIN_STEP)
    trimesh.smoothing.filter_taubin(hull, iterations=_SMOOTHING_ROUNDS)
    hull.visual.vertex_colors = _colour(model, geoms[0])
    return hull


def _joints(model: mujoco.MjModel, body: int) -> list[tuple[int, NDArray[np.float64]]]:
    """Neighbours of a body of the humanoid, and where they meet in its frame."""
    humanoid = {model.body(name).id for name in BODY_NAMES}
    joints = [(child, model.body_pos[child]) for child in humanoid if model.body_parentid[child] == body]
    parent = int(model.body_parentid[body])
    return joints + ([(parent, np.zeros(3))] if parent in humanoid else [])


def _thickness(model: mujoco.MjModel, body: int) -> float:
    """Radius of the thinnest solid shape of a body in metres."""
    geoms = [geom for geom in np.flatnonzero(model.geom_bodyid == body) if model.geom_conaffinity[geom]]
    boxes = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_BOX
    return float(np.where(boxes, model.geom_size[geoms].min(1), model.geom_size[geoms, 0]).min())


def _trimesh() -> ModuleType:
    try:
        import trimesh
        import trimesh.smoothing
    except ImportError as error:
        raise ImportError(f'Meshes need {error.name}: pip install "anyskill-envs[mesh]".') from error
    return trimesh
