"""A rope followed from image to image."""
