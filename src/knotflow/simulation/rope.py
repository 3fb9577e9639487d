"""The rope: a chain of capsules on a table, built with MjSpec and posed from its vertices.

A link is a capsule of one segment length; neighbours are joined by two hinges at their common
vertex (first about the link frame's z axis, then about its y axis), so the rope bends freely in
both directions and carries no twist: its vertices are its whole shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import mujoco


@dataclass
class RopeConfig:
    """The rope and the table it lies on."""

    length: float = 1.0
    """Length from head to tail, metres."""
    radius: float = 0.008
    """Radius of the rope, metres."""
    links: int = 40
    """Number of rigid links; the rope has `links + 1` vertices."""
    density: float = 500.0
    """Density of the rope, kg/m^3."""
    joint_damping: float = 3e-3
    """Viscous damping of each hinge, N m s/rad."""
    joint_armature: float = 2e-4
    """Inertia added to each hinge, kg m^2; keeps light links stable at the time step used."""
    joint_stiffness: float = 2e-3
    """Bending stiffness of each hinge, N m/rad."""
    max_bend: float = 1.2
    """Largest bend between neighbouring links about one hinge, radians."""
    table_friction: float = 1.0
    """Sliding friction between rope and table."""
    rope_friction: float = 0.3
    """Sliding friction between rope and rope."""

    def __post_init__(self) -> None:
        if self.links < 4:
            raise ValueError(f"a rope needs at least 4 links, got {self.links}")
        if self.length <= 0 or self.radius <= 0:
            raise ValueError(
                f"rope length and radius must be positive, got {self.length} and {self.radius} m"
            )

    @property
    def num_vertices(self) -> int:
        """Number of vertices, V = links + 1."""
        return self.links + 1

    @property
    def link_length(self) -> float:
        """Length of one link, metres."""
        return self.length / self.links


class ShapeError(ValueError):
    """Points that are not a shape of this rope."""


def check_points(points: NDArray, rope: RopeConfig) -> NDArray[np.float64]:
    """The points as float64 (..., V, 3), if they are shapes of this rope.

    Raises:
        ShapeError: for another number of vertices, values that are not finite, or links whose
            length differs from the rope's by more than 1 %.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim < 2 or points.shape[-2:] != (rope.num_vertices, 3):
        raise ShapeError(
            f"a rope of {rope.links} links has points of shape (..., {rope.num_vertices}, 3), "
            f"got {points.shape}; resample() brings any curve to it"
        )
    if not np.isfinite(points).all():
        bad = np.argwhere(~np.isfinite(points))[0]
        raise ShapeError(f"rope points must be finite, but points{bad.tolist()} is not")
    lengths = np.linalg.norm(np.diff(points, axis=-2), axis=-1)
    worst = np.abs(lengths / rope.link_length - 1).max(initial=0.0)
    if worst > 0.01:
        raise ShapeError(
            f"links must be {rope.link_length * 1e3:.2f} mm long, but one is off by "
            f"{worst:.1%}; resample() makes them equal"
        )
    return points


