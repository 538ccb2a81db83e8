"""Who touches a body, and how deep, in a plant with point or hydroelastic contact."""

from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.multibody.plant import ContactModel, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context

from split_drake.poses import Array


def contacts_of(
    plant: MultibodyPlant, context: Context, own: BodyIndex
) -> Iterator[tuple[str, Array]]:
    """Yield what a body touches, as of the last step: the other's name and a point (3,) in W.

    A hydroelastic contact surface counts as one contact, at its centroid.
    """
    results = plant.get_contact_results_output_port().Eval(context)
    for number in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(number)
        pair = {info.bodyA_index(), info.bodyB_index()}
        if own in pair:
            (other,) = pair - {own}
            yield plant.get_body(other).name(), info.contact_point()
    for number in range(results.num_hydroelastic_contacts()):
        surface = results.hydroelastic_contact_info(number).contact_surface()
        pair = {_body_of(plant, context, id) for id in (surface.id_M(), surface.id_N())}
        if own in pair:
            (other,) = pair - {own}
            yield plant.get_body(other).name(), np.asarray(surface.centroid())


def penetration_m(
    plant: MultibodyPlant, context: Context, one: Collection[str], other: Collection[str]
) -> float:
    """Return how deep bodies named in `one` and in `other` overlap now; 0 where none do.

    By the shapes alone, whatever the contact model makes of them.
    """
    (depth_m,) = Overlaps(plant, [(one, other)]).depths_m(context)
    return depth_m


class Overlaps:
    """How deep bodies overlap with others, for several groups of them at one look.

    Args:
        plant: that all of them are in.
        groups: names of bodies, and of those that they may overlap with.
    """

    def __init__(
        self, plant: MultibodyPlant, groups: Sequence[tuple[Collection[str], Collection[str]]]
    ) -> None:
        self._plant = plant
        self._bodies = [(_bodies(plant, one), _bodies(plant, other)) for one, other in groups]

    def depths_m(self, context: Context) -> list[float]:
        """Return how deep each group overlaps now, as `penetration_m` has it."""
        query = self._plant.get_geometry_query_input_port().Eval(context)
        inspector, plant = query.inspector(), self._plant
        return self._deepest(
            (
                plant.GetBodyFromFrameId(inspector.GetFrameId(pair.id_A)).index(),
                plant.GetBodyFromFrameId(inspector.GetFrameId(pair.id_B)).index(),
                pair.depth,
            )
            for pair in query.ComputePointPairPenetration()
        )

    def depths_in_last_step_m(self, context: Context) -> list[float]:
        """Return how deep each group overlapped when the last step began; 0 before the first.

        With point contact the step has found that out already, and no shape is looked at again.
        With another contact model, return how deep they overlap now.
        """
        plant = self._plant
        if plant.get_contact_model() != ContactModel.kPoint:
            return self.depths_m(context)
        results = plant.get_contact_results_output_port().Eval(context)
        infos = map(results.point_pair_contact_info, range(results.num_point_pair_contacts()))
        return self._deepest(
            (info.bodyA_index(), info.bodyB_index(), info.point_pair().depth) for info in infos
        )

    def _deepest(self, overlaps: Iterable[tuple[BodyIndex, BodyIndex, float]]) -> list[float]:
        """Return each group's deepest overlap of those given."""
        deepest = [0.0] * len(self._bodies)
        for a, b, depth_m in overlaps:
            for number, (ones, others) in enumerate(self._bodies):
                if (a in ones and b in others) or (b in ones and a in others):
                    deepest[number] = max(deepest[number], float(depth_m))
        return deepest


def _bodies(plant: MultibodyPlant, names: Collection[str]) -> set[BodyIndex]:
    return {plant.GetBodyByName(name).index() for name in names}


def _body_of(plant: MultibodyPlant, context: Context, geometry: GeometryId) -> BodyIndex:
    inspector = plant.get_geometry_query_input_port().Eval(context).inspector()
    return plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index()
