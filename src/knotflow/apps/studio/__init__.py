"""The studio in the browser: lay a rope, plan a knot and watch it, demonstrate with three clicks.

`session`, `draft` and `playback` are the logic and know no browser; `scene` draws and `page`, with
a module a tab, has the controls (viser, of the extra `studio`).
"""
