"""Short motions for the encoder: clips, mixtures of clips, random limbs, simulated bodies, and scenes with objects."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from agents.encoder.concepts import Concept
from agents.encoder.measurements import WINDOW, Array, Measurements
from agents.encoder.relations import DOINGS, ObjectTrack, attempts, relation_truth
from agents.encoder.rollouts import Tracks, controller_tracks, seeking_tracks, simulated_tracks
from agents.encoder.scenes import ROLLING, ObjectLayout, favoured_clips, raised_foot, scenes_around, training_placements
from anyskill_envs.controller import CONTROLLER_FILE, LowLevelController
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_states, object_vectors
from anyskill_envs.observation import OBSERVATION_SIZE
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.clip import MotionClip
from motion_data.skeleton import FRAME_RATE, JOINT_NAMES, differentiate, joint_limits, lowest_point

log = logging.getLogger(__name__)

FILM_FRAMES = (2, 6, 10, 14)
"""Frames of a short motion that the image tower sees: four over 0.4 s."""
SOURCES = ("clips", "mixtures", "random_limbs", "simulated", "controller", "scenes")

_TRIED = 8
"""Moments of a scene that are looked at for each that is kept."""
_SELDOM = 0.03
"""Weight of a moment in which nothing is done to the object; one in which something is has up to 1 more."""

_UPPER = np.array([not any(part in name for part in ("hip", "knee", "ankle")) for name in JOINT_NAMES])
_TRUNK = np.array([name.startswith(("abdomen", "neck")) for name in JOINT_NAMES])
_ARMS = _UPPER & ~_TRUNK


@dataclass(frozen=True)
class MotionSet:
    """n short motions.

    Attributes:
        observations: observation at the last frame, float32 `(n, 223)`.
        truths: how far each concept is true, float16 `(n, concepts)`.
        films: poses of the four frames that the image tower sees, float32 `(n, 4, 35)`; with scenes among the motions as
            wide as the largest pose of a scene, and 0 beyond the pose.
        sources: index into `SOURCES`, `(n,)`.
        clips: name of the clip that the motion comes from, or "".
        objects: second input of the state tower, float32 `(n, m)`; m is 0 without objects.
        scenes: which object is there: index into the names of the layout, -1 for none, `(n,)`.
    """

    observations: NDArray[np.float32]
    truths: NDArray[np.float16]
    films: NDArray[np.float32]
    sources: NDArray[np.int64]
    clips: NDArray[np.str_]
    objects: NDArray[np.float32]
    scenes: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of motions."""
        return len(self.observations)

    def save(self, path: Path) -> None:
        """Writes the set as `.npz`."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **self.__dict__)

    @classmethod
    def load(cls, path: Path) -> MotionSet:
        """Reads what `save` wrote."""
        with np.load(path, allow_pickle=False) as archive:
            return cls(**{name: archive[name] for name in archive.files})

    def take(self, index: NDArray[np.int64]) -> MotionSet:
        """Some of the motions."""
        return MotionSet(**{name: value[index] for name, value in self.__dict__.items()})


def join_sets(sets: Sequence[MotionSet]) -> MotionSet:
    """One set of several."""
    names = MotionSet.__dataclass_fields__
    return MotionSet(**{name: np.concatenate([getattr(one, name) for one in sets]) for name in names})


def smooth_path(
    rng: np.random.Generator, frames: int, draw: Callable[[int], NDArray[np.float64]], pace: tuple[float, float]
) -> NDArray[np.float64]:
    """A path through random poses, eased between them, `(frames, k)`.

    Args:
        rng: draws the times.
        frames: length at 30 frames per second.
        draw: gives the given number of poses, `(poses, k)`.
        pace: shortest and longest time between two poses, seconds.
    """
    times = [0.0]
    while times[-1] < frames:
        times.append(times[-1] + max(4.0, 30.0 * rng.uniform(*pace)))
    poses = draw(len(times))
    position = np.interp(np.arange(frames), times, np.arange(len(times)))
    segment = np.minimum(position.astype(int), len(times) - 2)
    share = position - segment
    share = share * share * (3 - 2 * share)
    return poses[segment] + share[:, None] * (poses[segment + 1] - poses[segment])


class MotionSource:
    """Draws kinematic motions.

    Args:
        clips: the motion library.
        rng: all randomness.
        frames: length of the motions, at 30 frames per second.
    """

    def __init__(self, clips: Sequence[MotionClip], rng: np.random.Generator, frames: int = 75) -> None:
        self.clips = [clip.resampled() for clip in clips]
        self.rng = rng
        self.frames = frames
        self.limits = joint_limits()

    def clip(self) -> tuple[NDArray[np.float64], str]:
        """A piece of a clip at a random speed; a shorter gait goes on, another shorter clip stands still at its end."""
        source = self.clips[self.rng.integers(len(self.clips))]
        name = source.name
        if self.rng.random() < 0.6:
            source = source.at_speed(float(self.rng.choice([0.7, 0.85, 1.2, 1.4])))
        if source.loop:
            source = source.repeated((self.frames + WINDOW) / FRAME_RATE)
        qpos = np.array(source.qpos)
        start = self.rng.integers(max(1, len(qpos) - self.frames + 1))
        piece = qpos[start : start + self.frames]
        if len(piece) < self.frames:
            piece = np.concatenate([piece, np.repeat(piece[-1:], self.frames - len(piece), 0)])
        return piece, name

    def low(self) -> NDArray[np.float64]:
        """A piece of a clip in which the pelvis is as low as on a seat, if ten draws find one."""
        for _ in range(10):
            piece, _ = self.clip()
            if ((piece[:, 2] > 0.45) & (piece[:, 2] < 0.64)).mean() > 0.2:
                break
        return self._noisy(piece)

    def kicking(self) -> NDArray[np.float64]:
        """A piece of a clip in which somebody who stands reaches out with a foot, if twenty draws find one."""
        for _ in range(20):
            piece, _ = self.clip()
            if raised_foot(piece)[0].max() > 0.5 and piece[:, 2].min() > 0.7:
                break
        return self._noisy(piece)

    def mixture(self) -> NDArray[np.float64]:
        """The arms and trunk of one clip on the legs and root of another."""
        below, _ = self.clip()
        above, _ = self.clip()
        which = [_UPPER, _ARMS, _ARMS & np.array([("right" in name) for name in JOINT_NAMES])][self.rng.integers(3)]
        qpos = below.copy()
        qpos[:, 7:][:, which] = above[:, 7:][:, which]
        return self._noisy(qpos)

    def random_limbs(self) -> NDArray[np.float64]:
        """A clip with random paths of one or both arms, of the trunk, of a leg or of everything, and tilted pelvis."""
        rng = self.rng
        qpos, _ = self.clip()
        pace = (0.2, 0.6) if rng.random() < 0.5 else (0.6, 2.0)
        side = np.array([str(rng.choice(["right", "left"])) in name for name in JOINT_NAMES])
        leg = ~_UPPER & side
        kind = rng.integers(6)
        which = [_ARMS, _ARMS & side, _TRUNK, leg, _ARMS | _TRUNK, np.ones(len(JOINT_NAMES), bool)][kind]
        low, high = self.limits[which].T
        middle = np.clip(np.zeros(len(low)), low, high)
        spread = 0.9 if kind < 2 or kind == 4 else 0.6

        def draw(count: int) -> NDArray[np.float64]:
            random = rng.uniform(low, high, size=(count, len(low)))
            return middle + spread * rng.random((count, 1)) ** 0.5 * (random - middle)

        qpos[:, 7:][:, which] = smooth_path(rng, len(qpos), draw, pace)
        if rng.random() < 0.3:
            tilt = Rotation.from_euler("xyz", rng.normal(0, [0.3, 0.4, 0.0]))
            turned = tilt * Rotation.from_quat(qpos[:, 3:7], scalar_first=True)
            qpos[:, 3:7] = turned.as_quat(scalar_first=True)
        airborne = lowest_point(qpos[::5]).max() > 0.1 and kind < 2
        if not airborne:
            qpos[:, 2] -= lowest_point(qpos)
        return self._noisy(qpos)

    def _noisy(self, qpos: NDArray[np.float64]) -> NDArray[np.float64]:
        qpos = qpos.copy()
        qpos[:, 7:] += self.rng.normal(0, self.rng.uniform(0, 0.08), size=len(JOINT_NAMES))
        qpos[:, 7:] = np.clip(qpos[:, 7:], *self.limits.T)
        return qpos


def kinematic_tracks(motions: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Stacks motions of one length: poses `(frames, n, 35)` and velocities `(frames, n, 34)`."""
    poses = np.stack(motions, 1)
    velocities = np.stack([differentiate(motion) for motion in motions], 1)
    return poses, velocities


