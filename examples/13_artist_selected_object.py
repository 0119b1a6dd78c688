"""For the artist: the selected mesh becomes a piece, optimised, with its true spirals to look at.

Open this file in Blender's text editor, select a mesh in the 3D view, and press Run Script. A mesh that is not made of quads
gets new ones first; the old object is hidden. Afterwards slide the shape key "FlexMaps equilibrium" between your surface
and what the panels will become, and render.
"""

import bpy

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

STEPS = 20  # of the optimiser; more match the surface better

obj = bpy.context.object
if any(finding.is_error for finding in api.check(api.load(obj))):
    bpy.ops.flexmaps.quad_remesh()
    bpy.ops.flexmaps.set_size()
    obj = bpy.context.object

piece = api.load(obj, settings={"optimise.iterations": STEPS})
piece = api.optimise(api.layout(api.regularise(piece)))
api.show(piece)
bpy.ops.flexmaps.preview()

found = api.report(piece)
print(
    f"{obj.name}: {found['spirals']['count']} spirals on {found['layout']['patches']} panels, "
    f"{found['equilibrium']['rms_percent']:.2f} % from your surface (RMS of its size)"
)
