"""An arm that executes plans: its MuJoCo model, its limits, and where it stands."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from knotflow.planning import Frame

if TYPE_CHECKING:
    import mujoco

HOMES_DRAWN, HOMES = 1024, 32
"""Configurations drawn, and kept, of an arm whose file has no keyframes."""
TABLE = "table"  # the geom that no part of the arm may touch
PREFIX = "arm/"  # before the names of the arm's own elements


class ArmError(ValueError):
    """An arm or a base that cannot be used."""


@dataclass
class Base:
    """Pose of an arm's base in the world frame."""

    position: Sequence[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Metres."""
    rpy_deg: Sequence[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Roll, pitch and yaw about the world's x, y and z, in this order; roll 180 hangs the arm."""

    def __post_init__(self) -> None:
        try:
            pose = np.array([self.position, self.rpy_deg], float)
        except (TypeError, ValueError):
            pose = np.empty(0)
        if pose.shape != (2, 3) or not np.isfinite(pose).all():
            raise ArmError(
                "a base has a position of three numbers in metres and rpy_deg, three in degrees, "
                f"got {self.position!r} and {self.rpy_deg!r}"
            )

    @classmethod
    def load(cls, path: Path) -> Base:
        """Read a YAML file with `position: [x, y, z]` and, if not 0, `rpy_deg: [r, p, y]`.

        Raises:
            ArmError: the file cannot be read, or holds no pose.
        """
        try:
            data = yaml.safe_load(Path(path).read_text("utf-8"))
            if not isinstance(data, dict):
                raise ValueError(f"it holds {data!r}")
            return cls(data.pop("position"), **data)
        except (ValueError, AttributeError, KeyError, TypeError, OSError, yaml.YAMLError) as error:
            raise ArmError(
                f"{path}: an arm's base is a YAML mapping with position: [x, y, z] in metres and "
                f"rpy_deg: [roll, pitch, yaw] in degrees, which cannot be read: {error}"
            ) from None

    def seen_from(self, frame: Frame) -> Base:
        """This base of a rope's frame, metres, in its plan's."""
        turn = Rotation.from_matrix(frame.rotation.T)
        turn *= Rotation.from_euler("xyz", self.rpy_deg, degrees=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # any of many at a pitch of 90 degrees
            rpy = turn.as_euler("xyz", degrees=True)
        return Base(frame.from_file(self.position).tolist(), rpy.tolist())


@dataclass(frozen=True)
class Arm:
    """An arm: its MuJoCo model, and what that does not say.

    Attributes:
        spec: makes its model, base frame at the origin.
        tip: site between the fingers, on a held rope's centre line; its z axis points out of the
            gripper, the fingers close along its y axis.
        joints: those that move the tip, from the base on.
        homes: (k, n) comfortable configurations, radians (metres for slides); the home is the one
            in which the gripper points down most.
        max_speed: (n,) of each joint, rad/s (m/s).
        max_acceleration: (n,) of each joint, rad/s^2 (m/s^2).
        gripper: name of the gripper's joint in trajectories.
        opening: its position when open as wide as a `HandConfig` says, and when closed.
    """

    name: str
    spec: Callable[[], mujoco.MjSpec]
    tip: str
    joints: tuple[str, ...]
    homes: NDArray[np.float64]
    max_speed: NDArray[np.float64]
    max_acceleration: NDArray[np.float64]
    base: Base = field(default_factory=Base)
    gripper: str = "gripper"
    opening: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("homes", "max_speed", "max_acceleration"):
            values = np.asarray(getattr(self, name), float)
            if values.shape[-1:] != (len(self.joints),) or not np.isfinite(values).all():
                raise ArmError(
                    f"arm {self.name}: {name} has a finite number for each of the "
                    f"{len(self.joints)} joints {', '.join(self.joints)}, got {values.tolist()}"
                )
            if name != "homes" and not (values > 0.0).all():
                raise ArmError(f"arm {self.name}: {name} must be above 0, got {values.tolist()}")

    def model(self, base: Base | None = None) -> mujoco.MjModel:
        """The arm and the table; the arm's names begin with `PREFIX`."""
        import mujoco

        base = base or self.base
        scene = mujoco.MjSpec()
        scene.worldbody.add_geom(name=TABLE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1])
        turn = Rotation.from_euler("xyz", base.rpy_deg, degrees=True)
        frame = scene.worldbody.add_frame(
            pos=list(base.position), quat=turn.as_quat(scalar_first=True)
        )
        scene.attach(self.spec(), prefix=PREFIX, frame=frame)
        return scene.compile()

    def joint_ids(self, model: mujoco.MjModel) -> list[int]:
        """Ids of `joints` in a `model`."""
        return [model.joint(PREFIX + name).id for name in self.joints]

    def tip_positions(self, joints: NDArray) -> NDArray[np.float64]:
        """Tip positions (N, 3) in configurations (N, n) by forward kinematics, metres."""
        import mujoco

        model = self.model()
        data, tip = mujoco.MjData(model), model.site(PREFIX + self.tip).id
        columns = model.jnt_qposadr[self.joint_ids(model)]
        positions = np.empty((len(joints), 3))
        for position, configuration in zip(positions, joints, strict=True):
            data.qpos[columns] = configuration
            mujoco.mj_kinematics(model, data)
            position[:] = data.site_xpos[tip]
        return positions


DATA = Path(__file__).parent / "data"


def panda() -> Arm:
    """The Panda beside the rope, leaning over it. Limits are Franka's, see panda.xml."""
    arm = load_arm(
        DATA / "panda.xml",
        base=Base([-0.45, 0.0, 0.2], [0.0, 30.0, 0.0]),
        max_speed=[2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61],
        max_acceleration=[15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
    )
    return replace(arm, gripper="panda_finger_joint1", opening=(0.025, 0.0))


def ur5e() -> Arm:
    """The UR5e on a wall, facing the rope; its joints turn by half a turn a second.

    Universal Robots limits torques, not accelerations: these are assumed, as of the xArm7.
    """
    base = Base([-0.3, 0.0, 0.65], [0.0, -90.0, 180.0])
    return load_arm(DATA / "ur5e.xml", base=base, max_speed=np.pi, max_acceleration=20.0)


def xarm7() -> Arm:
    """The xArm7 on a wall, facing the rope. Limits are UFACTORY's."""
    base = Base([-0.4, 0.0, 0.6], [0.0, 90.0, 0.0])
    return load_arm(DATA / "xarm7.xml", base=base, max_speed=np.pi, max_acceleration=20.0)


ARMS = {"panda": panda, "ur5e": ur5e, "xarm7": xarm7}
"""Arms known by name, at their default bases."""


def find_arm(arm: str | Path | Arm, tip: str | None = None) -> Arm:
    """An arm by its name in `ARMS` or its file, see `load_arm`.

    Raises:
        ArmError: as of `load_arm`, or a tip for an arm that has one.
    """
    if isinstance(arm, Arm):
        return arm
    if str(arm) not in ARMS:
        return load_arm(Path(arm), tip)
    if tip is not None:
        raise ArmError(
            f"--tip {tip}: the {arm} has its own gripper and tip; with another gripper, give the "
            "arm's file (MJCF or URDF)"
        )
    return ARMS[str(arm)]()


def load_arm(
    path: Path,
    tip: str | None = None,
    base: Base | None = None,
    max_speed: float | Sequence[float] | None = None,
    max_acceleration: float | Sequence[float] = 5.0,
) -> Arm:
    """An arm from an MJCF or URDF file.

    Its homes are the model's keyframes; without any, the middle of the joints' ranges and drawn
    configurations in which it moves freely. `tip` is the site or link between the fingers, see
    `Arm`, and needed where there are several. Limits are of all joints or of each, rad/s and
    rad/s^2 (m/s and m/s^2 for slides); by default a URDF's own speeds, else 1. Meshes of a URDF are
    left out: links without other collision geometry collide with nothing.

    Raises:
        ArmError: no such file, model, site or link, nothing that moves it, or a joint without name.
    """
    path = Path(path)
    if not path.is_file():
        raise ArmError(f"{path}: there is no such arm; give {', '.join(ARMS)}, MJCF or URDF")
    try:
        model = _read_model(path, tip).compile()
    except (ValueError, RuntimeError, ElementTree.ParseError) as error:
        raise ArmError(f"{path}: MuJoCo cannot read this arm: {error}") from None
    sites = [name for i in range(model.nsite) if (name := model.site(i).name)]
    if tip is None and len(sites) == 1:
        tip = sites[0]
    if tip is None or tip not in sites:
        links = [model.body(i).name for i in range(1, model.nbody)]
        raise ArmError(
            f"{path}: which site or link is between the fingers? "
            + ("Give --tip, one of " if tip is None else f"--tip {tip!r} is none of ")
            + ", ".join([*sites, *links])
        )
    chain = _joints_to(model, int(model.site(tip).bodyid[0]))
    if not chain:
        raise ArmError(f"{path}: no hinge or slide moves {tip!r}")
    joints = tuple(model.joint(one).name for one in chain)
    if not all(joints):
        raise ArmError(f"{path}: a joint that moves {tip!r} has no name")
    if max_speed is None:
        speeds = _urdf_speeds(path)
        max_speed = [speeds.get(name, 1.0) for name in joints]
    homes = model.key_qpos if model.nkey else _homes(model, tip, chain)
    return Arm(
        name=path.stem,
        spec=lambda: _read_model(path, tip),
        tip=tip,
        joints=joints,
        homes=homes[:, model.jnt_qposadr[chain]].copy(),
        max_speed=np.full(len(chain), max_speed),
        max_acceleration=np.full(len(chain), max_acceleration),
        base=base or Base(),
    )


def _read_model(path: Path, tip: str | None) -> mujoco.MjSpec:
    """An MJCF file, or a URDF without meshes; a `tip` that is a body gets a site of that name."""
    import mujoco

    if path.suffix.lower() == ".urdf":
        robot = ElementTree.parse(path).getroot()
        for link in robot.iter("link"):
            for part in [*link.iter("visual"), *link.iter("collision")]:
                if part.tag == "visual" or part.find("geometry/mesh") is not None:
                    link.remove(part)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, "unicode"))
        spec.compiler.fusestatic = False  # a tool's link is fixed to the last one
        spec.compiler.boundmass, spec.compiler.boundinertia = 1e-3, 1e-6
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    if tip is not None and spec.site(tip) is None and (body := spec.body(tip)) is not None:
        body.add_site(name=tip)
    return spec


