"""The numerical engine of FlexMaps: numpy and scipy, SI units, no Blender.

One datum goes one way, each arrow a function of the module named below it:

    PolygonMesh -> QuadMesh -> PatchLayout -> FlatPatches -> SpiralDesign -> CutSheets -> files
      meshio       check       trace, merge    flatten        design          sheets      svg, dxf

Modules import downward only; nothing here imports ``bpy``.
"""

PROGRAM, VERSION = "FlexMaps for Blender", "0.1.0"
