"""How a table is cleared: by a hand that floats, or by an arm that drops things into a bin."""

from collections.abc import Sequence
from typing import Protocol

from scenarios.clutter.records import GraspRecord
from split_drake.camera import DepthView
from split_drake.objects.rigid import RigidObject
from split_drake.pose_set import PoseSet
from split_drake.scene import Scene
from split_drake.station.hand.grasp_execution import execute_grasp
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import CameraPlacement
from split_drake.truth.removal import clear_away
from split_drake.truth.state import Truth


class Clearing(Protocol):
    """A table with objects, and what takes them."""

    @property
    def objects(self) -> Sequence[RigidObject]:
        """All objects; others know them by their index."""
        ...

    @property
    def left(self) -> tuple[int, ...]:
        """Which of them are still to be taken."""
        ...

    @property
    def truth(self) -> Truth: ...

    @property
    def time_s(self) -> float:
        """The simulation's time."""
        ...

    def look(self) -> DepthView:
        """Return what the camera sees now."""
        ...

    def choose(self, found: PoseSet, scene: Scene, order: Sequence[int]) -> int | str:
        """Return the first of the grasps, in that order, that can be tried, or why none can."""
        ...

    def take(self, found: PoseSet, chosen: int) -> GraspRecord:
        """Try the grasp that was chosen last, and see to what became of the objects."""
        ...


class HandClearing:
    """A floating hand, which can try any grasp, and removes what it took for good."""

    def __init__(self, station: HandStation, camera: CameraPlacement) -> None:
        self._station = station
        self._camera = camera
        self.truth = Truth(station)

    @property
    def objects(self) -> Sequence[RigidObject]:
        return self._station.objects

    @property
    def left(self) -> tuple[int, ...]:
        return self._station.present

    @property
    def time_s(self) -> float:
        return self._station.time_s

    def look(self) -> DepthView:
        """Return what the camera sees now."""
        (view,) = self._station.capture([self._camera])
        return view

    def choose(self, found: PoseSet, scene: Scene, order: Sequence[int]) -> int | str:
        """Return the first of the grasps."""
        return order[0]

    def take(self, found: PoseSet, chosen: int) -> GraspRecord:
        """Try a grasp by VGN's protocol, and remove what it took and what is lost."""
        execution = execute_grasp(self._station, found.X_WPs[chosen])
        held = execution.held if execution.success else ()
        removal = clear_away(self._station, self.truth, held)
        self._station.discard_parked()
        return GraspRecord(
            X_WG=found.X_WPs[chosen].tolist(),
            score=float(found.scores[chosen]),
            candidates=len(found),
            taken=names_of(self.objects, removal.taken),
            lost=names_of(self.objects, removal.lost),
            stopped_by=execution.stopped_by,
            reason=execution.reason,
        )


def names_of(objects: Sequence[RigidObject], indices: Sequence[int]) -> tuple[str, ...]:
    """Return the names of objects by their indices."""
    return tuple(objects[index].name for index in indices)
