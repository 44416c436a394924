"""Light of the validation scenes from a second renderer, Blender's Cycles, in a separate process.

`job` writes the inputs as plain files, `render_with_blender.py` renders them, and `job` reads the
images. Cycles has another licence than Starling. Only the script imports it, and only under
Blender's interpreter.
"""
