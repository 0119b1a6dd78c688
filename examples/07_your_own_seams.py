"""Cut where you want it cut: seams that are marked on an object (in Edit Mode: Edge, Mark Seam) become the panels' borders.

Run it: blender -b --python examples/07_your_own_seams.py
"""

import bpy

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

obj = api.show(api.load("shape:dome", edge=20))
low, high = (f(v.co.x for v in obj.data.vertices) for f in (min, max))
for edge in obj.data.edges:
    edge.use_seam = all(abs(obj.data.vertices[v].co.x - 0.5 * (low + high)) < 1e-4 for v in edge.vertices)
bpy.context.view_layer.update()

piece = api.layout(api.load(obj), keep_seams=True)
found = api.report(piece)["layout"]
print(f"{found['patches']} panels, worst distortion {found['energy_max']:.3f}")
