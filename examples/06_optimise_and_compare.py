"""What the optimiser brings: the same panels before and after, in millimetres and in strain.

Run it: blender -b --python examples/06_optimise_and_compare.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

before = api.simulate(api.load("shape:saddle", edge=20))
after = api.optimise(before)
for name, piece in (("before", before), ("after", after)):
    found = api.report(piece)["equilibrium"]
    print(f"{name:6} {found['rms_percent']:.2f} % from the target, strain {found['strain_share_max']:.0%} of the limit")
