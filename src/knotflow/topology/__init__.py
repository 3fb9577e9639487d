"""Topology of an open rope: states, actions, their graph, and reading states off rope shapes.

Paper Sec. IV and the symmetries of Sec. V-A. A state is the signed Gauss code of the rope's
projection onto the table; R1, R2 and Cross add crossings to it, Undo takes them back. Pure Python,
immutable and hashable; numpy comes in with rope shapes only, which are read by
`knotflow.topology.projection` and made by `knotflow.topology.draw`.
"""

from knotflow.topology.action import Action, ForwardAction, IllegalActionError
from knotflow.topology.actions import R1, R2, Cross
from knotflow.topology.arrange import Arrange
from knotflow.topology.curve import (
    CurveCrossings,
    DegenerateCurveError,
    project,
    segment_intervals,
    segment_lengths,
)
from knotflow.topology.graph import all_states, solution_graph, solution_paths
from knotflow.topology.knots import KNOT_NAMES, knot
from knotflow.topology.parse import parse_action
from knotflow.topology.state import InvalidStateError, TopologicalState
from knotflow.topology.undo import Undo

__all__ = [
    "KNOT_NAMES",
    "R1",
    "R2",
    "Action",
    "Arrange",
    "Cross",
    "CurveCrossings",
    "DegenerateCurveError",
    "ForwardAction",
    "IllegalActionError",
    "InvalidStateError",
    "TopologicalState",
    "Undo",
    "all_states",
    "knot",
    "parse_action",
    "project",
    "segment_intervals",
    "segment_lengths",
    "solution_graph",
    "solution_paths",
]
