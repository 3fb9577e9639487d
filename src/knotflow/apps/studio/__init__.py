"""The studio in the browser: lay a rope, plan a knot and watch it, demonstrate with three clicks.

`session` and `demonstration` know no browser; the others are its page (viser, of the extra
`studio`).
"""
