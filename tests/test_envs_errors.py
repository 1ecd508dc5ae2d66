"""Bad input ends in one clear error, when the environment is made."""

import ctypes
import shutil
import sys

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from envs_common import arguments
from small_models import write_controller

from anyskill_envs import rendering
from anyskill_envs.controller import ContractError
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.rendering import RenderingError
from anyskill_envs.text import HumanoidTextVectorEnv
from anyskill_envs.vector import HumanoidVectorEnv


def make_text(controller_file, **kwargs):
    return gym.make("HumanoidText-v0", **arguments("HumanoidText-v0", controller_file) | kwargs)


@pytest.mark.parametrize("text", ["", "   ", [], [""], None])
def test_empty_text(controller_file, text):
    with pytest.raises((ValueError, TypeError), match="text"):
        make_text(controller_file, text=text)


def test_one_text_too_many(controller_file):
    with pytest.raises(ValueError, match="one for each of the 2 humanoids; got 3"):
        HumanoidTextVectorEnv(2, text=["squat"] * 3, controller=controller_file, encoder="small")


def test_unknown_reward_lists_those_that_exist(controller_file):
    with pytest.raises(ValueError, match="Unknown reward 'clipp'.*clip"):
        make_text(controller_file, reward="clipp")


def test_unknown_encoder_lists_those_that_exist(controller_file):
    with pytest.raises(ValueError, match="Unknown encoder 'large'.*bundled"):
        make_text(controller_file, encoder="large")


def test_unknown_reward_argument_is_named(controller_file):
    with pytest.raises(TypeError, match="weigth"):
        make_text(controller_file, reward_kwargs={"weigth": 1})


@pytest.mark.parametrize("environment_id", ["HumanoidLatent-v0", "HumanoidText-v0"])
class TestControllerFile:
    def make(self, environment_id, path):
        return gym.make(environment_id, **arguments(environment_id, path))

    def test_missing(self, environment_id, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.onnx.*anyskill controller train"):
            self.make(environment_id, tmp_path / "nowhere.onnx")

    def test_corrupt(self, environment_id, controller_file, tmp_path):
        broken = tmp_path / "broken.onnx"
        broken.write_bytes(controller_file.read_bytes()[:1000])
        with pytest.raises(ContractError, match=r"broken\.onnx.*not a readable ONNX file"):
            self.make(environment_id, broken)

    def test_wrong_latent_size(self, environment_id, tmp_path):
        with pytest.raises(ContractError, match="latent_size is 32, expected 64"):
            self.make(environment_id, write_controller(tmp_path, latent_size="32"))

    def test_another_body(self, environment_id, tmp_path):
        with pytest.raises(ContractError, match="model_xml_sha256 is 0000"):
            self.make(environment_id, write_controller(tmp_path, model_xml_sha256="0000"))

    def test_another_kind_of_model(self, environment_id, tmp_path):
        with pytest.raises(ContractError, match="kind is motion_encoder, expected low_level_controller"):
            self.make(environment_id, write_controller(tmp_path, kind="motion_encoder"))

    def test_without_its_latents(self, environment_id, controller_file, tmp_path):
        lonely = shutil.copy(controller_file, tmp_path / "llc.onnx")
        with pytest.raises(FileNotFoundError, match=r"latents\.npz"):
            self.make(environment_id, lonely)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"num_envs": 0}, "num_envs must be at least 1"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1"),
        ({"num_threads": -1}, "num_threads must be 0"),
        ({"autoreset_mode": "Never"}, "'NextStep', 'SameStep', 'Disabled'"),
        ({"initial_state": "flying"}, "standing, library"),
        ({"reset_noise_scale": np.nan}, "reset_noise_scale"),
        ({"render_mode": "ascii"}, "render_mode"),
        ({"render_mode": "rgb_array", "width": 0}, "pixel"),
        ({"render_mode": "rgb_array", "camera": {"follow": "nobody"}}, "heading"),
    ],
)
def test_arguments_out_of_range(kwargs, message):
    with pytest.raises(ValueError, match=message):
        HumanoidVectorEnv(**kwargs)


