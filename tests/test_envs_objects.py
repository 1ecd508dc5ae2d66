"""Objects beside the humanoid: scenes, placement, what is seen, physics, rewards, and a new object in one file."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from envs_common import arguments, assert_same
from small_models import SmallEncoder

from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.objects import Placement, SceneObject, load_object, object_names, register_object
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_vectors, observation_layout
from anyskill_envs.rendering import SCENE_CAMERA, HumanoidRenderer, set_pose
from anyskill_envs.simulation import HumanoidSimulation
from anyskill_envs.vector import HumanoidVectorEnv
from motion_data.skeleton import heading, load_model, rest_qpos
from rewards.clip import ClipReward

SCENES = {"Soccer": "ball", "Door": "door", "Chair": "chair", "Pillar": "pillar"}


def still_scene(name):
    """The model of a scene whose humanoid is far away, with an object in the middle of its ranges."""
    scene = Scene([name])
    data = mujoco.MjData(scene.model)
    pose = scene.rest_pose.copy()
    pose[:2] = [30.0, 30.0]
    set_pose(scene.model, data, pose)
    return scene.model, data, scene.parts[name]


# Scenes


@pytest.mark.parametrize("name", object_names())
def test_the_humanoid_comes_first_and_is_unchanged(name):
    alone, model = load_model(), Scene([name]).model
    for field in ("body_mass", "body_inertia", "jnt_range", "dof_armature", "dof_damping", "qpos0"):
        expected = getattr(alone, field)
        np.testing.assert_array_equal(getattr(model, field)[: len(expected)], expected)
    np.testing.assert_array_equal(model.actuator_gainprm, alone.actuator_gainprm)
    assert model.opt.timestep == alone.opt.timestep and model.nu == alone.nu


def test_bodies_need_no_names_and_two_objects_never_get_the_same_name():
    nameless = '<body><freejoint/><geom size="0.1"/><body><joint/><geom size="0.1"/></body></body>'
    scene = Scene([SceneObject("cup", nameless), SceneObject("cup", nameless), SceneObject("cup_2", nameless)])
    assert list(scene.parts) == ["cup", "cup_2", "cup_2_2"]
    assert [len(part.angles) for part in scene.parts.values()] == [1, 1, 1]
    assert [part.pose.start for part in scene.parts.values()] == [35, 43, 51]


def test_an_empty_scene_is_the_humanoids_own_model():
    scene = Scene()
    assert scene.model is load_model() and not scene and scene.pose_size == 35
    np.testing.assert_array_equal(scene.rest_pose, rest_qpos())


def test_the_scene_of_an_environment_is_drawn_with_all_that_is_in_it():
    scene = Scene(["door"])
    pictures = [HumanoidRenderer(64, 64, scene=each).render(each.rest_pose, SCENE_CAMERA) for each in (scene, Scene())]
    with_door, without = pictures
    assert np.abs(with_door.astype(int) - without).mean() > 3
    assert np.ptp(with_door) > 100


def test_the_camera_frames_humanoid_and_object():
    pose = rest_qpos()
    near, middle = SCENE_CAMERA.placed(pose, np.array([[1.0, 0.0, 0.1]]))
    far, middle_of_far = SCENE_CAMERA.placed(pose, np.array([[3.0, 0.0, 0.1], [5.0, 0.0, 0.1]]))
    np.testing.assert_allclose([middle[0], middle_of_far[0]], [0.5, 1.5], atol=1e-9)
    assert np.linalg.norm(far - middle_of_far) > np.linalg.norm(near - middle)
    for camera, target, x in ((near, middle, 1.0), (far, middle_of_far, 3.0)):
        towards = (target - camera) / np.linalg.norm(target - camera)
        for point in (pose[:3], np.array([x, 0.0, target[2]])):
            cosine = towards @ (point - camera) / np.linalg.norm(point - camera)
            assert np.degrees(np.arccos(cosine)) < 22.5


def test_objects_compose(controller_file):
    envs = HumanoidLatentVectorEnv(3, objects=["ball", "door", "ball"], controller=controller_file, num_threads=1)
    assert list(envs.scene.parts) == ["ball", "door", "ball_2"]
    observations, infos = envs.reset(seed=0)
    assert observations.shape == (3, 223 + 15 + 7 + 15)
    places = np.stack([envs.simulation.poses[:, part.pose][:, :2] for part in envs.scene.parts.values()])
    assert np.hypot(*(places[0] - places[1]).T).min() > 0.7 and np.hypot(*(places[0] - places[2]).T).min() > 0.3
    observations, *_, infos = envs.step(np.ones((3, 64)))
    assert observations in envs.observation_space
    assert infos["ball_2_distance"].shape == infos["door_angle"].shape == (3,)


# Placement


def test_objects_are_placed_within_their_ranges_around_the_humanoid():
    ranges = {"distance": (0.7, 1.1), "bearing": (0.2, 0.9), "yaw": (-0.3, 0.1)}
    envs = HumanoidVectorEnv(64, objects=["pillar"], placement={"pillar": ranges}, num_threads=1)
    starts = np.tile(rest_qpos(), (64, 1))
    rng = np.random.default_rng(0)
    starts[:, :2] = rng.normal(size=(64, 2))
    half = rng.uniform(-1.5, 1.5, 64)
    starts[:, 3], starts[:, 6] = np.cos(half), np.sin(half)
    envs.reset(seed=0, options={"initial_state": {"qpos": starts}})
    poses = envs.simulation.poses
    offset = poses[:, envs.scene.parts["pillar"].pose][:, :2] - poses[:, :2]
    turned = heading(poses[:, 3:7])
    distance = np.hypot(*offset.T)
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) - turned
    yaw = heading(poses[:, envs.scene.parts["pillar"].pose][:, 3:]) - (turned + bearing + np.pi)
    for values, (low, high) in zip((distance, bearing, yaw), ranges.values(), strict=True):
        values = values if values is distance else (values + np.pi) % (2 * np.pi) - np.pi
        assert low - 1e-9 <= values.min() < values.max() <= high + 1e-9
        assert np.ptp(values) > 0.8 * (high - low)


def test_reset_can_say_where_an_object_stands():
    envs = HumanoidVectorEnv(2, objects=["door"], placement={"door": {"distance": 1.0}}, num_threads=1)
    envs.reset(seed=0, options={"placement": {"door": {"bearing": 0.0, "yaw": 0.0}}})
    door = envs.simulation.poses[:, envs.scene.parts["door"].pose]
    np.testing.assert_allclose(door[:, :3], [[1.0, 0.0, 0.0]] * 2, atol=1e-6)
    # its front (x) looks at the humanoid: half a turn about the vertical
    np.testing.assert_allclose(np.abs(door[:, 3:]), [[0, 0, 0, 1]] * 2, atol=1e-6)
    envs.reset()
    assert np.abs(envs.simulation.poses[0, envs.scene.parts["door"].pose][1]) > 1e-6


# Observation


@pytest.mark.parametrize("scene", SCENES)
def test_seeing_contains_blind_and_blind_is_the_papers_observation(scene, controller_file):
    kwargs = arguments(f"Humanoid{scene}-v0", controller_file)
    seeing, blind = (gym.make(f"Humanoid{scene}-v0", object_observation=sees, **kwargs) for sees in (True, False))
    assert blind.observation_space.shape == (223,)
    first, second = seeing.reset(seed=0)[0], blind.reset(seed=0)[0]
    for _ in range(2):
        np.testing.assert_array_equal(first[:223], second)
        first, second = (env.step(np.ones(64))[0] for env in (seeing, blind))


def test_objects_are_seen_in_the_heading_frame():
    """Turning humanoid and object together about the vertical changes nothing that is seen."""
    envs = HumanoidVectorEnv(2, objects=["ball"], reset_noise_scale=0.0, num_threads=1)
    simulation, part = envs.simulation, envs.scene.parts["ball"]
    turned = rest_qpos()
    turned[:2], turned[3:7] = [4.0, -1.0], [np.cos(0.6), 0, 0, np.sin(0.6)]
    starts = {"initial_state": {"qpos": np.stack([rest_qpos(), turned])}}
    where = {"placement": {"ball": {"distance": 1.5, "bearing": 0.4, "yaw": 0.2}}}
    envs.reset(seed=0, options=starts | where)
    velocity = np.array([1.0, 2.0, 0.5])
    for row, angle in ((0, 0.0), (1, 1.2)):
        cosine, sine = np.cos(angle), np.sin(angle)
        simulation.qvel[row, part.qvel][:2] = [cosine * 1.0 - sine * 2.0, sine * 1.0 + cosine * 2.0]
        simulation.qvel[row, part.qvel][2] = 0.5
    simulation.refresh()
    state = object_vectors(simulation)
    np.testing.assert_allclose(state[0], state[1], atol=1e-5)
    np.testing.assert_allclose(state[0, :2], 1.5 * np.array([np.cos(0.4), np.sin(0.4)]), atol=1e-5)
    np.testing.assert_allclose(state[0, 9:12], velocity, atol=1e-5)


def test_the_layout_names_what_is_seen():
    layout = observation_layout(Scene(["ball", "door"]))
    assert list(layout)[:4] == ["ball.position", "ball.rotation", "ball.linear_velocity", "ball.angular_velocity"]
    assert list(layout)[4:] == ["door.position", "door.facing", "door.angle", "door.angle_velocity"]
    assert layout["door.angle_velocity"].stop == 22


# Physics


def test_the_ball_bounces_as_on_turf():
    model, data, ball = still_scene("ball")
    height = ball.qpos.start + 2
    data.qpos[height] = 2.11
    heights = []
    for _ in range(240):
        mujoco.mj_step(model, data)
        heights.append(data.qpos[height] - 0.11)
    ground = int(np.argmax(np.array(heights) < 0))
    assert 0.5 < max(heights[ground:]) < 1.1
    assert min(heights) > -0.09


def test_the_ball_rolls_and_comes_to_rest():
    model, data, ball = still_scene("ball")
    start = data.qpos[ball.qpos.start].copy()
    data.qvel[ball.qvel.start] = 3.0
    for _ in range(120):
        mujoco.mj_step(model, data)
    spin = np.linalg.norm(data.qvel[ball.qvel][3:])
    assert spin == pytest.approx(data.qvel[ball.qvel.start] / 0.11, rel=0.1)  # it rolls
    for _ in range(120 * 7):
        mujoco.mj_step(model, data)
    assert 4 < data.qpos[ball.qpos.start] - start < 10
    assert np.abs(data.qvel[ball.qvel][:2]).max() < 0.05


def push_leaf(name, newtons, lever=0.0, seconds=1.5):
    """Pushes the leaf at the handle; returns the largest hinge angle in degrees."""
    model, data, part = still_scene(name)
    leaf = model.body(f"{name}/leaf").id
    largest = 0.0
    for _ in range(round(120 * seconds)):
        rotation = data.xmat[leaf].reshape(3, 3)
        data.qfrc_applied[:] = 0
        point, force = data.xpos[leaf] + rotation @ [0, 0.7, 1.0], rotation @ [-newtons, 0, 0]
        mujoco.mj_applyFT(model, data, force, np.zeros(3), point, leaf, data.qfrc_applied)
        if lever:
            data.qfrc_applied[part.angle_velocities[1]] += lever
        mujoco.mj_step(model, data)
        largest = max(largest, float(np.degrees(data.qpos[part.angles[0]])))
    return largest


def test_the_door_opens_one_way_up_to_its_limit():
    assert 100 < push_leaf("door", 40.0) < 120
    assert push_leaf("door", -40.0) < 1


def test_the_latch_holds_until_its_lever_is_pressed():
    assert push_leaf("latched_door", 200.0, seconds=0.5) < 3
    assert push_leaf("latched_door", 40.0, lever=2.0) > 90


@pytest.mark.parametrize("name", ["chair", "pillar", "ball"])
def test_objects_stand_where_they_are_put(name):
    model, data, part = still_scene(name)
    before = data.qpos[part.pose].copy()
    for _ in range(120):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos[part.pose], before, atol=2e-3)


@pytest.mark.parametrize("scene", [["ball"], ["door", "chair"]])
def test_results_depend_neither_on_threads_nor_on_neighbours(scene, controller_file):
    options = {"objects": scene, "controller": controller_file, "record_controller_steps": True}
    one, two = (HumanoidLatentVectorEnv(4, num_threads=threads, **options) for threads in (1, 2))
    assert_same(one.reset(seed=3), two.reset(seed=3))
    alone = HumanoidSimulation(1, scene=one.scene)
    alone.reset(np.array([0]), one.simulation.poses[2:3], one.simulation.qvel[2:3])
    rng = np.random.default_rng(0)
    targets = rng.normal(0, 0.2, (5, 4, 28))
    for _ in range(2):
        actions = rng.uniform(-1, 1, (4, 64))
        assert_same(one.step(actions), two.step(actions))
    together = HumanoidSimulation(4, 2, scene=one.scene)
    one.reset(seed=3)
    together.reset(np.arange(4), one.simulation.poses, one.simulation.qvel)
    for step in targets:
        together.step(step)
        alone.step(step[2:3])
    np.testing.assert_array_equal(together.poses[2], alone.poses[0])


def test_an_object_that_diverges_ends_its_own_episode_only(controller_file):
    envs = HumanoidLatentVectorEnv(3, objects=["ball"], controller=controller_file, num_threads=1)
    envs.reset(seed=0)
    envs.simulation.qvel[1, envs.scene.parts["ball"].qvel] = 1e9
    observations, rewards, terminated, _, infos = envs.step(np.ones((3, 64)))
    assert terminated.tolist() == infos["diverged"].tolist() == [False, True, False]
    assert np.isfinite(observations).all() and rewards[1] == 0


# Rewards


def test_rewards_about_objects_are_recomputed_on_a_stored_rollout(controller_file):
    env = gym.make(
        "HumanoidSoccer-v0", reward="strike", record_controller_steps=True, **arguments("Soccer", controller_file)
    )
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.ones(64))
    assert reward == pytest.approx(info["reward_approach"] + info["reward_strike"])
    assert 0 < info["reward_approach"] < 0.3
    stored = [info[f"controller_{name}"][:, None] for name in ("observations", "qpos", "objects")]
    again = [
        env.unwrapped.vector._reward.of_step(seen, poses, None, objects).total[0]
        for seen, poses, objects in zip(*stored, strict=True)
    ]
    assert np.mean(again) == pytest.approx(reward)


class SeeingEncoder(SmallEncoder):
    """Knows balls."""

    object_sizes = {"ball": 15}

    def encode_state(self, observation, objects=None):
        self.seen = objects
        return super().encode_state(observation)


def test_a_projection_that_knows_objects_is_told_about_them(controller_file):
    encoder = SeeingEncoder()
    kwargs = arguments("Soccer", controller_file) | {"encoder": encoder, "objects": ["door", "ball"]}
    envs = gym.make_vec("HumanoidSoccer-v0", num_envs=2, **kwargs)
    envs.reset(seed=0)
    envs.step(np.ones((2, 64)))
    assert isinstance(envs.unwrapped.reward, ClipReward)
    assert {name: vector.shape for name, vector in encoder.seen.items()} == {"door": (2, 17), "ball": (2, 15)}


# Bad input


BODY = '<body name="{}"><freejoint/><geom size="0.1"/></body>'


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"objects": ["bal"]}, "Unknown object 'bal'.*ball, chair, door, latched_door, pillar"),
        ({"objects": "ball"}, r"list of names, such as \['ball'\]"),
        ({"objects": ["ball"], "placement": {"door": {"distance": 1}}}, "no 'door' in the scene.*ball"),
        ({"objects": ["ball"], "placement": {"ball": {"size": 1}}}, "Unknown placement 'size'.*distance, bearing, yaw"),
        ({"objects": ["ball"], "placement": {"ball": {"distance": (2, 1)}}}, "rising order"),
        ({"objects": ["ball"], "placement": {"ball": {"distance": -1}}}, "from 0 m on"),
        ({"objects": ["ball"], "placement": {"ball": {"yaw": np.nan}}}, "finite"),
        (
            {
                "objects": ["ball", "pillar"],
                "placement": {name: {"distance": 1, "bearing": 0} for name in ("ball", "pillar")},
            },
            "ball, pillar find no room beside each other",
        ),
        ({"objects": [SceneObject("cup", "<body>")]}, "does not understand the MJCF of the object 'cup'"),
        ({"objects": [SceneObject("cup", BODY.format("a") + BODY.format("b"))]}, "one body in its world.*not 2 bodies"),
        ({"objects": [SceneObject("cup", BODY.format("a").replace("freejoint", "joint"))]}, "freejoint, or no joint"),
    ],
)
def test_bad_scenes_are_refused_when_they_are_made(kwargs, message):
    with pytest.raises(ValueError, match=message):
        HumanoidVectorEnv(1, **kwargs)


def test_bad_objects_are_refused():
    with pytest.raises(ValueError, match="lower-case word"):
        SceneObject("My cup", "")
    with pytest.raises(ValueError, match="Unknown relation 'eating'.*sitting on"):
        SceneObject("cup", "", captions={"eating": ("a person eats a cup",)})
    with pytest.raises(ValueError, match="cannot show 'colour'"):
        SceneObject("cup", "", observed=("colour",))
    with pytest.raises(ValueError, match="exists already"):
        register_object(load_object("ball"))


def test_a_reward_about_an_object_needs_one(controller_file):
    kwargs = arguments("HumanoidText-v0", controller_file)
    with pytest.raises(ValueError, match="HumanoidSoccer-v0"):
        gym.make("HumanoidText-v0", reward="strike", **kwargs)
    with pytest.raises(ValueError, match="hinge.*HumanoidDoor-v0"):
        gym.make("HumanoidSoccer-v0", reward="open", **kwargs)
    both = {"objects": ["ball", "door"], "reward": "open", **kwargs}
    with pytest.raises(ValueError, match="hinge of an object, but ball "):
        gym.make("HumanoidSoccer-v0", reward_kwargs={"object": "ball"}, **both)
    with pytest.raises(ValueError, match="'gate', but the objects of the scene are: ball, door"):
        gym.make("HumanoidSoccer-v0", reward_kwargs={"object": "gate"}, **both)
    with pytest.raises(ValueError, match="hinge of an object, but ball "):
        in_a_sum = {"reward": {"strike": 0.5, "open": 0.5}, "reward_kwargs": {"open": {"object": "ball"}}}
        gym.make("HumanoidSoccer-v0", **both | in_a_sum)
    env = gym.make("HumanoidSoccer-v0", **both)  # the first object with a hinge counts
    env.reset(seed=0)
    assert "reward_open" in env.step(np.zeros(64, np.float32))[4]
    env.close()


# A new object is one constant


def test_a_new_object_needs_only_its_mjcf_and_its_place(controller_file):
    crate = SceneObject(
        name="crate",
        mjcf='<body name="crate" pos="0 0 0.2"><freejoint/><geom type="box" size="0.2 0.2 0.2" mass="6"/></body>',
        placement=Placement(distance=(1.0, 1.5)),
        texts=("push the crate",),
        captions={"touching": ("a person touches the crate",)},
        observed=("position", "rotation"),
    )
    if "crate" not in object_names():
        register_object(crate)
    envs = gym.make_vec(
        "HumanoidText-v0", num_envs=2, objects=["crate"], reward="approach", **arguments("", controller_file)
    )
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (2, 223 + 9)
    for _ in range(2):
        observations, rewards, *_, infos = envs.step(np.ones((2, 64)))
    assert observations in envs.observation_space and (rewards > 0).all()
    assert (np.abs(infos["crate_distance"] - 1.25) < 0.5).all()
