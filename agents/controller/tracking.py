"""Motion tracking as a batched reinforcement learning task: follow the reference in one's own heading frame.

Nothing here sees where the reference stands or faces in the world: only its pose, height, tilt and velocities. So the
behaviour that is learned depends on the state and on the *intended motion* alone, and can be distilled into a latent that
does not see the state. (An encoder that sees tracking errors lets the balance feedback flow through the latent, and a
frozen latent falls.)
"""

from dataclasses import dataclass

import numpy as np

from agents.controller.inertialization import Inertialization
from agents.controller.reference import ReferenceMotions
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_LAYOUT, OBSERVATION_SIZE
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.inverse_kinematics import floor_reach
from motion_data.metrics import CONTACT_HEIGHT
from motion_data.skeleton import BODY_NAMES, MIRROR_JOINT_SIGNS, MIRROR_JOINTS

_POSE_SIZE = OBSERVATION_LAYOUT["body_linear_velocities"].start
_EXTREMITIES = [BODY_NAMES.index(name) - 1 for name in ("head", "right_hand", "left_hand", "right_foot", "left_foot")]
_FEET = [BODY_NAMES.index(name) for name in ("right_foot", "left_foot")]
_POSITIONS = OBSERVATION_LAYOUT["body_positions"]
_LINEAR = OBSERVATION_LAYOUT["body_linear_velocities"]
_SYNCHRONISE_FRAMES = 20  # how far the reference is moved at most, either way
_SYNCHRONISE_VELOCITY = 0.1  # seconds: what a difference of velocity counts beside one of place
_SOLES = np.stack([floor_reach(side) for side in ("right", "left")]).astype(np.float32)  # corners, (2, 4, 3) metres
TRACKING_SIZE = 2 * OBSERVATION_SIZE + _POSE_SIZE + 28
"""Numbers the tracking policy sees, the humanoid's own observation included."""
_MIRRORED = np.concatenate(
    [
        MIRROR_INDEX,
        OBSERVATION_SIZE + MIRROR_INDEX,
        2 * OBSERVATION_SIZE + MIRROR_INDEX[:_POSE_SIZE],
        2 * OBSERVATION_SIZE + _POSE_SIZE + np.array(MIRROR_JOINTS),
    ]
)
_MIRRORED_SIGN = np.concatenate([MIRROR_SIGN, MIRROR_SIGN, MIRROR_SIGN[:_POSE_SIZE], MIRROR_JOINT_SIGNS]).astype(
    np.float32
)


@dataclass(frozen=True)
class TrackingConfig:
    """How episodes of motion tracking run."""

    failure_distance: float = 0.35
    """Mean distance of the bodies from the reference, relative to the root (metres), that ends an episode."""
    episode_steps: int = 150
    """Longest episode, controller steps."""
    mean_holds: tuple[int, ...] = (5, 15, 30, 90)
    """How long a motion window stays the intent: each episode draws one mean (steps), each hold U{1, 2 mean}. Episodes of
    clips that cannot be held (:class:`agents.controller.reference.ReferenceMotions`) take the shortest."""
    unsettled: float = 0.3
    """Share of the episodes that are unsettled: with switches between motions, and with pushes."""
    switch_holds: tuple[int, ...] = (5, 5, 20)
    """The mean holds of unsettled episodes; 5 steps are the 6 Hz of a high-level policy."""
    switch_probabilities: tuple[float, ...] = (0.3, 1.0)
    """Chance that the next window of an unsettled episode is another upright moment of the library; each draws one."""
    grace_steps: int = 24
    """Steps after a switch during which distance from the reference does not end the episode; a fall does."""
    synchronise_after: int | None = None
    """Steps a window is held until the phase of the reference follows the humanoid, as its intent has no clock: whoever
    stops half-way is then shown how to go on from there. None for never."""
    emphasis: float = 2.0
    """Power of a clip's failure rate in the time it is practised: 0 treats all clips alike."""
    least_practice: float = 0.02
    """What is added to that power, so that a clip that never fails is not forgotten."""
    joint_noise: float = 0.02
    """Standard deviation of the initial joint angles, radians."""
    velocity_noise: float = 0.1
    """Standard deviation of the initial velocities, m/s and rad/s."""
    push_probability: float = 0.01
    """In unsettled episodes, the chance per step that a push of 0.2 s begins."""
    push_force: float = 200.0
    """Largest force of a push on the torso, newtons."""