def build_model(
    rope: RopeConfig, timestep: float = 0.01, contact_time: float = 0.02
) -> mujoco.MjModel:
    """The MuJoCo model of rope, table and floating gripper.

    Vertex i of the rope is the site `vertex_i`. The gripper is a mocap body; grasping link i is
    the equality constraint i, switched by `eq_active`. It is a site-to-site `connect`, whose
    anchors do not depend on the reference pose.

    Args:
        rope: the rope.
        timestep: simulation time step, seconds.
        contact_time: time constant of the contacts (MuJoCo's first `solref`), seconds.
    """
    import mujoco  # here, so that the configuration is read without it

    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    solref = [contact_time, 1.0]
    world = spec.worldbody
    table = world.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
    table.contype, table.conaffinity, table.condim = TABLE_BIT, TABLE_BIT, 1
    table.friction = [rope.table_friction, 0.005, 1e-4]
    table.solref = solref
    world.add_light(pos=[0, -0.5, 2], dir=[0, 0.25, -1])
    gripper = world.add_body(name="gripper", mocap=True, pos=[0, 0, 0.5])
    gripper.add_site(name="gripper", size=[0.006, 0, 0])

    step = rope.link_length
    body = world
    for i in range(rope.links):
        head = i == 0
        body = body.add_body(name=f"link_{i}", pos=[0, 0, rope.radius] if head else [step, 0, 0])
        if head:
            # Without damping the head link, which no hinge holds, spins up about its own axis.
            body.add_joint(
                name="root",
                type=mujoco.mjtJoint.mjJNT_FREE,
                damping=[rope.joint_damping, 0, 0],
                armature=rope.joint_armature,
            )
        else:
            for axis in ([0, 0, 1], [0, 1, 0]):
                body.add_joint(
                    type=mujoco.mjtJoint.mjJNT_HINGE,
                    axis=axis,
                    damping=[rope.joint_damping, 0, 0],
                    stiffness=[rope.joint_stiffness, 0, 0],
                    armature=rope.joint_armature,
                    limited=mujoco.mjtLimited.mjLIMITED_TRUE,
                    range=np.rad2deg([-rope.max_bend, rope.max_bend]).tolist(),
                )
        capsule = body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, 0, 0, step, 0, 0],
            size=[rope.radius, 0, 0],
            density=rope.density,
            friction=[rope.rope_friction, 0.005, 1e-4],
            solref=solref,
        )
        capsule.contype, capsule.conaffinity = ROPE_BIT, ROPE_BIT
        # Capsules touch each other; the table is touched by a sphere at each vertex, of which only
        # every second one rubs: friction costs four constraint rows a contact, support one.
        vertices = [(i, 0.0)] + [(rope.links, step)] * (i == rope.links - 1)
        for vertex, along in vertices:
            foot = body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                pos=[along, 0, 0],
                size=[rope.radius, 0, 0],
                mass=0.0,
                condim=3 if vertex % 2 == 0 else 1,
                friction=[rope.table_friction, 0.005, 1e-4],
                solref=solref,
            )
            foot.contype, foot.conaffinity = TABLE_BIT, 0
        body.add_site(name=f"vertex_{i}")
        body.add_site(name=f"grasp_{i}", pos=[step / 2, 0, 0])
    body.add_site(name=f"vertex_{rope.links}", pos=[step, 0, 0])
    for i in range(rope.links):
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"grasp_{i}",
            name2="gripper",
            active=False,
            solref=solref,
        )
    return spec.compile()


TABLE_BIT = 1
ROPE_BIT = 2


def pose(points: NDArray, rope: RopeConfig) -> NDArray[np.float64]:
    """Joint positions that put the rope where its vertices say.

    Each link's x axis points to the next vertex; hinge angles follow link by link from the
    direction of a link in the frame of the one before it.

    Args:
        points: (B, V, 3) metres, head first, world frame.

    Returns:
        qpos (B, nq): position and quaternion (w, x, y, z) of the head link, then two hinge angles
        (radians) for each further link.
    """
    points = check_points(points, rope)
    direction = np.diff(points, axis=1)  # (B, links, 3)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    count, links, _ = direction.shape
    qpos = np.empty((count, 7 + 2 * (links - 1)))
    qpos[:, :3] = points[:, 0]
    yaw, pitch = _angles(direction[:, 0])
    frame = _turn(yaw, pitch)  # (B, 3, 3), columns are the link's axes
    qpos[:, 3] = np.cos(yaw / 2) * np.cos(pitch / 2)
    qpos[:, 4] = -np.sin(yaw / 2) * np.sin(pitch / 2)
    qpos[:, 5] = np.cos(yaw / 2) * np.sin(pitch / 2)
    qpos[:, 6] = np.sin(yaw / 2) * np.cos(pitch / 2)
    for i in range(1, links):
        yaw, pitch = _angles(np.einsum("bji,bj->bi", frame, direction[:, i]))
        qpos[:, 5 + 2 * i], qpos[:, 6 + 2 * i] = yaw, pitch
        frame = frame @ _turn(yaw, pitch)
    return qpos


def _angles(direction: NDArray) -> tuple[NDArray, NDArray]:
    """Angles about z, then y, that turn the x axis into unit vectors (B, 3)."""
    yaw = np.arctan2(direction[:, 1], direction[:, 0])
    return yaw, -np.arcsin(np.clip(direction[:, 2], -1, 1))


def _turn(yaw: NDArray, pitch: NDArray) -> NDArray:
    """Rotation matrices (B, 3, 3) about z by `yaw`, then about the new y by `pitch`."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(yaw)
    return np.stack([cy * cp, -sy, cy * sp, sy * cp, cy, sy * sp, -sp, zero, cp], axis=-1).reshape(
        -1, 3, 3
    )
