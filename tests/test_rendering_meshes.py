"""Meshes of the humanoid and pyrender's pictures of them, against the shapes of the physics and MuJoCo's pictures."""

import importlib.util
import io
import sys

import numpy as np
import pytest

from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import Camera, RenderingError, make_renderer
from motion_data.skeleton import load_model, rest_qpos

trimesh = pytest.importorskip("trimesh")

from anyskill_envs.agent_mesh import agent_mesh, body_meshes, geom_mesh  # noqa: E402
from anyskill_envs.pyrender_renderer import PyrenderRenderer  # noqa: E402

CAMERA = Camera(position=(2.35, -1.5, 1.3), follow="position", look_at_height=1.0)


def test_shapes_have_the_volumes_of_the_physics():
    model = load_model()
    radius, half = model.geom("right_thigh").size[:2]
    expected = {
        "head": 4 / 3 * np.pi * model.geom("head").size[0] ** 3,
        "right_thigh": np.pi * radius**2 * (2 * half + 4 / 3 * radius),
        "right_foot": 8 * np.prod(model.geom("right_foot").size),
    }
    for name, volume in expected.items():
        mesh = geom_mesh(model, model.geom(name).id)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(volume, rel=0.03)
        np.testing.assert_allclose(mesh.center_mass, model.geom(name).pos, atol=1e-3)
    assert geom_mesh(model, model.geom("floor").id) is None


def test_the_mannequin_has_a_closed_skin_around_the_shapes_and_keeps_its_marks():
    skins, shapes = body_meshes(look="mannequin"), body_meshes(look="simulation")
    model = load_model()
    thigh = model.body("left_thigh").id
    (skin,) = (mesh for body, mesh in skins if body == thigh)
    (shape,) = (mesh for body, mesh in shapes if body == thigh)
    assert skin.is_watertight and skin.volume > shape.volume
    assert (skin.bounds[0] < shape.bounds[0] + 0.01).all() and (skin.bounds[1] > shape.bounds[1] - 0.01).all()
    assert skin.bounds[0, 2] < -0.42  # it reaches beyond the knee
    np.testing.assert_array_equal(skin.visual.vertex_colors[0], shape.visual.vertex_colors[0])
    for marked in ("head", "torso"):  # visor and chest plate
        assert sum(body == model.body(marked).id for body, _ in skins) == 2
    assert {body for body, _ in skins} == set(range(1, 16))
    with pytest.raises(ValueError, match="mannequin"):
        body_meshes(look="zombie")


def test_a_pose_can_be_exported():
    scene = agent_mesh(rest_qpos())
    assert scene.bounds[0, 2] == pytest.approx(0, abs=0.02) and 1.55 < scene.bounds[1, 2] < 1.75
    read = trimesh.load(io.BytesIO(scene.export(file_type="glb")), file_type="glb")
    np.testing.assert_allclose(read.bounds, scene.bounds, atol=1e-4)


def test_errors_name_the_fix(monkeypatch):
    with pytest.raises(ValueError, match='"simulation" or "mannequin"'):
        make_renderer("blender")
    monkeypatch.setitem(sys.modules, "pyrender", None)
    with pytest.raises((ImportError, RenderingError), match=r"anyskill-envs\[mesh\]|MUJOCO_GL"):
        make_renderer("mannequin")


def drawn(look, scene=None):
    """A renderer that has drawn once; skips where this machine cannot."""
    if importlib.util.find_spec("pyrender") is None:
        pytest.skip("pyrender2 is not installed")
    try:
        renderer = make_renderer(look, 160, 160, "clip_fast", scene)
        renderer.render(rest_qpos() if scene is None else scene.rest_pose)
    except RenderingError as error:
        pytest.skip(str(error))
    return renderer


def centre(picture, stronger, weaker):
    """Row and column of the mean of the pixels in which one colour is much stronger than another."""
    mask = picture[..., stronger].astype(int) - picture[..., weaker] > 60
    assert mask.sum() > 100
    return np.argwhere(mask).mean(0)


def test_both_engines_draw_the_same_pose_at_the_same_place():
    drawn("mannequin").close()
    # the same shapes, for a mannequin's shoulders have another colour
    simulation, mesh = drawn("simulation"), PyrenderRenderer(160, 160, look="simulation", shadows=False)
    qpos = rest_qpos()
    qpos[:2] = 7.3, -4.1
    qpos[3:7] = np.cos(0.4), 0, 0, np.sin(0.4)
    qpos[7:] = np.random.default_rng(0).uniform(-0.4, 0.4, 28)
    first, second = simulation.render(qpos, CAMERA), mesh.render(qpos, CAMERA)
    assert first.shape == second.shape == (160, 160, 3) and second.dtype == np.uint8
    for stronger, weaker in ((0, 2), (2, 0)):  # orange limbs are right, blue ones left
        np.testing.assert_allclose(centre(first, stronger, weaker), centre(second, stronger, weaker), atol=3)
    # Closing one must leave the other its display, and what was closed can draw again.
    mesh.close()
    np.testing.assert_allclose(simulation.render(qpos, CAMERA).astype(int), first, atol=2)
    np.testing.assert_allclose(mesh.render(qpos, CAMERA).astype(int), second, atol=2)
    with pytest.raises(ValueError, match="shape"):
        mesh.render(qpos[:-1])
    mesh.close()
    simulation.close()


def test_objects_are_drawn_as_well():
    scene = Scene(["pillar"])
    pose = scene.rest_pose
    alone, together = drawn("mannequin"), drawn("mannequin", scene)
    camera = Camera(position=(0.5, -6.0, 1.5), follow="world")
    changed = np.abs(alone.render(pose[:35], camera).astype(int) - together.render(pose, camera)).max(-1) > 40
    assert changed.sum() > 300
    alone.close()
    together.close()


def test_a_video_shows_both_beside_each_other(tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    from agents.text.video import write_video

    drawn("mannequin").close()
    write_video(tmp_path / "film.mp4", np.tile(rest_qpos(), (3, 1)), ["stand"], look="beside")
    frames = imageio_ffmpeg.read_frames(str(tmp_path / "film.mp4"))
    assert next(frames)["size"] == (854, 480)
    picture = np.frombuffer(next(frames), np.uint8).reshape(480, 854, 3)
    left, right = picture[:430, :427], picture[:430, 427:]
    np.testing.assert_allclose(centre(left, 2, 0), centre(right, 2, 0), atol=25)
    assert np.abs(left.astype(int) - right).mean() > 2
