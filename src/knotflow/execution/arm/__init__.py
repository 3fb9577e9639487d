"""Plans as trajectories of a robot arm (Sec. VII-D)."""
