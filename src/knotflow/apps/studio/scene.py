"""The scene in the browser: table, rope, gripper and spline, drawn with viser."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotflow.apps.studio.demonstration import CLICKS
from knotflow.perception.camera.simulated import from_z
from knotflow.simulation import SPLINE_HIGH, RopeConfig, spline_path
from knotflow.topology import Action, segment_intervals
from knotflow.viz.style import BAD, GOOD, INK, MUTED, OVER, PAPER, RULE, SPLINE, UNDER, rope_colour

if TYPE_CHECKING:
    import viser

CAMERA = (0.0, -0.52, 1.74)  # metres, at first: almost from above, as on the paper's images
FIELD_OF_VIEW = float(np.deg2rad(40.0))  # vertical
_FADED = 0.75  # towards paper: the segments that an action does not name
_POINT = 0.012  # metres, radius of a control point
_PICTURE = 0.001  # metres above the table
_CURVE = np.linspace(0.0, 1.0, 33)


def _exclusive(draw: Callable[..., None]) -> Callable[..., None]:
    """One drawing at a time: viser handles events on several threads."""

    @wraps(draw)
    def run(scene: Scene, *args: Any) -> None:
        with scene._lock:
            draw(scene, *args)

    return run


class Scene:
    """Draws ropes, splines and grippers, each in place of the previous one.

    Attributes:
        size: of the ropes that are drawn next.
    """

    def __init__(self, server: viser.ViserServer, rope: RopeConfig) -> None:
        """An empty table under a rope of that size."""
        self._scene, self._lock = server.scene, RLock()
        self.size = rope
        self._handles: dict[str, list[viser.SceneNodeHandle]] = {}
        self._links: viser.BatchedMeshHandle | None = None
        self._held: viser.BatchedMeshHandle | None = None
        server.scene.set_up_direction("+z")
        server.initial_camera.position = CAMERA
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.initial_camera.fov = FIELD_OF_VIEW
        reach = 2 * float(SPLINE_HIGH[-1])
        size, place, colour = (reach, reach, 0.01), (0.0, 0.0, -0.0065), rgb(RULE)
        self._scene.add_box("/table", rgb("#f6f8fa"), size, position=place, cast_shadow=False)
        self._scene.add_grid(
            "/grid", width=reach, height=reach, plane="xy", cell_size=0.1, section_size=0.1,
            cell_color=colour, section_color=colour,
        )  # fmt: skip

    @_exclusive
    def rope(self, points: NDArray, action: Action | None = None) -> None:
        """A rope (V, 3), metres; an action's segments stand out, numbered."""
        points = np.asarray(points, float)
        labels = [("head", points[0]), ("tail", points[-1])]
        colours = _colours(len(points) - 1)
        if action is not None:
            colours += _FADED * (np.array(rgb(PAPER)) - colours)
            along = np.linspace(0.0, 1.0, len(points))
            middles = (np.arange(len(colours)) + 0.5) / len(colours)
            over, under = action.over_segment, action.under_segment
            chosen = {under: ("under", UNDER), over: ("over", OVER)}
            if over == under:
                chosen = {over: ("over itself", OVER)}
            for segment, (word, colour) in chosen.items():
                low, high = segment_intervals(points)[segment]
                colours[(middles >= low) & (middles <= high)] = rgb(colour)
                place = [np.interp((low + high) / 2, along, column) for column in points.T]
                labels.append((f"{segment}: {word}", np.array(place)))
        self._capsules(points, colours)
        self._clear("labels")
        self._handles["labels"] = self._labels("rope", labels)

    @_exclusive
    def move(self, points: NDArray) -> None:
        """Move the rope to (V, 3), in its colours but without labels."""
        self._clear("labels")
        self._capsules(np.asarray(points, float), None)

    @_exclusive
    def spline(self, controls: NDArray) -> None:
        """Up to three control points (n, 3), metres, and with three of them their curve."""
        self._clear("spline")
        labels = list(zip(CLICKS, np.asarray(controls, float), strict=False))
        nodes = self._labels("spline", labels)
        nodes += [self._ball(f"/spline/{name}", _POINT, SPLINE, place) for name, place in labels]
        if len(controls) > 1:  # how high the middle is
            foot = controls[1] * (1.0, 1.0, 0.0)
            nodes.append(self._line("/spline/stem", np.stack([foot, controls[1]]), MUTED, 2.0))
        if len(controls) == len(CLICKS):
            nodes.append(self._line("/spline/curve", spline_path(controls, _CURVE), SPLINE, 5.0))
        self._handles["spline"] = nodes

    @_exclusive
    def gripper(self, place: NDArray | None) -> None:
        """The gripper at a place (3,), metres, or none."""
        if place is None:
            self._clear("gripper")
        elif "gripper" in self._handles:
            self._handles["gripper"][0].position = np.asarray(place, float)
        else:
            self._handles["gripper"] = [self._ball("/gripper", 0.018, "#d4a72c", place, 0.8)]

    @_exclusive
    def polyline(self, corners: NDArray) -> None:
        """A drawing in the making: points (N, 2) on the table."""
        self._clear("polyline")
        flat = np.column_stack([corners, np.full(len(corners), self.size.radius)])
        balls = [self._ball(f"/drawn/{n}", 0.006, INK, place) for n, place in enumerate(flat)]
        lines = [self._line("/drawn/line", flat, INK, 3.0)] if len(flat) > 1 else []
        self._handles["polyline"] = [*balls, *lines]

    @_exclusive
    def picture(self, rgb: NDArray[np.uint8], size: NDArray, middle: NDArray) -> None:
        """An image (H, W, 3) on the table, its size (2,) and middle (2,) in metres."""
        flat = self._scene.add_image(
            "/picture", rgb, *size, cast_shadow=False, receive_shadow=False,
            wxyz=(0.0, 1.0, 0.0, 0.0), position=(*middle, _PICTURE),
        )  # fmt: skip
        self._handles["picture"] = [flat]

    @_exclusive
    def centre_line(self, pieces: NDArray, along: NDArray) -> None:
        """Pieces (N, 2, 2) of a rope's centre line on the picture, metres, at fractions (N,) of its
        length, in place of the rope."""
        if self._links is not None:
            self._links.visible = False
        raised = np.pad(pieces, ((0, 0), (0, 0), (0, 1)), constant_values=_PICTURE + 0.001)
        colours = np.array([[rgb(rope_colour(place))] * 2 for place in along], np.uint8)
        line = self._scene.add_line_segments(
            "/centre_line", raised, colors=colours, thickness=4.0, thickness_units="screen"
        )
        self._handles["centre line"] = [line]

    @_exclusive
    def handles(
        self, places: NDArray, radius: float, on_drag: Callable[..., Any] | None = None
    ) -> None:
        """Discs at places (K, 2), metres, by which a centre line is dragged; without a callback
        those that are there are moved."""
        raised = np.pad(places, ((0, 0), (0, 1)), constant_values=_PICTURE + 0.002)
        if on_drag is not None:
            self._held = self._discs("/held", raised, radius, [rgb(PAPER)] * len(raised), 0.85)
            self._held.on_drag("left")(on_drag)
            self._handles["handles"] = [self._held]
        elif self._held is not None:
            self._held.batched_positions = raised

    @_exclusive
    def crossings(
        self,
        places: NDArray,
        radius: float,
        sure: list[bool],
        on_click: Callable[..., Any],
        ends: NDArray,
    ) -> None:
        """Numbered discs at crossings (C, 2), another colour where they are in doubt, and labels at
        the ends (2, 2), head first; metres."""
        self._clear("crossings")
        self._clear("labels")
        raised = np.pad(places, ((0, 0), (0, 1)), constant_values=_PICTURE + 0.003)
        names = [f"{n}{'' if one else '?'}" for n, one in enumerate(sure, 1)]
        texts = [*names, "head", "tail"]
        tops = np.pad([*places, *ends], ((0, 0), (0, 1))) + [0.0, radius, _PICTURE]
        labels = list(zip(texts, tops, strict=True))
        self._handles["labels"] = self._labels("photo", labels, above=0.0)
        if len(places):
            colours = [rgb(GOOD if one else BAD) for one in sure]
            discs = self._discs("/crossings", raised, radius, colours, 0.45)
            discs.on_click(on_click)
            self._handles["crossings"] = [discs]

    @_exclusive
    def clear(self) -> None:
        """Everything but table and rope."""
        for name in list(self._handles):
            self._clear(name)

    def _capsules(self, points: NDArray, colours: NDArray[np.float64] | None) -> None:
        steps = np.diff(points, axis=0)
        turn: Any = from_z(steps / np.linalg.norm(steps, axis=1, keepdims=True))
        middles = (points[:-1] + points[1:]) / 2
        links = self._links
        if links is not None and colours is None:
            links.batched_positions, links.batched_wxyzs = middles, turn
            return
        from trimesh.creation import capsule

        rope = self.size
        mesh = capsule(height=rope.link_length, radius=rope.radius, count=[12, 12])
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        light = _linear(_colours(len(steps)) if colours is None else colours)
        self._links = self._scene.add_batched_meshes_simple(
            "/rope", mesh.vertices, mesh.faces, batched_wxyzs=turn, batched_positions=middles,
            batched_colors=light, lod="off",
        )  # fmt: skip

    def _ball(
        self, name: str, radius: float, colour: str, place: NDArray, opacity: float | None = None
    ) -> viser.IcosphereHandle:
        return self._scene.add_icosphere(name, radius, rgb(colour), opacity=opacity, position=place)

    def _discs(
        self, name: str, places: NDArray, radius: float, colours: list[Any], opacity: float
    ) -> viser.BatchedMeshHandle:
        from trimesh.creation import cylinder

        mesh = cylinder(radius, 0.0005, sections=24)
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1))
        return self._scene.add_batched_meshes_simple(
            name, mesh.vertices, mesh.faces, batched_wxyzs=upright, batched_positions=places,
            batched_colors=_linear(np.array(colours, float)), opacity=opacity, lod="off",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _line(self, name: str, places: NDArray, colour: str, width: float) -> viser.SceneNodeHandle:
        pieces = np.stack([places[:-1], places[1:]], axis=1)
        return self._scene.add_line_segments(
            name, pieces, colors=rgb(colour), thickness=width, thickness_units="screen"
        )

    def _labels(
        self, name: str, labels: list[tuple[str, NDArray]], above: float = 0.03
    ) -> list[viser.SceneNodeHandle]:
        raised = [(text, place + [0.0, 0.0, above]) for text, place in labels]
        return [
            self._scene.add_label(f"/labels/{name}/{n}", text, position=at, anchor="bottom-center")
            for n, (text, at) in enumerate(raised)
        ]

    def _clear(self, name: str) -> None:
        for handle in self._handles.pop(name, []):
            handle.remove()


def camera_position(aspect: float) -> NDArray[np.float64]:
    """Position (3,), metres, from which a window of this aspect shows the whole table."""
    ahead = -np.array(CAMERA) / np.linalg.norm(CAMERA)
    corner = np.array([1.0, -1.0, 0.0]) * SPLINE_HIGH[-1]  # the nearer ones are seen furthest out
    depth = 1.04 * corner[0] / (np.tan(FIELD_OF_VIEW / 2) * aspect)  # that brings it to the rim
    back = (depth - corner @ ahead) / np.linalg.norm(CAMERA)
    return max(1.0, back) * np.array(CAMERA)


def overhead_position(reach: NDArray, aspect: float) -> NDArray[np.float64]:
    """Position (3,), metres, from which a window of this aspect shows a rectangle about the origin
    straight from above; `reach` (2,) is half its size."""
    height = 1.1 * max(reach[1], reach[0] / aspect) / np.tan(FIELD_OF_VIEW / 2)
    return np.array([0.0, -1e-3, height])


def _colours(links: int) -> NDArray[np.float64]:
    """Colours (links, 3), 0 to 255, from head to tail."""
    return np.array([rgb(rope_colour(place)) for place in (np.arange(links) + 0.5) / links], float)


def _linear(colours: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (N, 3) in sRGB as linear light, as viser reads the colours of batched meshes."""
    share = np.trunc(colours) / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * light).astype(np.uint8)


def rgb(colour: str) -> tuple[int, int, int]:
    """'#rrggbb' as three numbers, 0 to 255."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
