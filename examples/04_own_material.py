"""A material of your own from one measured strip: clamp it at an end, hang a weight at the other, measure how far it sinks.

For a strip of length L, width b and thickness t that sinks by d under a force F, Young's modulus is E = 4 F L^3 / (b t^3 d).

Run it: blender -b --python examples/04_own_material.py
"""

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

LENGTH, WIDTH, THICKNESS = 0.10, 0.02, 0.002  # metres
WEIGHT, SINKS = 0.05, 0.0047  # kilograms; metres
MASS = 0.0051  # kilograms, of the strip itself

youngs = 4.0 * 9.81 * WEIGHT * LENGTH**3 / (WIDTH * THICKNESS**3 * SINKS)
density = MASS / (LENGTH * WIDTH * THICKNESS)
settings = {
    "material.material": "custom",
    "material.youngs": youngs / 1e9,  # GPa
    "material.density": density,  # kg per cubic metre
    "material.strain_limit": 0.02,
    "spiral.thickness": THICKNESS * 1e3,  # mm
}
piece = api.simulate(api.load("shape:vault", edge=20, settings=settings), supports="lowest")
found = api.report(piece)["equilibrium"]
print(f"E = {youngs / 1e9:.2f} GPa, {density:.0f} kg/m3: strain up to {found['strain_share_max']:.0%} of the limit")
