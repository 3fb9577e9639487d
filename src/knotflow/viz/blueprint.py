"""How Rerun lays out a recording: the rope in 3-D, and what was meant and reached beside it.

Rerun draws point clouds, poses and logs by itself. Foxglove scenes (the rope's line, the spline)
reach it as plain structs; component mappings say which of their fields a visualizer should take.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from knotflow.recording import scene, topics

if TYPE_CHECKING:
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import VisualizerComponentMapping
    from rerun.blueprint.visualizers import Visualizer
    from rerun.encodings import EntityPathLike

APPLICATION = "knotflow"  # Rerun gives a blueprint to recordings of the same application
TIMELINE = "time"  # seconds of a recording
_SCENE = "foxglove.SceneUpdate:message"
_LINES = ".entities[].lines[].points | map(pack(.x!, .y!, .z!))"
_SPHERES = ".entities[].spheres[].pose.position | pack(.x!, .y!, .z!)"


def blueprint(rope_radius: float, camera: bool = False) -> rrb.Blueprint:
    """The layout of every recording of a rope with that radius, m; else it names topics only.

    With `camera`, the camera's image stands beside the rope, and the estimate is drawn in it.
    """
    import rerun as rr
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

    pieces = scene.gradient(scene.LINE_PIECES)
    overrides: dict[EntityPathLike, list[Visualizer]] = {
        topics.ROPE: [rr.Points3D.from_fields(radii=rope_radius).visualizer()],
        topics.ROPE_LINE: [
            rr.LineStrips3D.from_fields(radii=rope_radius, colors=pieces).visualizer(
                mappings=[_take("LineStrips3D:strips", _LINES)]
            )
        ],
        topics.GRIPPER: [
            rr.Ellipsoids3D.from_fields(
                half_sizes=[(0.018, 0.018, 0.018)],
                colors=[(*scene.GRIPPER_RGB, 255)],
                fill_mode="solid",
            ).visualizer()
        ],
        topics.SPLINE: [
            rr.LineStrips3D.from_fields(
                radii=[0.0025, 0.001], colors=[scene.SPLINE_RGB, scene.CONTROL_RGB]
            ).visualizer(mappings=[_take("LineStrips3D:strips", _LINES)]),
            rr.Points3D.from_fields(
                radii=0.01,
                colors=scene.CONTROL_RGB,
                labels=["grasp", "middle", "end"],
                show_labels=True,
            ).visualizer(mappings=[_take("Points3D:positions", _SPHERES)]),
        ],
    }
    shown = [topics.ROPE, topics.ROPE_LINE, topics.GRIPPER, topics.SPLINE]
    name = (
        "Rope (head blue, tail orange), gripper (yellow), spline (green) and its control points "
        "(pink), table (10 cm grid)"
    )
    if camera:
        shown += [topics.ESTIMATE, topics.REFERENCE]
        name += ", estimate (white), reference (violet)"
        overrides[topics.REFERENCE] = [
            rr.Points3D.from_fields(radii=0.004, colors=[(204, 121, 167, 255)]).visualizer()
        ]
        overrides[topics.ESTIMATE] = [
            rr.Points3D.from_fields(radii=0.004, colors=[(255, 255, 255, 255)]).visualizer()
        ]
    view = rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=shown,
        overrides=overrides,
        background=rrb.Background(color=(24, 26, 30)),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.1),  # the table, z = 0
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(0.0, -0.52, 0.54),
            look_target=(0.0, 0.02, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    image = rrb.Spatial2DView(origin=topics.CAMERA, name="Camera")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(view, image) if camera else view,
            rrb.TextLogView(
                origin=topics.TOPOLOGY,
                name="Topology and outcome",
                columns=rrb.TextLogColumns(
                    timeline_columns=[TimelineColumn(TIMELINE)],
                    text_log_columns=[TextLogColumn("LogLevel"), TextLogColumn("Body")],
                ),
            ),
            row_shares=[4, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _take(target: str, selector: str) -> VisualizerComponentMapping:
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    return VisualizerComponentMapping(
        target=target,
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=_SCENE,
        selector=selector,
    )
