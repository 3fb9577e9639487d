"""The rope: a chain of capsules on a table, built with MjSpec and posed from its vertices.

A link is a capsule whose frame's x axis points from head to tail. Neighbours are joined by two
hinges at their common vertex: the first about a z axis fixed in the link towards the head, the
second about a y axis fixed in the link towards the tail. The rope carries no twist, so its vertices
are its whole shape.

The middle link, the root, floats freely; two branches of links hang from it. In the branch towards
the head a joint's hinges follow in the other order about reversed axes: the same joint.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, fields
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from knotflow.arrays import floats
from knotflow.topology.polyline import Floats

if TYPE_CHECKING:
    import mujoco

MOST_LINKS = 400
GRAVITY = 9.81
"""Metres a second squared, as in MuJoCo."""
LENGTH_TOLERANCE = 0.01
"""Largest relative difference of a given link's length from the rope's."""
EQUAL_LENGTHS = 1e-5
"""Relative difference up to which links count as equally long, and points are left as they are."""
TABLE_BIT, ROPE_BIT = 1, 2
"""Collision groups."""


@dataclass
class RopeConfig:
    """The rope and the table it lies on."""

    length: float = 1.0
    """Length from head to tail, metres."""
    radius: float = 0.005
    """Radius of the rope, metres."""
    links: int = 40
    """Number of rigid links; the rope has `links + 1` vertices."""
    density: float = 800.0
    """Density of the rope, kg/m^3."""
    joint_damping: float = 3e-4
    """Viscous damping of each hinge, N m s/rad."""
    joint_armature: float = 2e-5
    """Inertia added to each hinge, kg m^2; keeps light links stable at the time step used."""
    joint_stiffness: float = 2e-3
    """Bending stiffness of each hinge, N m/rad."""
    max_bend: float = 1.2
    """Largest bend between neighbouring links about one hinge, radians."""
    table_friction: float = 0.5
    """Sliding friction between rope and table."""
    rope_friction: float = 0.3
    """Sliding friction between rope and rope."""

    keeps_bends: bool = False
    """Whether a bend at rest stays one: rest angles are those of the shape a spline begins with."""

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            numeric = isinstance(value, int | float | np.integer | np.floating)
            if not (numeric and 0 <= value < inf):
                raise ValueError(f"a rope's {one.name} is a number of 0 or more, got {value!r}")
        if self.links != int(self.links) or not 4 <= self.links <= MOST_LINKS:
            raise ValueError(
                f"a rope needs at least 4 links, and {MOST_LINKS} at most, got {self.links}"
            )
        self.links = int(self.links)
        for name in ("length", "radius", "density"):
            if getattr(self, name) <= 0:
                raise ValueError(f"a rope's {name} must be positive, got {getattr(self, name)}")

    @property
    def num_vertices(self) -> int:
        return self.links + 1

    @property
    def link_length(self) -> float:
        return self.length / self.links

    @property
    def bending_length(self) -> float:
        """(EI / w)^(1/3) of its stiffness EI and its weight w a metre, metres."""
        weight = GRAVITY * self.density * np.pi * self.radius**2
        return float((self.joint_stiffness * self.link_length / weight) ** (1 / 3))

    @property
    def root_link(self) -> int:
        return self.links // 2

    @property
    def branches(self) -> tuple[range, range]:
        """Links of the branches towards head and tail, each outward from the root's neighbour."""
        return range(self.root_link - 1, -1, -1), range(self.root_link + 1, self.links)


class ShapeError(ValueError):
    """Points that are not a shape of this rope."""


