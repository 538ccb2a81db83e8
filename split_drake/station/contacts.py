"""Who touches a body, and how deep, in a plant with point or hydroelastic contact."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Sequence
from itertools import product

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
        self._count = len(groups)
        # {(a body, another one): the groups that both are in}, in either order.
        self._groups = defaultdict[tuple[BodyIndex, BodyIndex], set[int]](set)
        for number, (ones, others) in enumerate(groups):
            for one, other in product(_bodies(plant, ones), _bodies(plant, others)):
                self._groups[one, other].add(number)
                self._groups[other, one].add(number)

    def depths_m(self, context: Context) -> list[float]:
        """Return how deep each group overlaps now, as `penetration_m` has it."""
        query = self._plant.get_geometry_query_input_port().Eval(context)
        inspector, plant, deepest = query.inspector(), self._plant, [0.0] * self._count
        for pair in query.ComputePointPairPenetration():
            a = plant.GetBodyFromFrameId(inspector.GetFrameId(pair.id_A)).index()
            b = plant.GetBodyFromFrameId(inspector.GetFrameId(pair.id_B)).index()
            for group in self._groups.get((a, b), ()):
                deepest[group] = max(deepest[group], float(pair.depth))
        return deepest

    def depths_in_last_step_m(self, context: Context) -> list[float]:
        """Return how deep each group overlapped when the last step began; 0 before the first.

        With point contact the step has found that out already, and no shape is looked at again.
        With another contact model, return how deep they overlap now.
        """
        plant, deepest = self._plant, [0.0] * self._count
        if plant.get_contact_model() != ContactModel.kPoint:
            return self.depths_m(context)
        results = plant.get_contact_results_output_port().Eval(context)
        # Most contacts are none of the groups', such as an object's with the table.
        for number in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(number)
            for group in self._groups.get((info.bodyA_index(), info.bodyB_index()), ()):
                deepest[group] = max(deepest[group], float(info.point_pair().depth))
        return deepest


def _bodies(plant: MultibodyPlant, names: Collection[str]) -> set[BodyIndex]:
    return {plant.GetBodyByName(name).index() for name in names}


def _body_of(plant: MultibodyPlant, context: Context, geometry: GeometryId) -> BodyIndex:
    inspector = plant.get_geometry_query_input_port().Eval(context).inspector()
    return plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).index()
