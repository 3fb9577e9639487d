"""The simulated camera: appearance, RGB and depth of rope, table and gripper, by MuJoCo's rays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from knotflow.perception.camera.image import CameraNoiseConfig, Label, RgbdImage, add_noise
from knotflow.perception.camera.pinhole import Camera
from knotflow.simulation import RopeConfig, check_points

if TYPE_CHECKING:
    import mujoco

Colour = tuple[float, ...]

TAPE: Colour = (0.85, 0.10, 0.12)  # red tape around the rope's head
_HEAD_LENGTH = 0.05  # metres: two turns of tape
_FINGER = (0.014, 0.008, 0.060)  # size, metres: along the rope it holds, across, and upwards
_PALM = (0.030, 0.090, 0.050)  # size of the palm that carries the fingers, metres
_WRIST = (0.025, 0.120)  # radius and length above the palm, metres
_OPEN = 0.050  # metres between the open fingers; closed they touch the rope


@dataclass(frozen=True)
class Appearance:
    """Colours (sRGB, 0 to 1) of rope, table and gripper, and the light (world frame, z up)."""

    rope: Colour = (0.85, 0.80, 0.68)
    table: Colour = (0.28, 0.36, 0.38)
    gripper: Colour = (0.12, 0.12, 0.13)
    head: Colour | None = None
    """Colour of the rope's first 50 mm; None is a rope whose ends look alike."""
    light: tuple[float, ...] = (0.2, -0.3, 1.0)
    """Direction towards the light."""
    ambient: float = 0.5
    """Share of the light that comes from everywhere, 0 to 1."""
    brightness: Colour = (1.0, 1.0, 1.0)
    """Strength of the light in red, green and blue: exposure and white balance."""
    grain: tuple[tuple[float, ...], ...] = ()
    """The table's grain: waves of brightness, each a wave vector x and y (1/m), phase (radians) and
    amplitude (share of the brightness)."""

    @classmethod
    def draw(cls, rng: np.random.Generator, noise: CameraNoiseConfig) -> Appearance:
        """Colours, apart by `noise.contrast / noise.level`, and light; at level 0 the default."""
        head = TAPE if noise.coloured_head else None
        level = noise.level
        if level == 0:
            return cls(head=head)
        while True:
            rope, table = rng.uniform(0.05, 0.95, (2, 3))
            shades = [rope, table, *([np.array(head)] if head else [])]
            apart = [np.linalg.norm(a - b) for i, a in enumerate(shades) for b in shades[:i]]
            if min(apart) >= noise.contrast / level:
                break
        tilt, azimuth = level * rng.uniform(0.0, noise.light_tilt), rng.uniform(0.0, 2 * np.pi)
        waves, angle = 4, rng.uniform(0.0, np.pi)
        length = rng.uniform(0.02, 0.3, waves)
        turn = angle + rng.normal(0.0, 0.2, waves)
        grain = np.column_stack(
            [
                2 * np.pi * np.cos(turn) / length,
                2 * np.pi * np.sin(turn) / length,
                rng.uniform(0.0, 2 * np.pi, waves),
                level * noise.grain * rng.uniform(0.0, 1.0, waves),
            ]
        )
        return cls(
            rope=tuple(rope),
            table=tuple(table),
            gripper=tuple(rng.uniform(0.05, 0.25) + rng.uniform(-0.03, 0.03, 3)),
            head=head,
            light=(np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)),
            ambient=rng.uniform(0.35, 0.65),
            brightness=tuple(
                rng.uniform(0.75, 1.0) + level * rng.normal(0, noise.white_balance, 3)
            ),
            grain=tuple(map(tuple, grain)),
        )

    def shade(
        self, labels: NDArray[np.uint8], head: NDArray[np.bool_], normals: NDArray, points: NDArray
    ) -> NDArray[np.uint8]:
        """The colours (H, W, 3), by Lambert's law, of `labels` (H, W), of the rope's head (H, W),
        at `points` (H, W, 3), metres, with unit `normals` (H, W, 3), world frame."""
        black = (0.0, 0.0, 0.0)
        rgb = np.array([black, self.table, self.rope, self.gripper])[labels]  # as in `Label`
        if self.head is not None:
            rgb[head] = self.head
        light = np.array(self.light) / np.linalg.norm(self.light)
        shade = self.ambient + (1.0 - self.ambient) * (normals @ light).clip(0.0)
        table = labels == Label.TABLE
        x, y, _ = points[table].T
        for across, up, phase, amplitude in self.grain:
            shade[table] *= 1.0 + amplitude * np.sin(across * x + up * y + phase)
        rgb *= shade[..., None] * np.array(self.brightness)
        return np.rint(255.0 * rgb.clip(0.0, 1.0)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class View:
    """An image without noise, and the `Label` (H, W) of each pixel."""

    image: RgbdImage
    labels: NDArray[np.uint8]


class SimulatedCamera:
    """A camera that looks at simulated ropes, and a gripper that points straight down, its fingers
    across the link nearest to it."""

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        noise: CameraNoiseConfig | None = None,
        appearance: Appearance | None = None,
    ) -> None:
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
        self._head = (links >= 0) & (links < round(_HEAD_LENGTH / rope.link_length))
        self._table = self._draw_table()

    def capture(
        self,
        points: NDArray,
        rng: np.random.Generator,
        gripper: ArrayLike | None = None,
        closed: bool = True,
        time: float = 0.0,
    ) -> RgbdImage:
        """An image with noise of a rope (V, 3), metres, head first, and of a gripper, by the point
        (3,) between its fingertips, metres, unless it is out of view.

        Raises:
            ShapeError: for points that are not a shape of this rope.
        """
        image = self.view(points, gripper, closed, time).image
        return add_noise(image, self.camera, self.noise, rng)

    def view(
        self,
        points: NDArray,
        gripper: ArrayLike | None = None,
        closed: bool = True,
        time: float = 0.0,
    ) -> View:
        """The image without noise; arguments as in `capture`."""
        self._place(check_points(points, self.rope), gripper, closed)
        labels, rgb, depth = self._table[0].copy(), self._table[1].copy(), self._table[2].copy()
        window = self._window(gripper is not None)
        rays = np.ascontiguousarray(self._rays[window])
        if rays.size:
            geom, distance, normals = self._cast(rays, gripper is not None)
            seen = geom >= 0
            labels[window] = np.where(seen, self._labels[geom], Label.UNKNOWN)
            points = self.camera.position + distance[..., None] * rays
            head = seen & self._head[geom]
            rgb[window] = self.appearance.shade(labels[window], head, normals, points)
            along = distance * self._depth_per_distance[window]
            depth[window] = np.where(seen, along, np.nan)
        return View(RgbdImage(rgb, depth, time), labels)

    def _draw_table(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]:
        """Labels, colours and depth of the table alone."""
        with np.errstate(divide="ignore"):
            distance = -self.camera.position[2] / self._rays[..., 2]
        seen = (distance > 0) & np.isfinite(distance)
        distance = np.where(seen, distance, 0.0)
        labels = np.where(seen, Label.TABLE, Label.UNKNOWN).astype(np.uint8)
        normals = np.broadcast_to([0.0, 0.0, 1.0], self._rays.shape)
        points = self.camera.position + distance[..., None] * self._rays
        rgb = self.appearance.shade(labels, np.zeros_like(seen), normals, points)
        depth = np.where(seen, distance * self._depth_per_distance, np.nan).astype(np.float32)
        return labels, rgb, depth

    def _cast(
        self, rays: NDArray, gripper: bool
    ) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
        """Geom (H, W) that rays (H, W, 3) hit, -1 is none, distance (H, W), normal (H, W, 3)."""
        import mujoco

        geom = np.empty(rays.shape[:2], np.int32)
        distance, normals = np.empty(rays.shape[:2]), np.empty(rays.shape)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            self.camera.position,
            rays.ravel(),
            np.array([1, gripper, 0, 0, 0, 0], np.uint8),
            True,
            -1,
            geom.ravel(),
            distance.ravel(),
            normals.ravel(),
            geom.size,
            mujoco.mjMAXVAL,
        )
        return geom, distance, normals

    def _window(self, gripper: bool) -> tuple[slice, slice]:
        """Rows and columns around all links and parts of the gripper; elsewhere is bare table."""
        geoms = slice(1, None if gripper else 1 + self.rope.links)
        corners = (
            np.array([*product((-1, 1), repeat=3)]) * self._model.geom_rbound[geoms, None, None]
        )
        pixels = self.camera.project(self._data.geom_xpos[geoms, None] + corners).reshape(-1, 3)
        if pixels[:, 2].min() <= 0:
            return slice(None), slice(None)  # beside or behind the camera
        size = [self.camera.width, self.camera.height]
        low = np.clip(np.floor(pixels[:, :2].min(axis=0)), 0, size).astype(int)
        high = np.clip(np.ceil(pixels[:, :2].max(axis=0)) + 1, 0, size).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])

    def _place(self, points: NDArray, gripper: ArrayLike | None, closed: bool) -> None:
        """Move the scene's bodies: links first, then palm and both fingers."""
        import mujoco

        links = self.rope.links
        position, quaternion = self._data.mocap_pos, self._data.mocap_quat
        direction = np.diff(points, axis=0)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        position[:links] = 0.5 * (points[1:] + points[:-1])
        quaternion[:links] = from_z(direction)
        if gripper is not None:
            at = np.asarray(gripper, np.float64)
            nearest = int(np.linalg.norm(position[:links] - at, axis=1).argmin())
            yaw = np.arctan2(direction[nearest, 1], direction[nearest, 0])
            across = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
            gap = 2 * self.rope.radius if closed else _OPEN
            side = 0.5 * (gap + _FINGER[1]) * across
            position[links:] = at, at + side, at - side
            quaternion[links:] = np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)
        mujoco.mj_kinematics(self._model, self._data)


