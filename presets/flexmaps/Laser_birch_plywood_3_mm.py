# Birch plywood of 3 mm on a laser cutter, panels along the grain
import bpy

settings = bpy.context.object.flexmaps

settings.remesh.edge = 30.0
settings.spiral.thickness = 3.0
settings.spiral.width_min = 1.5
settings.spiral.width_max = 3.0
settings.spiral.slot_min = 0.4
settings.spiral.slot_seam = 1.8
settings.spiral.fillet = 0.2
settings.material.material = "birch"
settings.connect.connector = "dovetail"
settings.connect.clearance = 0.05
settings.connect.thinnest = 1.2
settings.connect.rounding = 0.3
settings.cut.kerf_outline = 0.2
settings.cut.kerf_holes = 0.2
settings.cut.mill = 0.0
settings.cut.nozzle = 0.0
settings.cut.line_width = 0.1
settings.cut.svg_unit = "mm"
settings.cut.lead_in = 0.0
settings.cut.tabs = 0
settings.cut.tab_width = 1.0
settings.sheet.sheet_width = 600.0
settings.sheet.sheet_height = 400.0
settings.sheet.margin = 5.0
settings.sheet.spacing = 3.0
settings.sheet.rotation = "GRAIN"
settings.sheet.labels = True
settings.export.svg = True
settings.export.dxf = "R2010"
settings.export.pdf = True
settings.export.solids = "NONE"
