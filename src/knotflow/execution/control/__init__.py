"""Execution of plans by a robot, in closed loop, and a simulated robot to try it on (Sec. VI)."""