def test_misspelt_argument_is_named(controller_file):
    with pytest.raises(TypeError, match="num_treads"):
        gym.make("HumanoidLatent-v0", controller=str(controller_file), num_treads=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"initial_stat": "standing"},
            "Unknown reset option 'initial_stat'.*reset_mask, initial_state, placement, text",
        ),
        ({"initial_state": "flying"}, "standing, library"),
        ({"initial_state": {"qpos": np.zeros(7)}}, r"qpos.*shape \(35,\)"),
        ({"initial_state": {"qvel": np.zeros(34)}}, "qpos"),
        ({"initial_state": {"qpos": np.full(35, np.nan)}}, "finite"),
        ({"reset_mask": np.zeros(2, bool)}, "at least one True"),
        ({"reset_mask": np.ones(3, bool)}, r"shape \(2,\)"),
        ({"text": ""}, "text is empty"),
    ],
)
def test_reset_options(controller_file, options, message):
    envs = HumanoidTextVectorEnv(2, controller=controller_file, encoder="small", num_threads=1)
    with pytest.raises(ValueError, match=message):
        envs.reset(options=options)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros((2, 28)), r"\(num_envs, 64\), got \(2, 28\)"),
        (np.zeros((3, 64)), "Expected 2 actions"),
        (np.zeros(64), "Expected 2 actions"),
        (0.0, "Expected 2 actions"),
        (np.full((2, 64), np.nan), "NaN"),
    ],
)
def test_actions(controller_file, actions, message):
    envs = HumanoidLatentVectorEnv(2, controller=controller_file, num_threads=1)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.step(actions)


# Pictures


def without_libraries(monkeypatch):
    def refuse(name, *args, **kwargs):
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.skipif(sys.platform != "linux", reason="the libraries have these names on Linux")
def test_no_gl_library(controller_file, monkeypatch):
    without_libraries(monkeypatch)
    with pytest.raises(RenderingError, match="apt-get install"):
        HumanoidVectorEnv(1, render_mode="rgb_array")
    with pytest.raises(RenderingError, match="apt-get install"):
        make_text(controller_file, reward_kwargs={"source": "frames"})
    HumanoidVectorEnv(1).close()  # who wants no pictures needs no library


def test_rendering_switched_off(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    with pytest.raises(RenderingError, match="unset it"):
        gym.make("HumanoidJoints-v0", render_mode="rgb_array")


def test_a_context_that_fails_says_what_to_install(monkeypatch):
    env = gym.make("HumanoidJoints-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.unwrapped.vector._renderer.backend = "osmesa"

    def fail(name):
        raise ImportError("no such GL platform")

    monkeypatch.setattr(rendering.importlib, "import_module", fail)
    with pytest.raises(RenderingError, match="osmesa.*no such GL platform.*apt-get install"):
        env.render()
    env.close()


def test_no_gl_context_before_the_first_picture(monkeypatch):
    created = []
    monkeypatch.setattr(rendering, "_create_context", lambda *args: created.append(args))
    env = gym.make("HumanoidJoints-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
    assert not created


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is a screen")
def test_no_screen(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderingError, match="rgb_array"):
        gym.make("HumanoidJoints-v0", render_mode="human")


class Window:
    """Stands in for MuJoCo's window where there is no screen."""

    def __init__(self, model, data):
        self.data, self.heights, self.running = data, [], True
        self.cam, self.user_scn = mujoco.MjvCamera(), mujoco.MjvScene(model, 100)

    def is_running(self):
        return self.running

    def lock(self):
        import contextlib

        return contextlib.nullcontext()

    def sync(self):
        self.heights.append(float(self.data.qpos[2]))

    def close(self):
        self.running = False


def test_the_window_shows_every_controller_step(monkeypatch, controller_file):
    import mujoco.viewer

    windows = []

    def launch(model, data, **kwargs):
        windows.append(Window(model, data))
        return windows[-1]

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    env = gym.make("HumanoidLatent-v0", render_mode="human", controller=str(controller_file))
    env.reset(seed=0)
    assert not windows  # it opens with the first pose
    env.step(np.ones(64))
    assert len(windows) == 1 and len(windows[0].heights) == 5
    assert env.render() is None
    assert windows[0].heights[-1] == env.unwrapped.vector.simulation.qpos[0, 2]
    windows[0].running = False  # the user closed it: the environment goes on
    env.step(np.ones(64))
    env.close()
