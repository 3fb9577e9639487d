from .appearance import Appearance
from .camera import Camera, CameraError
from .certainty import CrossingEvidence, weigh_crossings
from .doubts import END_DOUBTS
from .estimation import EstimateConfig, RopeEstimate, estimate
from .evidence import explained, observe, seen
from .fitting import FitConfig, fit, image_loss, project_lengths, shape_loss
from .image import ImageError, Label, RgbdImage
from .lifting import lift
from .losses import Target
from .motion import go_on
from .network import Network, NetworkError, network_of
from .noise import CameraNoiseConfig, add_noise
from .point_drift import PointDriftConfig, PointDriftTracker
from .rendering import render
from .sample import SAMPLE
from .searching import SearchConfig
from .seeing import see
from .segmentation import Segmentation, segment
from .self_supervision import SelfSupervision, SelfSupervisionConfig
from .simulated import SimulatedCamera, View
from .strand_network import StrandNetwork
from .strand_tracing import trace_rope
from .strand_training import StrandTraining
from .tracing import Trace, TraceError, trace
from .tracking import Tracker, TrackerConfig
from .training import Training
from .training_config import (
    CoarseToFineConfig,
    ExamplesConfig,
    LossConfig,
    StrandNetworkConfig,
    StrandTrainingConfig,
    TrainingConfig,
)
from .uncertainty import spread
from .unmixing import coverage

__all__ = [
    "END_DOUBTS",
    "SAMPLE",
    "Appearance",
    "Camera",
    "CameraNoiseConfig",
    "CoarseToFineConfig",
    "CameraError",
    "CrossingEvidence",
    "EstimateConfig",
    "ExamplesConfig",
    "FitConfig",
    "ImageError",
    "Label",
    "LossConfig",
    "Network",
    "NetworkError",
    "PointDriftConfig",
    "PointDriftTracker",
    "RgbdImage",
    "RopeEstimate",
    "SearchConfig",
    "Segmentation",
    "SelfSupervision",
    "SelfSupervisionConfig",
    "SimulatedCamera",
    "StrandNetwork",
    "StrandNetworkConfig",
    "StrandTraining",
    "StrandTrainingConfig",
    "Target",
    "Trace",
    "TraceError",
    "Training",
    "TrainingConfig",
    "Tracker",
    "TrackerConfig",
    "View",
    "add_noise",
    "coverage",
    "estimate",
    "explained",
    "fit",
    "go_on",
    "image_loss",
    "lift",
    "network_of",
    "observe",
    "project_lengths",
    "render",
    "see",
    "seen",
    "segment",
    "shape_loss",
    "spread",
    "trace",
    "trace_rope",
    "weigh_crossings",
]
