from planning.geometry.perceived import PerceivedObject
from planning.goals.hang import hang_placements
from planning.goals.placement import Placement
from planning.goals.upright import upright_placements
from planning.problem import PlanningProblem, Subgoal


def placements(problem: PlanningProblem, target: PerceivedObject) -> list[Placement]:
    """Return all placements that serve the problem's subgoal; none where nothing was detected."""
    if problem.subgoal is Subgoal.HANG:
        return hang_placements(problem, target)
    return upright_placements(problem, target)
