"""A way of going, in a few named numbers."""

from dataclasses import dataclass

from motion_data.skeleton import FRAME_RATE


@dataclass(frozen=True)
class Gait:
    """A way of going.

    Attributes:
        forward: Metres per second.
        left: Metres per second.
        turn: Degrees per second to the left.
        cadence: Steps per minute; rounded so that a step is a whole number of frames.
        duty: Share of the stride for which each foot stands: over 0.5 a walk, under 0.5 a run.
        width: Metres between the middles of the soles, sideways.
        toe_out: Degrees that each foot points outward.
        lift: Metres that the ankle rises in a swing beyond the straight way.
        landing: Degrees of the foot when it lands: negative on the heel, positive on the toes.
        standing: Degrees of the foot for the whole stance: positive on tiptoe.
        leaving: Degrees of the foot when it leaves the floor, beyond ``standing``.
        swing: Degrees that the foot hangs in the swing, beyond the straight way from leaving to landing.
        lower: Metres that the pelvis is lower than standing.
        bob: Metres by which the pelvis of a walk rises and sinks about its mean.
        lean: Degrees that the pelvis leans forward.
        bend: Degrees that the back bends forward.
        pelvis_turn: Degrees that the pelvis turns with the foremost leg.
        pelvis_list: Degrees that the pelvis sinks on the side of the swinging leg.
        arm_swing: Degrees that the arms swing to each side of their mean.
        arm_raise: Degrees of that mean, forward.
        arm_out: Degrees of the arms from the body.
        elbow: Degrees that the elbows are bent.
        elbow_swing: Degrees more that they bend in front.
        start: Whether the clip begins standing instead of being a loop.
        stop: Whether it ends standing.
        strides: Strides of a clip that starts or stops.

    Raises:
        ValueError: If a number makes no gait.
    """

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    cadence: float = 110.0
    duty: float = 0.62
    width: float = 0.16
    toe_out: float = 5.0
    lift: float = 0.04
    landing: float = 0.0
    standing: float = 0.0
    leaving: float = 0.0
    swing: float = 0.0
    lower: float = 0.02
    bob: float = 0.0
    lean: float = 0.0
    bend: float = 0.0
    pelvis_turn: float = 0.0
    pelvis_list: float = 2.0
    arm_swing: float = 10.0
    arm_raise: float = 0.0
    arm_out: float = 8.0
    elbow: float = 18.0
    elbow_swing: float = 8.0
    start: bool = False
    stop: bool = False
    strides: float = 3.0

    def __post_init__(self) -> None:
        if not 20 <= self.cadence <= 300:
            raise ValueError(f"The cadence must be 20 to 300 steps per minute, got {self.cadence}.")
        if not 0.2 <= self.duty <= 0.9 or self.duty == 0.5:
            raise ValueError(f"The duty must be 0.2 to 0.9 and not 0.5, got {self.duty}.")
        if self.runs and (self.start or self.stop):
            raise ValueError("A run (duty below 0.5) can neither start nor stop: use a walk.")
        if not 2 <= self.strides <= 100:
            raise ValueError(f"A clip that starts or stops has 2 to 100 strides, got {self.strides}.")

    @property
    def runs(self) -> bool:
        """Whether both feet are in the air for a part of each step."""
        return self.duty < 0.5

    @property
    def stride_frames(self) -> int:
        """Frames of a stride, that is of two steps of equal length."""
        return 2 * round(60 / self.cadence * FRAME_RATE)

    @property
    def stride(self) -> float:
        """Seconds of a stride."""
        return self.stride_frames / FRAME_RATE

    @property
    def loops(self) -> bool:
        """Whether the clip is one stride that leads into itself."""
        return not (self.start or self.stop)

    @property
    def seconds(self) -> float:
        """Length of the clip."""
        return self.stride if self.loops else round(self.strides * self.stride_frames) / FRAME_RATE
