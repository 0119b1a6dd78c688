"""The numerical engine of FlexMaps: numpy and scipy, SI units, no Blender.

One datum goes one way, each arrow a function of a module in the folder below it:

    PolygonMesh -> QuadMesh -> PatchLayout -> FlatPatches -> SpiralDesign -> CutSheets -> files
            surface        patches        patches       spirals        fabrication   fabrication

``mechanics`` finds the shape of a design, ``optimisation`` the design of a shape, ``assembling`` tells how the panels go
together and ``runs`` does all of it at once. What every folder shares lies here. Modules import downward only; nothing
here imports ``bpy``.
"""

PROGRAM, VERSION = "FlexMaps for Blender", "0.1.0"
