"""A rope in a colour image alone: silhouette, path, crossings by occlusion."""