def _scene(rope: RopeConfig) -> mujoco.MjModel:
    """Table, links, palm and fingers as mocap bodies."""
    import mujoco

    spec = mujoco.MjSpec()
    box, capsule = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CAPSULE
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    for _ in range(rope.links):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=capsule, size=[rope.radius, rope.link_length / 2, 0]
        )
    bottom = _FINGER[2] - rope.radius  # of the palm; the fingertips reach the table
    palm = spec.worldbody.add_body(mocap=True)
    palm.add_geom(type=box, size=np.array(_PALM) / 2, pos=[0, 0, bottom + _PALM[2] / 2], group=1)
    palm.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[_WRIST[0], _WRIST[1] / 2, 0],
        pos=[0, 0, bottom + _PALM[2] + _WRIST[1] / 2],
        group=1,
    )
    for _ in range(2):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=box, size=np.array(_FINGER) / 2, pos=[0, 0, bottom - _FINGER[2] / 2], group=1
        )
    return spec.compile()


def from_z(direction: NDArray) -> NDArray[np.float64]:
    """Quaternions (N, 4), w first, that turn the z axis into unit vectors (N, 3)."""
    x, y, z = direction.T
    quaternion = np.column_stack([1.0 + z, -y, x, np.zeros_like(z)])
    quaternion[z < -1 + 1e-9] = 0.0, 1.0, 0.0, 0.0
    return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
