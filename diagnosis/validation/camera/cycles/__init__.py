"""Light of the check's scenes by another renderer, Blender's Cycles, in a process of its own.

A `job` goes to it as plain files, `render_with_blender.py` runs there, `assemble` makes `light.npz`
of what comes back. Cycles' module is under another licence than Starling: nothing here imports it
when it is imported, and nothing but the script, run by another interpreter, ever does.
"""
