"""Every simulated rollout on disk: MCAP files, and tables of what is in them.

A recording is one MCAP file with Foxglove protobuf messages, so Rerun and Foxglove show it as it
is, and one ``knotflow.Rollout`` message a rollout with its action, spline and outcome.
"""

from __future__ import annotations

from .reader import DamagedRecordingError, NotARecordingError, load, read_metadata, read_recording
from .rollout import Outcome, RecordedRollout, RolloutImages, recorded
from .writer import RunLog, write_recording
