from .appearance import Appearance
from .camera import Camera, CameraError
from .image import ImageError, Label, RgbdImage
from .noise import NoiseConfig, add_noise
from .sample import SAMPLE
from .segmentation import Segmentation, segment
from .simulated import SimulatedCamera, View

__all__ = [
    "SAMPLE",
    "Appearance",
    "Camera",
    "CameraError",
    "ImageError",
    "Label",
    "NoiseConfig",
    "RgbdImage",
    "Segmentation",
    "SimulatedCamera",
    "View",
    "add_noise",
    "segment",
]
