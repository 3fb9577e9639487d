import pathlib

from .camera.image import SAMPLE, CameraNoiseConfig, ImageError, Label, RgbdImage, add_noise
from .camera.pinhole import Camera, CameraError
from .camera.rendering import render
from .camera.simulated import Appearance, SimulatedCamera
from .estimation.crossings import END_AMBIGUITIES, CrossingEvidence
from .estimation.estimate import EstimateConfig, RopeEstimate, estimate
from .estimation.evidence import Target, coverage_fraction, observe, visible_vertices
from .estimation.fitting import FitConfig, fit
from .estimation.search import SearchConfig
from .estimation.segmentation import Segmentation, pixel_coverage, segment
from .estimation.skeleton import TraceError
from .io import see
from .networks.network import Network, NetworkError, load_if_present
from .networks.training import (
    CoarseToFineTrainer,
    SelfSupervisionConfig,
    StrandTrainer,
    StrandTrainingConfig,
    TrainingConfig,
    self_supervise,
)
from .tracking import CpdConfig, CpdTracker, Tracker, TrackerConfig

SHIPPED_NETWORK: pathlib.Path

__all__ = [
    "END_AMBIGUITIES",
    "SAMPLE",
    "SHIPPED_NETWORK",
    "Appearance",
    "Camera",
    "CameraError",
    "CameraNoiseConfig",
    "CoarseToFineTrainer",
    "CpdConfig",
    "CpdTracker",
    "CrossingEvidence",
    "EstimateConfig",
    "FitConfig",
    "ImageError",
    "Label",
    "Network",
    "NetworkError",
    "RgbdImage",
    "RopeEstimate",
    "SearchConfig",
    "Segmentation",
    "SelfSupervisionConfig",
    "SimulatedCamera",
    "StrandTrainer",
    "StrandTrainingConfig",
    "Target",
    "TraceError",
    "Tracker",
    "TrackerConfig",
    "TrainingConfig",
    "add_noise",
    "coverage_fraction",
    "estimate",
    "fit",
    "load_if_present",
    "observe",
    "pixel_coverage",
    "render",
    "see",
    "segment",
    "self_supervise",
    "visible_vertices",
]