@dataclass(frozen=True)
class _Recorded:
    """What a simulation of tracks shows, `(frames, n, ...)`: places of everything, observations, states of objects."""

    positions: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    observations: NDArray[np.float32]
    vectors: NDArray[np.float32]


def _record(tracks: Tracks, scene: Scene) -> _Recorded:
    poses, velocities = tracks
    frames, count, _ = poses.shape
    simulation = HumanoidSimulation(count, num_threads=1, scene=scene)
    bodies = simulation.model.nbody
    recorded = _Recorded(
        np.empty((frames, count, bodies, 3), np.float32),
        np.empty((frames, count, bodies, 4), np.float32),
        np.empty((frames, count, OBSERVATION_SIZE), np.float32),
        np.empty((frames, count, scene.state_size), np.float32),
    )
    for frame in range(frames):
        simulation.reset(np.arange(count), poses[frame], velocities[frame])
        recorded.positions[frame] = simulation.world_positions
        recorded.quaternions[frame] = simulation.world_quaternions
        recorded.observations[frame] = simulation.observation()
        recorded.vectors[frame] = object_vectors(simulation)
    return recorded


def windows_of_tracks(
    rng: np.random.Generator,
    tracks: Tracks,
    concepts: Sequence[Concept],
    source: str,
    per_track: int,
    names: Sequence[str] | None = None,
    layout: ObjectLayout | None = None,
    item: str = "",
) -> MotionSet:
    """Cuts short motions out of tracks and measures them.

    Args:
        rng: draws where to cut.
        tracks: poses and velocities.
        concepts: what to measure.
        source: one of `SOURCES`.
        per_track: motions per track.
        names: name of each track's clip.
        layout: the objects that the state tower is told about, if any.
        item: the object that is in the scene, one of the layout's; "" for none.

    Returns:
        n times `per_track` motions.
    """
    layout = ObjectLayout(()) if layout is None else layout
    scene = layout.scenes[item] if item else Scene()
    poses, _ = tracks
    frames, count, _ = poses.shape
    recorded = _record(tracks, scene)
    tried = per_track * (_TRIED if item else 1)
    ends = rng.integers(WINDOW - 1, frames, size=(tried, count)).ravel()
    rows = np.tile(np.arange(count), tried)
    measured, objects = _measure(recorded, scene, ends, rows)
    if item:
        done = [relation_truth(f"{item}:{relation}", measured, objects) for relation in DOINGS]
        # What misses is kept as often as what hits: how often a kick that looks like that hits must stay as it is.
        tried_to = [attempts(measured, track) for track in objects.values()]
        weights = _SELDOM + np.max([truth for truth in done + tried_to if truth is not None], axis=0) ** 3
        kept = rng.choice(len(ends), per_track * count, replace=False, p=weights / weights.sum())
        ends, rows = ends[kept], rows[kept]
        measured, objects = _measure(recorded, scene, ends, rows)
    index = _frames_until(ends)
    vectors = recorded.vectors[ends, rows]
    films = np.zeros((len(ends), len(FILM_FRAMES), _film_width(layout)), np.float32)
    films[:, :, : poses.shape[2]] = poses[index[:, FILM_FRAMES], rows[:, None]]
    return MotionSet(
        observations=recorded.observations[ends, rows],
        truths=np.stack([_truth(concept, measured, objects) for concept in concepts], 1).astype(np.float16),
        films=films,
        sources=np.full(len(ends), SOURCES.index(source)),
        clips=np.array(names if names is not None else [""] * count)[rows].astype("<U48"),
        objects=layout.fill(item, vectors) if item else np.zeros((len(ends), layout.size), np.float32),
        scenes=np.full(len(ends), layout.names.index(item) if item else -1),
    )


