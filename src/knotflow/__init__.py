"""Learned topological motion primitives for planning knots."""

import os

os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # torchrl logs every buffer, once imported
