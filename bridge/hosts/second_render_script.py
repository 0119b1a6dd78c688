"""Script of a second Blender, started by ``second_render``: render the first scene of a file with its own settings.

The last two command-line arguments are the .blend file, and "film" or "picture".
"""

import os
import sys
import traceback

import bpy

pack, kind = sys.argv[-2:]
try:
    with bpy.data.libraries.load(pack) as (there, here):
        here.scenes = list(there.scenes)
    bpy.ops.render.render(write_still=kind == "picture", animation=kind == "film", scene=here.scenes[0].name)
except Exception:
    traceback.print_exc()
    sys.stdout.flush()
    os._exit(1)
sys.stdout.flush()
os._exit(0)