def _frames_until(ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """The frames of the short motions that end there, `(n, WINDOW)`."""
    return ends[:, None] - (WINDOW - 1) + np.arange(WINDOW)


def _measure(
    recorded: _Recorded, scene: Scene, ends: NDArray[np.int64], rows: NDArray[np.int64]
) -> tuple[Measurements, dict[str, ObjectTrack]]:
    """Measures the short motions that end at frames of rows, and the objects beside them."""
    index = _frames_until(ends)
    positions = recorded.positions[index, rows[:, None]].astype(np.float64)
    quaternions = recorded.quaternions[index, rows[:, None]].astype(np.float64)
    measured = Measurements(positions[:, :, 1:16], quaternions[:, :, 1:16])
    return measured, _objects_of(scene, positions, quaternions, recorded.vectors[ends, rows])


def _objects_of(
    scene: Scene, positions: Array, quaternions: Array, vectors: NDArray[np.float32]
) -> dict[str, ObjectTrack]:
    states = object_states(scene, vectors)
    return {name: ObjectTrack(scene, part, positions, quaternions, states[name]) for name, part in scene.parts.items()}


def _film_width(layout: ObjectLayout) -> int:
    return max([scene.pose_size for scene in layout.scenes.values()], default=Scene().pose_size)


def _truth(concept: Concept, measured: Measurements, objects: dict[str, ObjectTrack]) -> Array:
    truth = relation_truth(concept.name, measured, objects) if objects else None
    return concept.rule(measured) if truth is None else truth


def generate(
    clips: Sequence[MotionClip],
    concepts: Sequence[Concept],
    rng: np.random.Generator,
    rounds: int = 4,
    tracks: int = 128,
    per_track: int = 16,
    controller: Path | None = CONTROLLER_FILE,
    layout: ObjectLayout | None = None,
) -> Iterator[MotionSet]:
    """Makes the short motions, one source after another.

    Args:
        clips: the motion library, with mirrored clips.
        concepts: what to measure.
        rng: all randomness.
        rounds: how often all sources are drawn from.
        tracks: tracks per source and round.
        per_track: short motions cut from each.
        controller: the frozen controller, whose motions are two sources if the file exists.
        layout: objects that scenes hold, one at a time; no scenes without.

    Yields:
        One set per source and round.
    """
    layout = ObjectLayout(()) if layout is None else layout
    source = MotionSource(clips, rng)
    frozen = LowLevelController.load(controller) if controller is not None and Path(controller).is_file() else None

    def cut(motions: Tracks, kind: str, names: Sequence[str] | None = None, item: str = "") -> MotionSet:
        return windows_of_tracks(rng, motions, concepts, kind, per_track, names, layout, item)

    for _ in range(rounds):
        chosen = [source.clip() for _ in range(tracks)]
        clip_tracks = kinematic_tracks([motion for motion, _ in chosen])
        yield cut(clip_tracks, "clips", [name for _, name in chosen])
        yield cut(kinematic_tracks([source.mixture() for _ in range(tracks)]), "mixtures")
        limbs = kinematic_tracks([source.random_limbs() for _ in range(tracks)])
        yield cut(limbs, "random_limbs")
        followed = simulated_tracks(rng, *(np.concatenate(pair, 1) for pair in zip(clip_tracks, limbs, strict=True)))
        yield cut(followed, "simulated")
        if frozen is None:
            continue
        yield cut(controller_tracks(rng, tracks, 150, frozen, source.clips), "controller")
        for item, scene in layout.scenes.items():
            for places in training_placements(scene):
                share = max(2, tracks // (2 * len(layout.scenes)))
                favoured = favoured_clips(item)
                for rolling in (False, True) if item in ROLLING else (False,):
                    moved = controller_tracks(rng, share, 120, frozen, (), scene, places, favoured, rolling=rolling)
                    yield cut(moved, "scenes", item=item)
                sought = seeking_tracks(rng, share, 240, frozen, scene, places, favoured, item in ROLLING)
                yield cut(sought, "scenes", item=item)
            for _ in range(3 if item == "chair" else 2):
                count = max(2, tracks // 8)
                posed = [source.clip()[0] for _ in range(count)] + [source.random_limbs() for _ in range(count)]
                if item == "chair":
                    posed += [source.low() for _ in range(count)]
                elif item not in ROLLING:
                    posed += [source.kicking() for _ in range(count)]
                yield cut(scenes_around(rng, posed, item, scene), "scenes", item=item)