def check_points(points: ArrayLike, rope: RopeConfig) -> Floats:
    """The points as float64 (..., V, 3) with links of the rope's length and the same directions.

    Raises:
        ShapeError: another number of vertices, values that are not finite, or a link's length off
            by more than `LENGTH_TOLERANCE`.
    """
    points = floats(points, "rope points", ShapeError)
    if points.ndim < 2 or points.shape[-2:] != (rope.num_vertices, 3):
        raise ShapeError(
            f"a rope of {rope.links} links has points of shape (..., {rope.num_vertices}, 3), "
            f"got {points.shape}; resample() brings any curve to it"
        )
    if not np.isfinite(points).all():
        bad = np.argwhere(~np.isfinite(points))[0]
        raise ShapeError(f"rope points must be finite, but points{bad.tolist()} is not")
    links = np.diff(points, axis=-2)
    lengths = np.linalg.norm(links, axis=-1, keepdims=True)
    worst = np.abs(lengths / rope.link_length - 1).max(initial=0.0)
    if worst > LENGTH_TOLERANCE:
        raise ShapeError(
            f"links must be {rope.link_length * 1e3:.2f} mm long, but one is off by "
            f"{worst:.1%}; resample() makes them equal"
        )
    if worst <= EQUAL_LENGTHS:
        return points
    along = np.cumsum(links * rope.link_length / lengths, axis=-2)
    equal = np.concatenate([np.zeros_like(along[..., :1, :]), along], axis=-2)
    root = slice(rope.root_link, rope.root_link + 1)
    shifted: Floats = equal + points[..., root, :] - equal[..., root, :]
    return shifted


def build_model(
    rope: RopeConfig, timestep: float = 0.01, contact_time: float = 0.02
) -> mujoco.MjModel:
    """The MuJoCo model of rope, table and floating gripper.

    Vertex i of the rope is the site `vertex_i`. The gripper is a mocap body; grasping link i is
    the equality constraint i. Time step and `contact_time` (the first `solref`) are in seconds.
    """
    import mujoco  # here, so that the configuration is read without it

    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON  # to convergence: ends depend on it
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    spec.default.geom.solref = spec.default.equality.solref = [contact_time, 1.0]
    world = spec.worldbody
    table = world.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
    table.contype, table.conaffinity, table.condim = TABLE_BIT, TABLE_BIT, 1
    table.friction = [rope.table_friction, 0.005, 1e-4]
    world.add_light(pos=[0, -0.5, 2], dir=[0, 0.25, -1])
    gripper = world.add_body(name="gripper", mocap=True, pos=[0, 0, 0.5])
    gripper.add_site(name="gripper", size=[0.006, 0, 0])

    step = rope.link_length
    root = world.add_body(
        name=f"link_{rope.root_link}", pos=[rope.root_link * step, 0, rope.radius]
    )
    root.add_freejoint(name="root")
    _add_link_geoms(root, rope.root_link, 0.0, rope)
    towards_head, towards_tail = rope.branches
    # A body's origin is the vertex it shares with its parent; the root's is its headward vertex.
    # The hinge next to the parent comes first.
    for links, first, outward, start, axes in (
        (towards_head, 0.0, -step, -step, ([0, -1, 0], [0, 0, -1])),
        (towards_tail, step, step, 0.0, ([0, 0, 1], [0, 1, 0])),
    ):
        body = root
        for link in links:
            place = first if body is root else outward
            body = body.add_body(name=f"link_{link}", pos=[place, 0, 0])
            for axis in axes:
                body.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE,
                    axis=axis,
                    damping=[rope.joint_damping, 0, 0],
                    stiffness=[rope.joint_stiffness, 0, 0],
                    armature=rope.joint_armature,
                    limited=mujoco.mjtLimited.mjLIMITED_TRUE,
                    range=np.rad2deg([-rope.max_bend, rope.max_bend]).tolist(),
                )
            _add_link_geoms(body, link, start, rope)
    for i in range(rope.links):
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"grasp_{i}",
            name2="gripper",
            active=False,
        )
    try:
        model = spec.compile()
    except ValueError as error:  # such as a mass of nearly nothing
        raise ValueError(f"MuJoCo refuses the model of {rope}: {error}") from None
    # No hinge resists the root's roll about its own axis.
    roll = model.joint("root").dofadr[0] + 3
    model.dof_damping[roll] = rope.joint_damping
    model.dof_armature[roll] = rope.joint_armature
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def adapt_model(model: mujoco.MjModel, nominal: RopeConfig, rope: RopeConfig) -> mujoco.MjModel:
    """A copy of the nominal rope's model for one of other properties, as long and of as many links.

    As `build_model` makes it, in a twentieth of the time; the rest pose and what limits the hinges
    stay the nominal rope's.
    """
    import mujoco

    model = copy(model)
    ours = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    capsule = model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE
    thicker = rope.radius - nominal.radius
    model.geom_size[ours, 0] += thicker
    model.geom_rbound[ours] += thicker
    model.geom_aabb[ours, 3:] += thicker
    boxes = model.bvh_aabb[:, 3:]
    boxes[boxes.max(axis=1) < nominal.length] += thicker  # not the table's
    model.geom_friction[:, 0] = np.where(capsule, rope.rope_friction, rope.table_friction)
    before, after = (
        one.density * one.radius**2 * (one.link_length + 4 / 3 * one.radius)
        for one in (nominal, rope)
    )
    model.body_mass[:] *= after / before
    links = model.body_mass > 0
    mass, r, h = model.body_mass[links], rope.radius, rope.link_length
    ends = mass * 4 * r / (4 * r + 3 * h)  # of the half spheres
    across = (mass - ends) * (3 * r**2 + h**2) / 12 + ends * (
        2 * r**2 / 5 + h**2 / 4 + 3 * h * r / 8
    )
    about = (mass - ends) * r**2 / 2 + ends * 2 * r**2 / 5
    model.body_inertia[links] = np.stack([across, across, about], axis=1)
    hinge = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    model.jnt_stiffness[hinge] = rope.joint_stiffness
    resisted = model.dof_damping > 0
    model.dof_damping[resisted] = rope.joint_damping
    model.dof_armature[resisted] = rope.joint_armature
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _add_link_geoms(body: mujoco.MjsBody, link: int, start: float, rope: RopeConfig) -> None:
    """Capsule, feet and sites of a link whose headward vertex lies at `start` on its x axis."""
    import mujoco

    step = rope.link_length
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[start, 0, 0, start + step, 0, 0],
        size=[rope.radius, 0, 0],
        density=rope.density,
        friction=[rope.rope_friction, 0.005, 1e-4],
        contype=ROPE_BIT,
        conaffinity=ROPE_BIT,
    )
    # The table is touched by a sphere at each vertex, of which only every second one rubs.
    vertices = [(link, start)] + [(rope.links, start + step)] * (link == rope.links - 1)
    for vertex, along in vertices:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=[along, 0, 0],
            size=[rope.radius, 0, 0],
            mass=0.0,
            condim=3 if vertex % 2 == 0 else 1,
            friction=[rope.table_friction, 0.005, 1e-4],
            contype=TABLE_BIT,
            conaffinity=0,
        )
        body.add_site(name=f"vertex_{vertex}", pos=[along, 0, 0])
    body.add_site(name=f"grasp_{link}", pos=[start + step / 2, 0, 0])