class Tracking:
    """Many humanoids tracking frames of reference motions.

    Args:
        motions: The reference motions.
        num_humanoids: How many run at once.
        rng: Source of all random draws.
        config: How episodes run.
        num_threads: Threads of the physics; 0 for one per CPU.

    Attributes:
        frame: Reference frame of each humanoid, ``(n,)``.
        window: First frame of the 2 s window that is the humanoid's current intent, ``(n,)``. It is renewed at random
            times; while it is held, the reference starts it again whenever it ends.
        expected: What the reference would observe now, jumps smoothed, ``(n, 223)``.
        renewed: Humanoids whose window was renewed by the last step or reset, ``(n,)`` bool.
        observation: Current observations, float32 ``(n, 223)``.
    """

    def __init__(
        self,
        motions: ReferenceMotions,
        num_humanoids: int,
        rng: np.random.Generator,
        config: TrackingConfig | None = None,
        num_threads: int = 0,
    ):
        self.motions = motions
        self.config = config or TrackingConfig()
        self.simulation = HumanoidSimulation(num_humanoids, num_threads)
        self._rng = rng
        self.clip_probabilities = np.full(len(motions.names), 1 / len(motions.names))
        self.failure_rate = np.full(len(motions.names), 0.5)
        self.exposure = self.clip_probabilities.copy()
        self._switch_targets = np.flatnonzero(motions.upright & (motions.last - np.arange(len(motions)) > 30))
        n = num_humanoids
        self._transition = Inertialization(n, motions.table.shape[1])
        self.frame = np.zeros(n, int)
        self._age = np.zeros(n, int)
        self.window = np.zeros(n, int)
        self.renewed = np.ones(n, bool)
        self._hold_left = np.zeros(n, int)
        self._held = np.zeros(n, int)
        self._mean_hold = np.ones(n, int)
        self._switch = np.zeros(n)
        self._grace = np.zeros(n, int)
        self._push_left = np.zeros(n, int)
        self._force = np.zeros((n, 3))
        self.observation = np.zeros((n, OBSERVATION_SIZE), np.float32)
        self.expected = np.zeros((n, OBSERVATION_SIZE), np.float32)
        self.reset(np.arange(n))

    def reset(self, ids: np.ndarray, frames: np.ndarray | None = None) -> None:
        """Starts episodes at reference frames, random ones (harder clips more often) if None."""
        if not len(ids):
            return
        motions, count = self.motions, len(ids)
        unsettled = self._rng.random(count) < self.config.unsettled
        if frames is None:
            clips = self._rng.choice(len(motions.names), count, p=self.clip_probabilities)
            phase = self._rng.random(count) * (motions.lengths[clips] - 5)
            # A tenth of the episodes start at the beginning, where a skill is entered.
            phase[self._rng.random(count) < 0.1] = 0
            frames = motions.starts[clips] + phase.astype(int)
            if len(self._switch_targets):
                frames[unsettled] = self._rng.choice(self._switch_targets, int(unsettled.sum()))
        qpos, qvel = motions.qpos[frames].copy(), motions.qvel[frames].copy()
        qpos[:, 7:] += self.config.joint_noise * self._rng.standard_normal((count, 28))
        qvel += self.config.velocity_noise * self._rng.standard_normal(qvel.shape)
        self.simulation.reset(ids, qpos, qvel)
        self.frame[ids] = frames
        self.expected[ids] = motions.observations[frames]
        self._transition.clear(ids)
        self.window[ids] = frames
        self.renewed[ids] = True
        self._held[ids] = 0
        holds = self._rng.choice(self.config.mean_holds, count), self._rng.choice(self.config.switch_holds, count)
        holds[0][~motions.holdable[frames]] = min(self.config.mean_holds)
        self._mean_hold[ids] = np.where(unsettled, holds[1], holds[0])
        self._switch[ids] = unsettled * self._rng.choice(self.config.switch_probabilities, count)
        self._hold_left[ids] = self._rng.integers(1, 2 * self._mean_hold[ids] + 1)
        self._age[ids] = 0
        self._grace[ids] = 0
        self._push_left[ids] = 0
        self.observation[ids] = self.simulation.observation()[ids]

    def _ahead(self, steps: int) -> np.ndarray:
        """Observations and feed-forward of the reference some steps from now, jumps smoothed, ``(n, 223 + 28)``."""
        return self.motions.table[self.motions.ahead(self.frame, steps)] + self._transition.ahead(steps)

    def reference(self) -> np.ndarray:
        """What the tracking policy sees of the reference, relative to the current state, ``(n, TRACKING_SIZE - 223)``."""
        soon, later = self._ahead(1), self._ahead(4)
        return np.concatenate(
            [
                soon[:, :OBSERVATION_SIZE] - self.observation,
                later[:, :_POSE_SIZE] - self.observation[:, :_POSE_SIZE],
                soon[:, OBSERVATION_SIZE:],
            ],
            1,
        )

    def policy_input(self) -> np.ndarray:
        """Own observation and reference, float32 ``(n, TRACKING_SIZE)``.

        A clip whose twin is in the library is seen in the mirror: what is learned of the left side serves the right.
        """
        inputs = np.concatenate([self.observation, self.reference()], 1)
        reflected = self.motions.reflected[self.frame]
        inputs[reflected] = inputs[reflected][:, _MIRRORED] * _MIRRORED_SIGN
        return inputs

    def feedforward(self) -> np.ndarray:
        """PD targets of the next reference frame, float32 ``(n, 28)``."""
        return self._ahead(1)[:, OBSERVATION_SIZE:]

    def targets(self, residual: np.ndarray) -> np.ndarray:
        """PD targets of a policy that sees :meth:`policy_input` and corrects the feed-forward, ``(n, 28)`` radians."""
        reflected = self.motions.reflected[self.frame][:, None]
        return self.feedforward() + np.where(reflected, residual[:, MIRROR_JOINTS] * MIRROR_JOINT_SIGNS, residual)

    def step(self, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Advances one controller step and resets the episodes that ended.

        Args:
            targets: PD targets, ``(n, 28)`` radians.

        Returns:
            Rewards in [0, 1] ``(n,)``; failed ``(n,)`` bool; ended without failure ``(n,)`` bool.
        """
        self._push()
        diverged = self.simulation.step(targets)
        motions = self.motions
        self._transition.advance()
        self.frame = motions.ahead(self.frame, 1)
        self._age += 1
        self._grace = np.maximum(self._grace - 1, 0)
        self.observation = self.simulation.observation()
        self._synchronise()
        self.expected = self._ahead(0)[:, :OBSERVATION_SIZE]
        rewards = np.nan_to_num(tracking_reward(self.observation, self.expected))
        fell = self.observation[:, 0] < self.expected[:, 0] - 0.4
        far = (tracking_distance(self.observation, self.expected) > self.config.failure_distance) & (self._grace == 0)
        failed = diverged | fell | far
        rewards[failed] = 0
        truncated = ~failed & (self._age >= self.config.episode_steps)
        ended = np.flatnonzero(failed | truncated)
        self._update_probabilities(ended, failed)
        self._advance_windows()
        self.reset(ended)
        return rewards, failed, truncated

    def _advance_windows(self) -> None:
        """Renews the windows whose time is up, and starts held windows again when they end."""
        motions, rng = self.motions, self._rng
        upright = motions.upright[self.frame]
        self._hold_left -= 1
        self._held += 1
        renewed = self._hold_left <= 0
        self._held[renewed] = 0
        count = int(renewed.sum())
        self._hold_left[renewed] = rng.integers(1, 2 * self._mean_hold[renewed] + 1)
        switch = renewed & upright & (rng.random(len(renewed)) < self._switch)
        if len(self._switch_targets):
            self._jump(np.flatnonzero(switch), rng.choice(self._switch_targets, int(switch.sum())))
        if count:
            self.window[renewed] = self.frame[renewed]
        # A held window that ends starts again if both its ends are on the feet; otherwise its last pose is held.
        length = np.minimum(motions.period[self.window], motions.last[self.window] - self.window)
        repeat = ~renewed & (self.frame - self.window >= length) & upright & motions.upright[self.window]
        self._jump(np.flatnonzero(repeat), self.window[repeat])
        jumped = switch | (repeat & ~motions.seamless[self.window])
        self._grace[jumped] = self.config.grace_steps
        self.renewed = renewed

    def _synchronise(self) -> None:
        """Moves the reference to the moment of its held window that is most like the humanoid's state."""
        if self.config.synchronise_after is None:
            return
        ids = np.flatnonzero((self._held >= self.config.synchronise_after) & (self._grace == 0))
        if not len(ids):
            return
        motions, frame, window = self.motions, self.frame[ids], self.window[ids]
        last = np.minimum(window + motions.period[window], motions.last[window])
        moments = np.arange(-_SYNCHRONISE_FRAMES, _SYNCHRONISE_FRAMES + 1)
        frames = np.clip(frame[:, None] + moments, window[:, None], np.maximum(last, frame)[:, None])
        away = self._phase_features(motions.observations[frames]) - self._phase_features(self.observation[ids])[:, None]
        distance = np.einsum("nmf,nmf->nm", away, away)
        best = distance.argmin(1)
        rows = np.arange(len(ids))
        moved = distance[rows, best] < 0.5 * distance[:, _SYNCHRONISE_FRAMES]
        self.frame[ids[moved]] = frames[rows, best][moved]

    @staticmethod
    def _phase_features(observation: np.ndarray) -> np.ndarray:
        """Heights, places and velocities of the bodies, all in metres, ``(..., features)``."""
        parts = observation[..., :1], observation[..., _POSITIONS], _SYNCHRONISE_VELOCITY * observation[..., _LINEAR]
        return np.concatenate(parts, -1)

    def _jump(self, ids: np.ndarray, frames: np.ndarray) -> None:
        """Goes on elsewhere in the library, smoothly."""
        table, ahead = self.motions.table, self.motions.ahead
        old, new = table[self.frame[ids]], table[frames]
        velocity = Inertialization.rate(old, table[ahead(self.frame[ids], 1)])
        velocity -= Inertialization.rate(new, table[ahead(frames, 1)])
        self._transition.jump(ids, old - new, velocity)
        self.frame[ids] = frames

    def _push(self) -> None:
        if not self.config.push_probability:
            return
        begin = (
            (self._push_left == 0)
            & (self._switch > 0)
            & (self._rng.random(len(self.frame)) < self.config.push_probability)
        )
        angle = self._rng.uniform(-np.pi, np.pi, begin.sum())
        size = self._rng.uniform(0, self.config.push_force, begin.sum())
        self._force[begin, 0], self._force[begin, 1] = size * np.cos(angle), size * np.sin(angle)
        self._push_left[begin] = 6
        self._force[self._push_left == 0] = 0
        self.simulation.push("torso", self._force)
        self._push_left = np.maximum(self._push_left - 1, 0)

    def failures_by_name(self) -> dict[str, float]:
        """How often episodes of each clip failed lately: what a checkpoint needs to go on practising the same clips."""
        return dict(zip(self.motions.names, self.failure_rate.tolist(), strict=True))

    def restore_failures(self, by_name: dict[str, float]) -> None:
        """Takes up what :meth:`failures_by_name` returned; the clips may be others now."""
        known = [by_name.get(name) for name in self.motions.names]
        self.failure_rate = np.array([0.5 if rate is None else rate for rate in known])
        self._choose_probabilities()

    def _update_probabilities(self, ended: np.ndarray, failed: np.ndarray) -> None:
        """Clips that fail more often are practised for more of the time.

        Episodes of easy clips last longest, so choosing starts by failure alone would spend nearly all time on them: the
        chance to start a clip is corrected by the share of time it already takes. Episodes with switches do not count.
        """
        rate = 0.01
        settled = self._switch == 0
        of_humanoid = self.motions.clip_of_frame[self.frame]
        ended = ended[settled[ended]]
        for clip in np.unique(of_humanoid[ended]):
            mine = failed[ended[of_humanoid[ended] == clip]]
            keep = (1 - rate) ** len(mine)
            self.failure_rate[clip] = keep * self.failure_rate[clip] + (1 - keep) * mine.mean()
        running = np.bincount(of_humanoid[settled], minlength=len(self.exposure)) / max(1, settled.sum())
        self.exposure += rate * (running - self.exposure)
        self._choose_probabilities()

    def _choose_probabilities(self) -> None:
        wanted = self.config.least_practice + self.failure_rate**self.config.emphasis
        wanted /= wanted.sum()
        weight = wanted * np.clip(wanted / np.maximum(self.exposure, 1e-6), 0.05, 20)
        self.clip_probabilities = weight / weight.sum()


def tracking_distance(observation: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Mean distance of the 15 bodies from the reference in the heading frame, metres, ``(n,)``; height counts as the root's."""
    place = OBSERVATION_LAYOUT["body_positions"]
    difference = (observation[:, place] - expected[:, place]).reshape(len(observation), -1, 3)
    height = observation[:, 0] - expected[:, 0]
    difference[..., 2] += height[:, None]
    return (np.linalg.norm(difference, axis=-1).sum(1) + np.abs(height)) / len(BODY_NAMES)


def tracking_reward(observation: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """How well states match the reference, in [0, 1], ``(n,)``.

    DeepMimic's form (Peng et al. 2018, eq. 6-9: a weighted sum of exponentials of squared errors), in the heading frame:
    body positions 0.25, rotations 0.2, head, hands and feet 0.1, body velocities 0.15, root velocity and turning 0.1;
    and 0.2 for soles that slide on the floor no more than the reference's, half of it for creeping, half for sliding.
    """
    n = len(observation)
    difference = observation - expected
    positions = difference[:, OBSERVATION_LAYOUT["body_positions"]].reshape(n, -1, 3)
    positions = positions + difference[:, None, :1] * np.array([0, 0, 1], np.float32)
    squared = (positions**2).sum(-1)
    rotations = (difference[:, OBSERVATION_LAYOUT["body_rotations"]] ** 2).reshape(n, -1, 6).sum(-1).mean(-1)
    velocities = difference[:, OBSERVATION_LAYOUT["body_linear_velocities"]].reshape(n, -1, 3)
    turning = difference[:, OBSERVATION_LAYOUT["body_angular_velocities"].start + 2]
    root = (velocities[:, 0] ** 2).sum(-1) + 0.1 * turning**2
    slide = np.maximum(_slide(observation) - _slide(expected), 0)
    return (
        0.25 * np.exp(-30 * squared.mean(-1))
        + 0.2 * np.exp(-4 * rotations)
        + 0.1 * np.exp(-20 * squared[:, _EXTREMITIES].mean(-1))
        + 0.15 * np.exp(-0.5 * (velocities**2).sum(-1).mean(-1))
        + 0.1 * np.exp(-2 * root)
        + 0.1 * np.exp(-200 * slide)
        + 0.1 * np.exp(-20 * slide)
    )


def _slide(observation: np.ndarray) -> np.ndarray:
    """Mean squared speed along the floor of the soles' corners, as far as they touch it, (m/s)^2 ``(n,)``.

    The contact of a corner is that of :func:`motion_data.metrics.foot_skate`: 1 on the floor, 0 from 25 mm on.
    """
    n = len(observation)
    linear, angular = (
        observation[:, OBSERVATION_LAYOUT[name]].reshape(n, -1, 1, 3)[:, _FEET]
        for name in ("body_linear_velocities", "body_angular_velocities")
    )
    rotations = observation[:, OBSERVATION_LAYOUT["body_rotations"]].reshape(n, -1, 2, 3)[:, _FEET]
    first, third = rotations[:, :, 0], rotations[:, :, 1]
    # Corners (2, 4, 3) in the foot's frame, whose axes are the columns of its rotation matrix.
    axes = np.stack([first, np.cross(third, first), third], 2)
    corners = np.einsum("fca,nfad->nfcd", _SOLES, axes)
    place = observation[:, OBSERVATION_LAYOUT["body_positions"]].reshape(n, -1, 3)
    ankle = observation[:, :1] + place[:, [foot - 1 for foot in _FEET], 2]
    contact = 2 - 2 ** np.clip((ankle[:, :, None] + corners[..., 2]) / CONTACT_HEIGHT, 0, 1)
    # Horizontal part of v + w x r, without the general cross product, which is slow.
    along = linear[..., 0] + angular[..., 1] * corners[..., 2] - angular[..., 2] * corners[..., 1]
    across = linear[..., 1] + angular[..., 2] * corners[..., 0] - angular[..., 0] * corners[..., 2]
    return (contact * (along**2 + across**2)).mean((1, 2))
