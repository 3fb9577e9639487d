import pathlib

from .camera.calibration import Calibration
from .camera.capture import Capture, read_capture
from .camera.image import SAMPLE, CameraNoiseConfig, ImageError, Label, RgbdImage, add_noise
from .camera.pinhole import Camera, CameraError
from .camera.simulated import Appearance, SimulatedCamera
from .estimation.crossings import END_AMBIGUITIES
from .estimation.estimate import EstimateConfig, RopeEstimate, estimate
from .estimation.evidence import observe
from .estimation.fitting import FitConfig, fit
from .estimation.search import SearchConfig
from .estimation.segmentation import segment
from .estimation.skeleton import TraceError
from .io import see
from .networks.network import StrandNetwork
from .networks.training import StrandTrainer, StrandTrainingConfig
from .tracking import Tracker, TrackerConfig

SHIPPED_NETWORK: pathlib.Path

__all__ = [
    "END_AMBIGUITIES", "SAMPLE", "SHIPPED_NETWORK", "Appearance", "Calibration", "Camera",
    "CameraError", "CameraNoiseConfig", "Capture", "EstimateConfig", "FitConfig", "ImageError",
    "Label", "RgbdImage", "RopeEstimate", "SearchConfig", "SimulatedCamera", "StrandNetwork",
    "StrandTrainer", "StrandTrainingConfig", "TraceError", "Tracker", "TrackerConfig",
    "add_noise", "estimate", "fit", "observe", "read_capture", "see", "segment",
]  # fmt: skip
