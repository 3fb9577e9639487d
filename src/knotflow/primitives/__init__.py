"""Topological motion primitives (Sec. V-A): encoding, networks, search, and the library of four."""

from knotflow.primitives.canonical import (
    PRIMITIVES,
    Canonical,
    canonicalise,
    primitive_of,
)
from knotflow.primitives.cem import CemConfig, cross_entropy
from knotflow.primitives.encoding import Encoded, Frames, encode
from knotflow.primitives.library import (
    FILE,
    LibraryError,
    PrimitiveLibrary,
    PrimitivesConfig,
)
from knotflow.primitives.networks import Actor, Critic, NetworkConfig
from knotflow.primitives.primitive import VARIANTS, Primitive, PrimitiveConfig

__all__ = [
    "FILE",
    "PRIMITIVES",
    "VARIANTS",
    "Actor",
    "Canonical",
    "CemConfig",
    "Critic",
    "Encoded",
    "Frames",
    "LibraryError",
    "NetworkConfig",
    "Primitive",
    "PrimitiveConfig",
    "PrimitiveLibrary",
    "PrimitivesConfig",
    "canonicalise",
    "cross_entropy",
    "encode",
    "primitive_of",
]
