"""A recording as a Rerun file: the rope in 3-D, its spline, and actions and outcomes beside it.

Rerun draws point clouds, poses and logs by itself. Foxglove scenes (the rope's line, the spline)
reach it as plain structs; component mappings say which of their fields a visualizer should take.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from knotflow.recording import messages, read_metadata, read_recording, write_recording

if TYPE_CHECKING:
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import VisualizerComponentMapping
    from rerun.blueprint.visualizers import Visualizer
    from rerun.chunk import Chunk
    from rerun.encodings import EntityPathLike

APPLICATION = "knotflow"
"""Rerun applies a blueprint to the recordings of the same application."""
TIMELINE = "time"
"""Seconds of a recording."""

_LOG_TIME = "message_log_time"  # Rerun's name for the time of an MCAP file's messages
_SCENE = "foxglove.SceneUpdate:message"
_LINES = ".entities[].lines[].points | map(pack(.x!, .y!, .z!))"
_SPHERES = ".entities[].spheres[].pose.position | pack(.x!, .y!, .z!)"
_ESTIMATE_RGB, _REFERENCE_RGB = (255, 255, 255), (204, 121, 167)


class ViewerError(RuntimeError):
    """Rerun refused a recording or could not open its window."""


def save_rerun(
    path: str | os.PathLike[str], target: str | os.PathLike[str], *, number: int | None = None
) -> Path:
    """Write a recording and our blueprint as one ``.rrd`` that ``rerun`` opens as it is.

    The rollouts, or the one of a number, are read and written again on the way, so that bulk data
    get their rope line.

    Raises:
        FileNotFoundError: the recording is not there.
        NotARecordingError, DamagedRecordingError: the file is no recording, or cut or changed.
        ValueError: no rollout has this number.
        ViewerError: Rerun could not convert it.
    """
    source = Path(path)
    every = [*read_recording(source)]
    chosen = [rollout for rollout in every if number in (None, rollout.number)]
    if not chosen:
        raise ValueError(no_such_number(source, number, [rollout.number for rollout in every]))
    radius = messages.rope_radius(chosen[0].control_points)
    layout = blueprint(radius, camera=any(rollout.camera is not None for rollout in chosen))
    with tempfile.TemporaryDirectory(prefix="knotflow-view-") as temporary:
        folder = Path(temporary)
        mcap, rrd, rbl = folder / "view.mcap", folder / "view.rrd", folder / "view.rbl"
        write_recording(mcap, chosen, read_metadata(source), rope_line=True)
        _convert(mcap, rrd, source.stem if number is None else f"{source.stem}#{number}")
        layout.save(APPLICATION, rbl)
        run_rerun("rrd", "merge", str(rrd), str(rbl), "-o", str(target))
    return Path(target)


def no_such_number(path: Path, number: int | None, numbers: list[int]) -> str:
    """That a recording has no such rollout, in words."""
    there = f"{len(numbers)} rollouts from {min(numbers)} to {max(numbers)}" if numbers else "none"
    return f"{path} has no rollout number {number}; there are {there}"


def rerun_program() -> str:
    """Path of Rerun's command, which need not be on PATH: it lies beside our Python."""
    program = shutil.which("rerun", path=sysconfig.get_path("scripts")) or shutil.which("rerun")
    if program is None:
        raise ViewerError("the Rerun viewer is not installed; pip install rerun-sdk brings it")
    return program


def run_rerun(*arguments: str) -> None:
    """Run Rerun's command line and wait; a ViewerError quotes the line that names the error."""
    done = subprocess.run(
        [rerun_program(), *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        why = next((line for line in reversed(lines) if "rror" in line), "\n".join(lines[-3:]))
        raise ViewerError(f"rerun {' '.join(arguments)} failed with code {done.returncode}: {why}")


def blueprint(rope_radius: float, camera: bool = False) -> rrb.Blueprint:
    """The layout for a recording of a rope with that radius, metres.

    With `camera`, the camera's images stand beside the rope, with estimate and reference.
    """
    import rerun as rr
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

    overrides: dict[EntityPathLike, list[Visualizer]] = {
        messages.ROPE: [rr.Points3D.from_fields(radii=rope_radius).visualizer()],
        messages.ROPE_LINE: [
            rr.LineStrips3D.from_fields(
                radii=rope_radius, colors=messages.gradient(messages.LINE_PIECES)
            ).visualizer(mappings=[_mapping("LineStrips3D:strips", _LINES)])
        ],
        messages.GRIPPER: [
            rr.Ellipsoids3D.from_fields(
                half_sizes=[(0.018, 0.018, 0.018)],
                colors=[(*messages.GRIPPER_RGB, 255)],
                fill_mode="solid",
            ).visualizer()
        ],
        messages.SPLINE: [
            rr.LineStrips3D.from_fields(
                radii=[0.0025, 0.001], colors=[messages.SPLINE_RGB, messages.CONTROL_RGB]
            ).visualizer(mappings=[_mapping("LineStrips3D:strips", _LINES)]),
            rr.Points3D.from_fields(
                radii=0.01,
                colors=messages.CONTROL_RGB,
                labels=["grasp", "middle", "end"],
                show_labels=True,
            ).visualizer(mappings=[_mapping("Points3D:positions", _SPHERES)]),
        ],
    }
    name = (
        "Rope (head blue, tail orange), gripper (yellow), spline (green) and its control points "
        "(pink), table (10 cm grid)"
    )
    if camera:
        name += ", estimate (white), reference (violet)"
        ropes = {messages.ESTIMATE: _ESTIMATE_RGB, messages.REFERENCE: _REFERENCE_RGB}
        for topic, rgb in ropes.items():
            points = rr.Points3D.from_fields(radii=0.004, colors=[(*rgb, 255)])
            overrides[topic] = [points.visualizer()]
    scene = rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=[str(topic) for topic in overrides],
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
    image = rrb.Spatial2DView(origin=messages.CAMERA, name="Camera")
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(scene, image) if camera else scene,
            rrb.TextLogView(
                origin=messages.TOPOLOGY,
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


def _mapping(target: str, selector: str) -> VisualizerComponentMapping:
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    return VisualizerComponentMapping(
        target=target,
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=_SCENE,
        selector=selector,
    )


def _convert(source: Path, target: Path, name: str) -> None:
    """Write an MCAP as Rerun reads it, under a name, with the one timeline `TIMELINE`."""
    from rerun.chunk import McapReader

    stream = McapReader(source, timeline_type="duration_ns").stream()  # from 0 s, not from 1970
    stream.flat_map(_timed).write_rrd(target, application_id=APPLICATION, recording_id=name)


def _timed(chunk: Chunk) -> list[Chunk]:
    """A chunk with `TIMELINE` in place of the timelines of Rerun's reader."""
    import pyarrow as pa
    from rerun.chunk import Chunk

    if chunk.is_static:
        return [chunk]
    others = [name for name in chunk.timeline_names if name != _LOG_TIME]
    batch = chunk.to_record_batch().drop_columns(others)
    column = batch.schema.get_field_index(_LOG_TIME)
    old = batch.schema.field(column)
    metadata = (old.metadata or {}) | {b"rerun:index_name": TIMELINE.encode()}
    schema = batch.schema.set(column, old.with_name(TIMELINE).with_metadata(metadata))
    return Chunk.from_record_batch(pa.RecordBatch.from_arrays(batch.columns, schema=schema))
