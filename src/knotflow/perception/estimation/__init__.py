"""A rope estimated from one RGB-D image."""