def _urdf_speeds(path: Path) -> dict[str, float]:
    """Speed limits of a URDF's joints, rad/s or m/s; none of another file."""
    if path.suffix.lower() != ".urdf":
        return {}
    limits = {
        joint.get("name", ""): limit.get("velocity", "0")
        for joint in ElementTree.parse(path).getroot().iter("joint")
        for limit in joint.findall("limit")
    }
    try:
        speeds = {name: float(limit) for name, limit in limits.items()}
    except ValueError as error:
        raise ArmError(f"{path}: the velocity of a limit is a number: {error}") from None
    return {name: speed for name, speed in speeds.items() if speed > 0.0}


def _homes(model: mujoco.MjModel, tip: str, chain: Sequence[int]) -> NDArray[np.float64]:
    """Configurations (k, nq): amid the ranges, and the `HOMES` drawn ones in which the tip is
    furthest from where it cannot move or turn in every direction."""
    import mujoco

    limited = model.jnt_limited.astype(bool)
    middle = model.qpos0.copy()
    middle[model.jnt_qposadr[limited]] = model.jnt_range[limited].mean(axis=1)
    free = ~limited[chain, None]
    low, high = np.clip(np.where(free, [-np.pi, np.pi], model.jnt_range[chain]), -np.pi, np.pi).T
    data, site = mujoco.MjData(model), model.site(tip).id
    jacobian = np.empty((6, model.nv))
    columns, velocities = model.jnt_qposadr[chain], model.jnt_dofadr[chain]
    drawn = np.tile(middle, (HOMES_DRAWN, 1))
    drawn[:, columns] = np.random.default_rng(0).uniform(low, high, (HOMES_DRAWN, len(chain)))
    freedom = np.empty(HOMES_DRAWN)
    for number, data.qpos[:] in enumerate(drawn):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        freedom[number] = np.linalg.svd(jacobian[:, velocities], compute_uv=False).min()
    return np.vstack([middle, drawn[np.argsort(-freedom)[:HOMES]]])


def _joints_to(model: mujoco.MjModel, body: int) -> list[int]:
    """Hinges and slides between the world and a body, from the base on."""
    import mujoco

    found: list[int] = []
    while body:
        first = int(model.body_jntadr[body])
        found = [*range(first, first + int(model.body_jntnum[body])), *found]
        body = int(model.body_parentid[body])
    moving = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [joint for joint in found if int(model.jnt_type[joint]) in moving]