def pose(points: ArrayLike, rope: RopeConfig) -> Floats:
    """Joint positions qpos (B, nq) of ropes (B, V, 3), metres, head first, world frame.

    The root's headward vertex and quaternion (w, x, y, z), then two hinge angles (radians) for each
    link of the branches. The head has no roll: its y axis is horizontal.
    """
    points = check_points(points, rope)
    direction = np.diff(points, axis=1)  # (B, links, 3)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    frame = _turn(*_angles(direction[:, 0]))  # (B, 3, 3), columns are the link's axes
    angles: list[tuple[Floats, Floats]] = []  # angles[i] of the joint between links i and i + 1
    for link in range(1, rope.links):
        yaw, pitch = _angles(np.einsum("bji,bj->bi", frame, direction[:, link]))
        angles.append((yaw, pitch))
        frame = frame @ _turn(yaw, pitch)
        if link == rope.root_link:
            root = frame
    from scipy.spatial.transform import Rotation  # slow to import, as mujoco is

    quaternion = Rotation.from_matrix(root).as_quat()[:, [3, 0, 1, 2]]
    towards_head, towards_tail = rope.branches
    hinges = [angle for link in towards_head for angle in angles[link][::-1]]
    hinges += [angle for link in towards_tail for angle in angles[link - 1]]
    return np.column_stack([points[:, rope.root_link], quaternion, *hinges])


def _angles(direction: Floats) -> tuple[Floats, Floats]:
    """Angles about z, then y, that turn the x axis into unit vectors (B, 3)."""
    yaw = np.arctan2(direction[:, 1], direction[:, 0])
    return yaw, -np.arcsin(np.clip(direction[:, 2], -1, 1))


def _turn(yaw: Floats, pitch: Floats) -> Floats:
    """Rotation matrices (B, 3, 3) about z by `yaw`, then about the new y by `pitch`."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(yaw)
    return np.stack([cy * cp, -sy, cy * sp, sy * cp, cy, sy * sp, -sp, zero, cp], axis=-1).reshape(
        -1, 3, 3
    )
