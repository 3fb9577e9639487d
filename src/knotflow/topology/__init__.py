"""Topology of an open rope: states, actions, their graph, and reading states off rope shapes.

Paper Sec. IV and the symmetries of Sec. V-A. A state is the signed Gauss code of the rope's
projection onto the table; R1, R2 and Cross add crossings to it, Undo removes them. Immutable and
hashable. Rope shapes are read by `knotflow.topology.curve` and made by `knotflow.topology.draw`.
"""

from knotflow.topology.action import Action, Arrange, ForwardAction, IllegalActionError, Undo
from knotflow.topology.action_text import parse_action
from knotflow.topology.curve import CurveCrossings, project, segment_intervals, segment_lengths
from knotflow.topology.knots import (
    CATALOGUE,
    KNOT_NAMES,
    all_states,
    is_knot_name,
    knot,
    solution_graph,
)
from knotflow.topology.moves import R1, R2, Cross
from knotflow.topology.polyline import DegenerateCurveError
from knotflow.topology.state import InvalidStateError, TopologicalState
