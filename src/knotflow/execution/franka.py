"""The Franka Emika Panda with its hand, as capsules on the published kinematics.

Denavit-Hartenberg parameters in Craig's convention, joint limits, speeds and accelerations are
those of Franka's interface documentation ("Robot and interface specifications",
https://frankaemika.github.io/docs/control_parameters.html). They were compared with those of the
crate franka_rust 0.1.14 (`franka_emika.rs`: limits, speeds, accelerations) and of rai-robotModels
(`panda_clean.g`, made of franka_description: limits, speeds, offsets of the joints), and agree.
Capsules are about as thick as the links they stand for; there are no meshes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from knotflow.execution.arm import Arm, Base

if TYPE_CHECKING:
    import mujoco

# a (m), d (m), alpha (rad) of each joint, then of the flange.
_DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
)
_RANGE = (
    (-2.8973, 2.8973),
    (-1.7628, 1.7628),
    (-2.8973, 2.8973),
    (-3.0718, -0.0698),
    (-2.8973, 2.8973),
    (-0.0175, 3.7525),
    (-2.8973, 2.8973),
)
_MAX_SPEED = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
_MAX_ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
_HOMES = (
    (0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4),  # Franka's ready pose
    (0.0, -1.5, 0.0, -1.0, 0.0, np.pi - 0.5, np.pi / 4),  # hanging: the elbow back and up
    (0.0, -0.3, 0.0, -1.9, 0.0, np.pi / 2 + 1.6, np.pi / 4),  # from a wall: the forearm down
)

FINGER_END = 0.1114
"""From the flange to the fingers' ends, metres."""
TIP = FINGER_END - 0.006
"""From the flange to the grasped point, metres: the fingers end 2 mm above the table when they
hold a rope of 8 mm radius that lies on it."""

# Body 0 is the base, 1 to 7 the links, 8 the hand: begin, end and radius of capsules, metres, in
# the body's frame.
_CAPSULES = (
    (0, (-0.08, 0.0, 0.065), (0.0, 0.0, 0.065), 0.065),
    (1, (0.0, 0.0, -0.19), (0.0, 0.0, 0.0), 0.06),
    (2, (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),
    (3, (0.0, 0.0, -0.19), (0.0, 0.0, -0.06), 0.06),
    (3, (0.0825, 0.0, -0.02), (0.0825, 0.0, 0.02), 0.055),
    (4, (0.0, 0.0, -0.05), (0.0, 0.0, 0.05), 0.06),
    (5, (0.0, 0.0, -0.26), (0.0, 0.02, -0.19), 0.06),
    (5, (0.0, 0.06, -0.18), (0.0, 0.08, -0.02), 0.035),
    (6, (0.0, 0.0, -0.04), (0.0, 0.0, 0.03), 0.05),
    (6, (0.088, 0.0, 0.0), (0.088, 0.0, 0.02), 0.05),
    (7, (0.0, 0.0, 0.05), (0.0, 0.0, 0.08), 0.045),
    (8, (0.0, -0.07, 0.035), (0.0, 0.07, 0.035), 0.03),
    # Fingers, 24 mm apart: a rope of 16 mm goes between them.
    (8, (0.0, -0.022, 0.06), (0.0, -0.022, FINGER_END - 0.010), 0.010),
    (8, (0.0, 0.022, 0.06), (0.0, 0.022, FINGER_END - 0.010), 0.010),
)


def panda() -> Arm:
    """The Panda hanging 0.9 m above the table, its base 0.3 m beside the middle of the rope.

    Every grasp and release of five overhand plans can be reached from each of several bases; what
    fails is to follow the paths between them, where the first joint comes to its end. Hanging with
    the elbow behind it the arm works on the side opposite to its x axis, so the base is turned by
    half a turn, away from the rope: the 28 degrees that the first joint lacks then lie outside of
    most plans. Of the hanging bases tried (0 to 0.35 m beside, 0.65 to 1 m above, turned and not)
    it reached most of eight plans; of 12 overhand plans in random ropes, at 0.25 m/s, 10 fully.
    Upright it cannot fold to the near end of a rope 1 m long and stretch to the far end too.
    """
    return Arm(
        name="panda",
        spec=_spec,
        tip="tip",
        joints=tuple(f"panda_joint{i}" for i in range(1, 8)),
        homes=np.array(_HOMES),
        max_speed=np.array(_MAX_SPEED),
        max_acceleration=np.array(_MAX_ACCELERATION),
        base=Base([-0.3, 0.0, 0.9], [180.0, 0.0, 180.0]),
        gripper="panda_finger_joint1",
        opening=(0.012, 0.008),
    )


def _spec() -> mujoco.MjSpec:
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.modelname = "panda"
    bodies = [spec.worldbody.add_body(name="panda_link0")]
    for i, (a, d, alpha) in enumerate(_DH, start=1):
        rotation = [np.cos(alpha / 2), np.sin(alpha / 2), 0.0, 0.0]
        offset = [a, -d * np.sin(alpha), d * np.cos(alpha)]
        if i == len(_DH):  # the hand is mounted turned by -45 degrees
            rotation = [np.cos(np.pi / 8), 0.0, 0.0, -np.sin(np.pi / 8)]
        name = "panda_hand" if i == len(_DH) else f"panda_link{i}"
        body = bodies[-1].add_body(name=name, pos=offset, quat=rotation)
        if i < len(_DH):
            body.add_joint(name=f"panda_joint{i}", axis=[0, 0, 1], range=_RANGE[i - 1], limited=1)
        bodies.append(body)
    bodies[-1].add_site(name="tip", pos=[0.0, 0.0, TIP])
    for i, (body, begin, end, radius) in enumerate(_CAPSULES):
        bodies[body].add_geom(
            name=f"capsule{i}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*begin, *end],
            size=[radius, 0.0, 0.0],
            mass=0.5,
        )
    return spec
