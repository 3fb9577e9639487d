"""The topics of a recording: what is found where, in MCAP and in the viewers' entity trees."""

from __future__ import annotations

ROLLOUT = "/rollout"  # knotflow.Rollout, one a rollout: its facts
ROPE = "/rope/points"  # foxglove.PointCloud, one a frame: the vertices, exact
ROPE_LINE = "/rope/line"  # foxglove.SceneUpdate, one a frame: the same to look at, rounded
GRIPPER = "/gripper"  # foxglove.PoseInFrame, one a frame, exact
SPLINE = "/spline"  # foxglove.SceneUpdate, one a rollout: control points and curve
CAMERA = "/camera"  # foxglove.CompressedImage, one a frame, where a camera looked on
ESTIMATE = "/estimate"  # foxglove.PointCloud, one a frame: the vertices found in its images
REFERENCE = "/reference"  # foxglove.PointCloud, one a frame: the vertices as they were wanted
TOPOLOGY = "/topology"  # foxglove.Log, at the start and at the end of a rollout
FRAMES = "/tf"  # foxglove.FrameTransforms, once: the root of the frames

METADATA = "knotflow"  # name of the MCAP metadata record that holds the config
WORLD = "world"  # the one frame all coordinates are in
