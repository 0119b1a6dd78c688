# Cast acrylic of 3 mm on a CNC mill with a cutter of 1 mm
import bpy

settings = bpy.context.object.flexmaps

settings.remesh.edge = 50.0
settings.spiral.thickness = 3.0
settings.spiral.width_min = 2.0
settings.spiral.width_max = 3.5
settings.spiral.slot_min = 1.1
settings.spiral.slot_seam = 1.8
settings.spiral.fillet = 0.55
settings.material.material = "acrylic"
settings.connect.connector = "dovetail"
settings.connect.clearance = 0.08
settings.connect.thinnest = 1.2
settings.connect.rounding = 0.3
settings.cut.kerf_outline = 1.0
settings.cut.kerf_holes = 1.0
settings.cut.mill = 1.0
settings.cut.nozzle = 0.0
settings.cut.line_width = 0.1
settings.cut.svg_unit = "mm"
settings.cut.lead_in = 0.0
settings.cut.tabs = 4
settings.cut.tab_width = 1.5
settings.sheet.sheet_width = 600.0
settings.sheet.sheet_height = 400.0
settings.sheet.margin = 10.0
settings.sheet.spacing = 6.0
settings.sheet.rotation = "FREE"
settings.sheet.labels = False
settings.export.svg = True
settings.export.dxf = "R2010"
settings.export.pdf = True
settings.export.solids = "NONE"
