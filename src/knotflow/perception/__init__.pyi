from .camera import Camera, CameraError
from .image import ImageError, RgbdImage

__all__ = [
    "Camera",
    "CameraError",
    "ImageError",
    "RgbdImage",
]
