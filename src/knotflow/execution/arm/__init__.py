"""An arm: its model, what it reaches, and the joint trajectories that follow a plan."""
