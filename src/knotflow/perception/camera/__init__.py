"""Cameras: geometry, images and their files, simulation, noise and rendering."""
