"""From paths to timed segments of an empty or loaded hand."""

from dataclasses import dataclass, replace

from planning.collision.world import CollisionWorld, Situation
from planning.motion.free import timed
from planning.motion.timing import Speed, join, rest
from planning.problem import SAMPLE_S, Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_FORCE_N

# The fingers close and open slowly: at full speed pads tunnel into thin walls.
FINGER_SPEED_M_S = 0.1
# Commanded below zero, so that the force limit acts on whatever is between the pads.
SQUEEZE_M = -0.05
SETTLE_S = 0.2


def executed_s(segment: Segment) -> float:
    """Return how long a segment takes where nothing stops it: a step for each of its samples."""
    return SAMPLE_S * len(segment.trajectory.times_s)


@dataclass(frozen=True)
class SegmentBuilder:
    """Times paths and makes segments of them.

    Attributes:
        world: that the paths are timed in.
    """

    world: CollisionWorld

    def empty(
        self,
        name: SegmentName,
        qs: Array,
        speed: Speed,
        situation: Situation,
        feel: bool = False,
    ) -> Segment:
        """Return the segment in which the empty hand, open as in the situation, follows a path.

        Args:
            name: of the segment.
            qs: (N, 7) the path, joint angles in rad.
            speed: at most.
            situation: the opening in m, what to keep clear of, and which contacts are allowed.
            feel: whether the arm stops where the hand touches something.
        """
        trajectory = timed(self.world, qs, situation, speed)
        return Segment(
            name=name,
            trajectory=trajectory,
            opening_start_m=situation.opening_m,
            opening_end_m=situation.opening_m,
            force_n=MAX_FORCE_N,
            holding=False,
            allowed_contacts=situation.allowed,
            stop_on_contact=feel,
        )

    def loaded(
        self,
        name: SegmentName,
        qs: Array,
        speed: Speed,
        situation: Situation,
        feel: bool = False,
    ) -> Segment:
        """Return the segment in which the hand carries an object along a path.

        Args:
            name: of the segment.
            qs: (N, 7) the path, joint angles in rad.
            speed: at most.
            situation: the held width in m as its opening, what to keep clear of, and which contacts
                are allowed.
            feel: whether the arm stops where the object touches something.
        """
        return Segment(
            name=name,
            trajectory=timed(self.world, qs, situation, speed),
            opening_start_m=SQUEEZE_M,
            opening_end_m=SQUEEZE_M,
            force_n=MAX_FORCE_N,
            holding=True,
            allowed_contacts=situation.allowed,
            stop_on_contact=feel,
            held_width_m=situation.opening_m,
        )


def settled(segment: Segment) -> Segment:
    """Return a segment with a rest at its end, so that the next one feels no motion of its own."""
    trajectory = segment.trajectory
    still = join([trajectory, rest(trajectory.qs[-1], SETTLE_S)])
    return replace(segment, trajectory=still)


def closing_segment(
    q: Array, opening_m: float, held_width_m: float, contacts: frozenset[AllowedContact]
) -> Segment:
    """Return the segment in which the hand, at rest at `q` (7,), closes on an object."""
    return Segment(
        name=SegmentName.CLOSE,
        trajectory=rest(q, (opening_m - SQUEEZE_M) / FINGER_SPEED_M_S + SETTLE_S),
        opening_start_m=opening_m,
        opening_end_m=SQUEEZE_M,
        force_n=MAX_FORCE_N,
        holding=False,
        allowed_contacts=contacts,
        held_width_m=held_width_m,
    )


def opening_segment(
    q: Array, release_m: float, held_width_m: float, contacts: frozenset[AllowedContact]
) -> Segment:
    """Return the segment in which the hand, at rest at `q` (7,), lets go of an object."""
    return Segment(
        name=SegmentName.OPEN,
        trajectory=rest(q, release_m / FINGER_SPEED_M_S + SETTLE_S),
        opening_start_m=0.0,
        opening_end_m=release_m,
        force_n=MAX_FORCE_N,
        holding=False,
        allowed_contacts=contacts,
        held_width_m=held_width_m,
    )
