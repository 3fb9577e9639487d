"""Planning: a tree search from a rope as it lies to a tied knot (paper Sec. V-B d).

`parse_goal` and `parse_rope` read what to tie into what, `plan_knot` searches and returns a
`KnotPlan`, which gives timed gripper waypoints and JSON. `confirm` has an independent library
identify the tied rope's knot type. Pictures are imported by file: `planning.draw.draw_plan`,
`planning.animate.animate_plan`, `planning.draw_dag.draw_dag`.

A name is loaded when it is used, from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
