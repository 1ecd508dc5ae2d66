"""The renderer, and the image tower on what it draws."""

import numpy as np
import pytest

from anyskill_envs import rendering
from anyskill_envs.rendering import Camera, HumanoidRenderer, RenderingError
from motion_data.authored import authored_clips
from motion_data.skeleton import rest_qpos
from rewards.bundled import BundledEncoder


@pytest.fixture(scope="module")
def renderer():
    renderer = HumanoidRenderer(96, 96)
    yield renderer
    renderer.close()


def test_pictures_are_copies_of_the_right_size():
    renderer = HumanoidRenderer(80, 60)
    first = renderer.render(rest_qpos())
    assert first.shape == (60, 80, 3) and first.dtype == np.uint8
    before = first.copy()
    moved = rest_qpos()
    moved[7:] = 0.5
    second = renderer.render(moved)
    np.testing.assert_array_equal(first, before)
    assert not np.array_equal(first, second)
    renderer.close()
    np.testing.assert_array_equal(renderer.render(rest_qpos()), first)


def test_the_context_is_created_with_the_first_picture():
    renderer = HumanoidRenderer(32, 32)
    assert renderer._context is None
    renderer.render(rest_qpos())
    assert renderer._context is not None
    renderer.close()


def test_the_camera_walks_around_with_the_heading(renderer):
    turned = rest_qpos()
    turned[:2] = [4.0, -2.0]
    turned[3:7] = [np.cos(0.6), 0, 0, np.sin(0.6)]
    position, target = Camera().placed(turned)
    np.testing.assert_allclose(target, [4.0, -2.0, 0.905])
    np.testing.assert_allclose(position, [4 + 3 * np.cos(1.2), -2 + 3 * np.sin(1.2), 1.0])
    fixed, _ = Camera(follow="world").placed(turned)
    np.testing.assert_allclose(fixed, [3.0, 0.0, 1.0])


def test_the_left_arm_is_on_the_right_of_the_picture(renderer):
    """Left limbs are blue; seen from the front they stand on the viewer's right."""
    picture = renderer.render(rest_qpos()).astype(int)
    blue = (picture[..., 2] - picture[..., 0]) > 60
    assert blue.sum() > 20
    assert np.nonzero(blue)[1].mean() > 48


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="clip_fast"):
        HumanoidRenderer(preset="beautiful")
    with pytest.raises(ValueError, match="at least one pixel"):
        HumanoidRenderer(0, 10)
    with pytest.raises(ValueError, match="heading"):
        Camera(follow="behind")
    with pytest.raises(ValueError, match="shape"):
        HumanoidRenderer(8, 8).render(np.zeros(34))


def test_no_gl_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(rendering, "_loadable", lambda files: False)
    monkeypatch.setattr(rendering.platform, "system", lambda: "Linux")
    for variable in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(RenderingError, match=r"libegl1.*MUJOCO_GL"):
        HumanoidRenderer()
    monkeypatch.setenv("MUJOCO_GL", "egl")
    with pytest.raises(RenderingError, match="libegl1"):
        HumanoidRenderer()
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(RenderingError, match="switches rendering off"):
        HumanoidRenderer()
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    with pytest.raises(RenderingError, match="vulkan"):
        HumanoidRenderer()


def test_image_tower_tells_clips_apart():
    encoder = BundledEncoder(cache="")
    clips = {clip.name: clip for clip in authored_clips()}
    texts = {
        "raise_both_arms": "raise both arms above the head",
        "squat_hold": "squat down",
        "t_pose": "stretch both arms out to the sides",
        "raise_right_arm": "raise the right arm",
        "raise_left_arm": "raise the left arm",
    }
    renderer = HumanoidRenderer()
    pictures = []
    for name in texts:
        qpos = clips[name].qpos
        pictures.append(renderer.render(qpos[len(qpos) // 2]))
    renderer.close()
    features = encoder.encode_image(np.stack(pictures))
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1.0, atol=1e-5)
    similarity = features @ encoder.encode_text(list(texts.values())).T
    np.testing.assert_array_equal(similarity.argmax(1), np.arange(len(texts)))
    film = np.repeat(np.stack(pictures)[:, None], 6, 1)
    np.testing.assert_allclose(encoder.encode_image(film), features, atol=1e-5)
