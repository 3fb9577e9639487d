"""The simulated camera: RGB and depth of rope, table and gripper, by casting rays.

MuJoCo casts a ray a pixel against capsules, boxes and the table: no OpenGL, no display.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.perception.appearance import HEAD_LENGTH, Appearance
from knotflow.perception.camera import Camera
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.noise import CameraNoiseConfig, add_noise
from knotflow.simulation import RopeConfig, check_points

if TYPE_CHECKING:
    import mujoco

FINGER = (0.014, 0.008, 0.060)
"""Size of a finger, metres: along the rope it holds, across, and upwards."""
PALM = (0.030, 0.090, 0.050)
"""Size of the palm that carries the fingers, metres."""
WRIST = (0.025, 0.120)
"""Radius and length of the wrist above the palm, metres."""
OPEN = 0.050
"""Distance between the open fingers, metres; closed they touch the rope."""


@dataclass(frozen=True, eq=False)
class View:
    """A perfect image and what each of its pixels shows.

    Attributes:
        image: RGB and depth without noise.
        labels: (H, W) uint8, see `Label`.
    """

    image: RgbdImage
    labels: NDArray[np.uint8]


class SimulatedCamera:
    """A camera that looks at simulated ropes.

    The gripper has two fingers, a palm and a wrist, which hide what is behind them. It points
    straight down and its fingers close across the link nearest to it.
    """

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        noise: CameraNoiseConfig | None = None,
        appearance: Appearance | None = None,
    ) -> None:
        """A camera for one rope; `appearance` may be set anew between images."""
        import mujoco

        self.camera, self.rope = camera, rope
        self.noise = noise or CameraNoiseConfig()
        self.appearance = appearance or Appearance()
        self._model = _scene(rope)
        self._data = mujoco.MjData(self._model)
        self._rays = camera.rays()
        self._depth_per_distance = self._rays @ camera.rotation[:, 2]
        links = np.arange(self._model.ngeom) - 1  # geom 0 is the table
        self._labels = np.where(links < rope.links, Label.ROPE, Label.GRIPPER).astype(np.uint8)
        self._labels[0] = Label.TABLE
        self._head = (links >= 0) & (links < round(HEAD_LENGTH / rope.link_length))

    def capture(
        self,
        points: NDArray,
        rng: np.random.Generator,
        gripper: ArrayLike | None = None,
        closed: bool = True,
        time: float = 0.0,
    ) -> RgbdImage:
        """An image of a rope, with noise.

        Args:
            points: (V, 3) rope vertices, metres, head first, world frame.
            rng: draws the noise.
            gripper: (3,) metres, the point between the fingertips (the grasped point of the rope's
                centre line); None is out of view.
            closed: whether the fingers are closed on the rope.
            time: seconds.

        Raises:
            ShapeError: for points that are not a shape of this rope.
        """
        return add_noise(
            self.view(points, gripper, closed, time).image, self.camera, self.noise, rng
        )

    def view(
        self,
        points: NDArray,
        gripper: ArrayLike | None = None,
        closed: bool = True,
        time: float = 0.0,
    ) -> View:
        """The image without noise, and what each pixel shows; arguments as in `capture`."""
        import mujoco

        self._place(check_points(points, self.rope), gripper, closed)
        height, width = self.camera.height, self.camera.width
        geom = np.empty((height, width), np.int32)
        distance, normals = np.empty((height, width)), np.empty((height, width, 3))
        mujoco.mj_multiRay(
            self._model,
            self._data,
            self.camera.position,
            self._rays.ravel(),
            np.array([1, gripper is not None, 0, 0, 0, 0], np.uint8),
            True,
            -1,
            geom.ravel(),
            distance.ravel(),
            normals.ravel(),
            width * height,
            mujoco.mjMAXVAL,
        )
        seen = geom >= 0
        labels = np.where(seen, self._labels[geom], Label.UNKNOWN).astype(np.uint8)
        rgb = self.appearance.shade(
            labels,
            seen & self._head[geom],
            normals,
            self.camera.position + distance[..., None] * self._rays,
        )
        depth = np.where(seen, distance * self._depth_per_distance, np.nan).astype(np.float32)
        return View(RgbdImage(rgb, depth, time), labels)

    def _place(self, points: NDArray, gripper: ArrayLike | None, closed: bool) -> None:
        """Moves the scene's bodies: links first, then palm and both fingers."""
        import mujoco

        links = self.rope.links
        position, quaternion = self._data.mocap_pos, self._data.mocap_quat
        direction = np.diff(points, axis=0)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        position[:links] = 0.5 * (points[1:] + points[:-1])
        quaternion[:links] = _from_z(direction)
        if gripper is not None:
            at = np.asarray(gripper, np.float64)
            nearest = int(np.linalg.norm(position[:links] - at, axis=1).argmin())
            yaw = np.arctan2(direction[nearest, 1], direction[nearest, 0])
            across = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
            gap = 2 * self.rope.radius if closed else OPEN
            side = 0.5 * (gap + FINGER[1]) * across
            position[links:] = at, at + side, at - side
            quaternion[links:] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        mujoco.mj_kinematics(self._model, self._data)


def _scene(rope: RopeConfig) -> mujoco.MjModel:
    """Table, links, palm and fingers as bodies that are put where they are seen."""
    import mujoco

    spec = mujoco.MjSpec()
    box, capsule = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CAPSULE
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    for _ in range(rope.links):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=capsule, size=[rope.radius, rope.link_length / 2, 0]
        )
    bottom = FINGER[2] - rope.radius  # of the palm; the fingertips reach the table
    palm = spec.worldbody.add_body(mocap=True)
    palm.add_geom(type=box, size=np.array(PALM) / 2, pos=[0, 0, bottom + PALM[2] / 2], group=1)
    palm.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[WRIST[0], WRIST[1] / 2, 0],
        pos=[0, 0, bottom + PALM[2] + WRIST[1] / 2],
        group=1,
    )
    for _ in range(2):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=box, size=np.array(FINGER) / 2, pos=[0, 0, bottom - FINGER[2] / 2], group=1
        )
    return spec.compile()


def _from_z(direction: NDArray) -> NDArray[np.float64]:
    """Quaternions (N, 4), w first, that turn the z axis into unit vectors (N, 3)."""
    x, y, z = direction.T
    quaternion = np.column_stack([1.0 + z, -y, x, np.zeros_like(z)])
    quaternion[z < -1 + 1e-9] = 0.0, 1.0, 0.0, 0.0
    return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
