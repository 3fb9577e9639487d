"""How pictures look: ropes, crossings, splines, colours and style, for plans and the report.

`palette` has the colours, `style` the settings of matplotlib, `rope` turns a rope shape into
coloured outlines with gaps where a strand passes under, `spline` draws the gripper's path.
matplotlib is imported where something is drawn, so that this package costs nothing to import.
"""
