"""Pictures of ropes, splines, plans and topological states, and recordings in Rerun.

matplotlib is imported where something is drawn, so that this package costs nothing to import.
"""
