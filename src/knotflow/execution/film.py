"""Images of executions and of rollouts: recorded and drawn (Fig. 1)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotflow.execution.robot import Robot, RobotWrapper
from knotflow.execution.twin import ERROR_LEVELS, displace_camera
from knotflow.samplers.demonstrations import Demonstration
from knotflow.simulation import Attempts, RopeConfig, RopeSimulator, SimulationConfig, attempt
from knotflow.viz.style import INK, WIDTH, save_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from knotflow.execution.closed_loop import Execution
    from knotflow.execution.twin import Twin
    from knotflow.perception import Camera, CameraNoiseConfig, RgbdImage

FRAME_STRIDE = 4  # of so many images one is kept
JPEG_QUALITY = 60
REFERENCE_COLOUR, TRACKED_COLOUR = "#ffd33d", "#ffffff"  # of the rope
MARGIN = 0.15  # of what is drawn, around the ropes

Window = tuple[float, float, float, float]
"""Left, top, right and bottom of a part of an image, pixels."""


class ImageRecorder(RobotWrapper):
    """A robot whose `images` are kept, in order."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self.images: list[RgbdImage] = []

    def observe(self) -> RgbdImage:
        self.images.append(super().observe())
        return self.images[-1]


@dataclass(frozen=True, eq=False)
class DragFrame:
    """A moment of a drag."""

    number: int  # of the robot's moves before
    step: int  # of the actions before
    image: RgbdImage


def drag_frames(execution: Execution, twin: Twin, images: Sequence[RgbdImage]) -> list[DragFrame]:
    """One in `FRAME_STRIDE` of the moments at which a rope was dragged, tracked and imaged."""
    by_time = {round(image.time, 6): image for image in images}
    dragged = np.isfinite(execution.reference[:, 0, 0]) & np.isfinite(execution.points[:, 0, 0])
    frames = [
        DragFrame(int(number), int(execution.step[number]), image)
        for number in np.flatnonzero(dragged)
        if (image := by_time.get(round(twin.times[number], 6))) is not None
    ]
    return frames[::FRAME_STRIDE]


def encode_jpeg(image: RgbdImage) -> bytes:
    """The file of an image's colours."""
    file = io.BytesIO()
    Image.fromarray(image.rgb).save(file, "jpeg", quality=JPEG_QUALITY)
    return file.getvalue()


def draw_execution(
    path: Path, execution: Execution, camera: Camera, frames: Sequence[DragFrame], last: RgbdImage
) -> None:
    """Draw the images around the ropes: one amid each drag, and the last observation's."""
    from matplotlib.figure import Figure

    left, top, right, bottom = _window(execution, camera, frames)
    drags = [[*drag] for _, drag in groupby(frames, key=lambda frame: frame.step)]
    middles = [drag[len(drag) // 2] for drag in drags]
    columns = min(4, len(middles) + 1)
    lines = -(-(len(middles) + 1) // columns)
    with styled():
        figure = Figure((WIDTH, (0.85 * WIDTH / columns + 0.1) * lines), layout="constrained")
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for axes in panels:
            axes.set_axis_off()
        for number, (axes, frame) in enumerate(zip(panels, middles, strict=False), 1):
            axes.imshow(frame.image.rgb)
            reference = camera.project(execution.reference[frame.number])[:, :2].T
            for colour, width in ((INK, 1.8), (REFERENCE_COLOUR, 0.9)):
                axes.plot(*reference, color=colour, linewidth=width)
            _draw_tracked(axes, camera, execution.points[frame.number])
            axes.set_title(f"{number}.  {execution.outcomes[frame.step].step.action}")
        axes = panels[len(middles)]
        axes.imshow(last.rgb)
        if execution.observation is not None and execution.observation.points is not None:
            _draw_tracked(axes, camera, execution.observation.points)
        axes.set_title("tied" if execution.tied else "stopped")
        for axes in panels:
            axes.set(xlim=(left, right), ylim=(bottom, top))
        save_figure(figure, path)


def _window(execution: Execution, camera: Camera, frames: Sequence[DragFrame]) -> Window:
    """The part of the images around all ropes, in the images' proportions."""
    rows = [frame.number for frame in frames]
    ropes = np.concatenate([execution.reference[rows], execution.points[rows]])
    pixels = camera.project(ropes.reshape(-1, 3))[:, :2]
    size = np.array([camera.width, camera.height])
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    half = size * min(0.5, (0.5 + MARGIN) * float(((high - low) / size).max()))
    middle = np.clip((low + high) / 2, half, size - half)
    return (*(middle - half).tolist(), *(middle + half).tolist())


def _draw_tracked(axes: Axes, camera: Camera, points: NDArray[np.float64]) -> None:
    pixels = camera.project(points)[:, :2].T
    axes.plot(*pixels, "o", markersize=2.2, color=TRACKED_COLOUR, mec=INK, mew=0.4)


def film_rollout(
    demonstrations: Sequence[Demonstration],
    rope: RopeConfig,
    level: int,
    simulation: SimulationConfig,
    noise: CameraNoiseConfig,
    rng: np.random.Generator,
) -> tuple[Attempts, list[RgbdImage], Camera]:
    """One of an action's demonstrations, on a `rope` other than that of the `simulation`.

    The simulation's record rate is the camera's; `level` is of its pose error (`ERROR_LEVELS`).

    Returns:
        the rollout; its images, one a frame and one of the end without the gripper; the camera at
        its true pose.
    """
    from knotflow.perception import Appearance, Camera, SimulatedCamera

    simulator, attempts = RopeSimulator(replace(simulation, rope=rope)), None
    while attempts is None or attempts.rollouts.diverged.any():
        one = demonstrations[int(rng.integers(len(demonstrations)))]
        points = one.points + [0.0, 0.0, rope.radius - simulation.rope.radius]
        task = one.task
        attempts = attempt(simulator, points, one.spline[None], task.action, task.start_state)
    rollouts = attempts.rollouts
    camera = displace_camera(Camera.overhead(), ERROR_LEVELS[level], rng)
    simulated = SimulatedCamera(camera, rope, noise, Appearance.draw(rng, noise))
    times = [*rollouts.times, rollouts.times[-1] + 1 / simulation.record_rate]
    ropes = rollouts.trajectory[0].astype(np.float64)
    ropes, grippers = [*ropes, ropes[-1]], [*rollouts.gripper[0], None]
    images = []
    for seconds, points, gripper in zip(times, ropes, grippers, strict=True):
        closed = bool(0 < seconds < rollouts.release_times[0])
        images.append(simulated.capture(points, rng, gripper, closed, float(seconds)))
    return attempts, images, camera
