"""Learned topological motion primitives for planning knots."""
