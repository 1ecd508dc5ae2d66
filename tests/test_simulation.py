"""The batched simulation, the observation and the body."""

import mujoco
import numpy as np
import pytest

from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_LAYOUT, OBSERVATION_SIZE
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.skeleton import HUMANOID_XML, JOINT_NAMES, joint_limits, mirror_qpos, rest_qpos


def random_states(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    limits = joint_limits()
    qpos = np.tile(rest_qpos(), (count, 1))
    qpos[:, 2] += 0.3
    qpos[:, 3:7] = rng.normal(size=(count, 4))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    qpos[:, 7:] = rng.uniform(0.5 * limits[:, 0], 0.5 * limits[:, 1], (count, 28))
    return qpos, rng.normal(size=(count, 34))


def test_body_has_the_papers_structure() -> None:
    model = HumanoidSimulation(1).model
    assert model.nbody - 1 == 15
    assert model.nu == 28
    assert model.opt.timestep == pytest.approx(1 / 120)
    assert 40 < model.body_mass.sum() < 80


@pytest.mark.parametrize("joint", JOINT_NAMES)
def test_every_joint_reaches_its_limits(joint: str) -> None:
    """Position actuators can inherit a control range that clamps targets to 1 rad, unnoticed."""
    model = mujoco.MjModel.from_xml_path(str(HUMANOID_XML))
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    index = JOINT_NAMES.index(joint)
    for limit in joint_limits()[index]:
        mujoco.mj_resetData(model, data)
        data.qpos[2] = 3.0
        for step in range(360):
            data.ctrl[index] = limit * min(1.0, step / 240)
            mujoco.mj_step(model, data)
        assert data.qpos[7 + index] == pytest.approx(limit, abs=0.1)


def test_observation_layout_adds_up() -> None:
    assert OBSERVATION_SIZE == 223
    assert [place.stop - place.start for place in OBSERVATION_LAYOUT.values()] == [1, 42, 90, 45, 45]


def test_observation_does_not_depend_on_place_or_heading() -> None:
    simulation = HumanoidSimulation(2)
    qpos, qvel = random_states(1)
    turned = qpos.copy()
    turned[0, :2] += [3.0, -2.0]
    turn = np.array([np.cos(0.6), 0, 0, np.sin(0.6)])
    mujoco.mju_mulQuat(turned[0, 3:7], turn, qpos[0, 3:7])
    velocity = qvel.copy()
    mujoco.mju_rotVecQuat(velocity[0, :3], qvel[0, :3].copy(), turn)
    simulation.reset(np.arange(2), np.concatenate([qpos, turned]), np.concatenate([qvel, velocity]))
    first, second = simulation.observation()
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_mirrored_state_gives_mirrored_observation() -> None:
    simulation = HumanoidSimulation(2)
    qpos, _ = random_states(1)
    qvel = np.zeros((1, 34))
    qvel[0, :3] = [0.4, 0.7, -0.2]
    mirrored = qvel * np.where(np.arange(34) == 1, -1, 1)
    simulation.reset(np.arange(2), np.concatenate([qpos, mirror_qpos(qpos)]), np.concatenate([qvel, mirrored]))
    first, second = simulation.observation()
    np.testing.assert_allclose(first[MIRROR_INDEX] * MIRROR_SIGN, second, atol=1e-5)


def test_velocities_match_finite_differences() -> None:
    simulation = HumanoidSimulation(1)
    qpos, qvel = random_states(1)
    simulation.reset(np.array([0]), qpos, qvel)
    linear = simulation.body_linear_velocities[0].copy()
    before = simulation.body_positions[0].copy()
    moved = qpos.copy()
    mujoco.mj_integratePos(simulation.model, moved[0], qvel[0], 1e-6)
    simulation.reset(np.array([0]), moved, qvel)
    np.testing.assert_allclose((simulation.body_positions[0] - before) / 1e-6, linear, atol=1e-3)


def test_results_do_not_depend_on_threads_or_neighbours() -> None:
    rng = np.random.default_rng(0)
    qpos, qvel = random_states(8)
    actions = rng.normal(0, 0.3, (10, 8, 28))
    finals = []
    for threads, chosen in ((1, np.arange(8)), (2, np.arange(8)), (1, np.array([3]))):
        simulation = HumanoidSimulation(len(chosen), threads)
        simulation.reset(np.arange(len(chosen)), qpos[chosen], qvel[chosen])
        for action in actions:
            simulation.step(action[chosen])
        finals.append(simulation.qpos.copy())
    np.testing.assert_array_equal(finals[0], finals[1])
    np.testing.assert_array_equal(finals[0][3:4], finals[2])


@pytest.mark.parametrize("fault", ["position", "velocity", "target"])
def test_one_diverging_humanoid_is_reset_and_reported_alone(fault: str) -> None:
    simulation, control = HumanoidSimulation(3), HumanoidSimulation(3)
    targets = np.zeros((3, 28))
    if fault == "position":
        simulation.qpos[1, 7] = np.nan
    elif fault == "velocity":
        simulation.qvel[1, 0] = 1e12
    else:
        targets[1, 4] = np.nan
    diverged = simulation.step(targets)
    control.step(np.zeros((3, 28)))
    assert diverged.tolist() == [False, True, False]
    np.testing.assert_array_equal(simulation.qpos[1], rest_qpos())
    np.testing.assert_array_equal(simulation.qpos[[0, 2]], control.qpos[[0, 2]])
    assert not simulation.step(np.zeros((3, 28))).any()


def test_inactive_humanoids_keep_their_state() -> None:
    simulation = HumanoidSimulation(2)
    before = simulation.qpos.copy()
    simulation.step(np.full((2, 28), 0.5), active=np.array([True, False]))
    assert np.abs(simulation.qpos[0] - before[0]).max() > 1e-3
    np.testing.assert_array_equal(simulation.qpos[1], before[1])


@pytest.mark.parametrize(("arguments", "message"), [((0,), "num_humanoids"), ((1, -1), "num_threads")])
def test_bad_arguments_are_refused(arguments: tuple[int, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HumanoidSimulation(*arguments)
