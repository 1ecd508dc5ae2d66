"""Scenes for the encoder: relations to objects, the state tower's second input and its mirror image."""

import numpy as np

from agents.encoder.concepts import CONCEPTS
from agents.encoder.dataset import generate, join_sets
from agents.encoder.measurements import WINDOW, Measurements
from agents.encoder.relations import ObjectTrack, relation_concepts, relation_truth
from agents.encoder.rollouts import seeking_tracks
from agents.encoder.scenes import ObjectLayout, favoured_clips, training_placements
from anyskill_envs.controller import LowLevelController
from anyskill_envs.objects import load_object
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_states
from motion_data.authored import authored_clips
from motion_data.skeleton import forward_kinematics, rest_qpos


def truths(name, place, moving=0.0):
    """Truth of each relation for a standing humanoid with the object at a place, which moved there at so many m/s."""
    scene = Scene([name])
    part = scene.parts[name]
    positions = np.zeros((1, WINDOW, scene.model.nbody, 3))
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (1, WINDOW, scene.model.nbody, 1))
    bodies, turned = forward_kinematics(np.repeat(rest_qpos()[None], WINDOW, 0))
    positions[0, :, 1:16], quaternions[0, :, 1:16] = bodies, turned
    positions[0, :, part.body :] = place
    positions[0, :, part.body :, 0] += moving / 30 * np.arange(1 - WINDOW, 1)[:, None]
    vector = np.zeros((1, scene.state_size), np.float32)
    vector[0, :3] = place - bodies[-1, 0]
    vector[0, 3:9] = [1, 0, 0, 0, 0, 1]
    measured = Measurements(positions[:, :, 1:16], quaternions[:, :, 1:16])
    track = ObjectTrack(scene, part, positions, quaternions, object_states(scene, vector)[name])
    concepts = relation_concepts([load_object(name)])
    return {
        concept.name.partition(":")[2]: float(relation_truth(concept.name, measured, {name: track})[0])
        for concept in concepts
    }


def test_a_ball_at_the_foot_is_touched_and_a_rolling_one_was_kicked():
    ball = np.array([0.25, -0.05, 0.11])
    resting, rolling, away = truths("ball", ball), truths("ball", ball, 3.0), truths("ball", ball + [4.0, 0, 0])
    assert resting["touching"] > 0.9 and resting["in front of"] > 0.9 and resting["facing"] > 0.9
    assert resting["kicking"] < 0.4 < 0.8 < rolling["kicking"]
    assert max(away[name] for name in ("touching", "kicking", "in front of", "beside")) == 0.0


def test_an_object_at_the_side_is_beside_and_not_in_front():
    found = truths("pillar", np.array([0.0, 0.8, 0.9]))
    assert found["beside"] > 0.8 and found["in front of"] < 0.05 and found["facing"] < 0.05
    assert found["striking"] < 0.3, "a step on the way there, no more"


def test_who_sits_on_a_chair_has_the_pelvis_over_its_seat():
    over, before = np.array([0.0, 0.0, 0.75]), np.array([0.8, 0.0, 0.45])
    assert truths("chair", over)["sitting on"] > 0.4
    assert truths("chair", before)["sitting on"] < 0.3, "a step on the way there, no more"


def test_every_step_towards_an_object_counts():
    """What a policy climbs: far, nearer, there; and kicking is worth more than being there."""
    places = [truths("ball", np.array([distance, 0.0, 0.11])) for distance in (3.5, 2.5, 1.8, 1.2, 0.7)]
    for relation in ("approaching", "kicking"):
        grades = [found[relation] for found in places]
        assert (np.diff(grades) > 0).all(), relation
    assert places[-1]["approaching"] > 0.9 and places[-1]["kicking"] < 0.35
    coming = truths("ball", np.array([1.8, 0.0, 0.11]), -1.0)
    assert coming["approaching"] > places[2]["approaching"] + 0.2


def test_nothing_is_true_of_an_object_that_is_not_there():
    (concept, *_) = relation_concepts([load_object("ball")])
    positions, quaternions = forward_kinematics(np.repeat(rest_qpos()[None], WINDOW, 0))
    measured = Measurements(positions[None], quaternions[None])
    assert concept.rule(measured).tolist() == [0.0]
    assert relation_truth(concept.name, measured, {}) is None


def test_the_second_input_says_which_object_is_there():
    layout = ObjectLayout(("ball", "door"))
    state = np.arange(15, dtype=np.float32)[None] + 1
    block = layout.fill("ball", state)
    assert block.shape == (1, layout.size) and block[0, 0] == 1.0
    np.testing.assert_array_equal(layout.state("ball", block), state)
    assert not layout.state("door", block).any()
    mirrored = block * layout.mirror_sign
    np.testing.assert_array_equal(mirrored[0, 1:4], [1, -2, 3])  # position
    np.testing.assert_array_equal(mirrored[0, 13:16], [-13, 14, -15])  # angular velocity
    doors = layout.fill("door", np.ones((1, layout.sizes["door"]), np.float32))
    assert layout.has_mirror_image(block).all() and not layout.has_mirror_image(doors).any()


def test_scenes_are_among_the_motions_and_can_be_left_out():
    concepts = (CONCEPTS["arms_up"], *relation_concepts([load_object("ball")]))
    rng = np.random.default_rng(0)
    motions = join_sets(list(generate(authored_clips()[:6], concepts, rng, 1, 4, 4, layout=ObjectLayout(("ball",)))))
    there = motions.scenes >= 0
    assert there.any() and not there.all()
    assert (motions.objects[there, 0] == 1).all() and not motions.objects[~there].any()
    assert not motions.truths[~there, 1:].any() and motions.truths[there, 1:].max() > 0.5
    assert motions.films.shape[2] == Scene(["ball"]).pose_size
    alone = join_sets(list(generate(authored_clips()[:6], concepts[:1], rng, 1, 4, 4)))
    assert alone.objects.shape[1] == 0 and (alone.scenes == -1).all() and alone.films.shape[2] == 35


def test_in_some_scenes_the_object_is_sought():
    layout = ObjectLayout(("ball",))
    scene = layout.scenes["ball"]
    controller = LowLevelController.load()
    rng = np.random.default_rng(0)
    places = training_placements(scene)[0]
    poses, velocities = seeking_tracks(rng, 16, 150, controller, scene, places, favoured_clips("ball"))
    assert poses.shape == (150, 16, 42) and velocities.shape == (150, 16, 40)
    gap = np.linalg.norm(poses[..., :2] - poses[..., 35:37], axis=-1)
    assert (gap.min(0) < 0.75 * gap[0]).mean() > 0.2  # others go sideways or backwards
