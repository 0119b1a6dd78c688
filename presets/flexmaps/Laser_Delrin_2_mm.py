# Delrin (POM) of 2 mm on a laser cutter with a bed of 600 x 400 mm
import bpy

settings = bpy.context.object.flexmaps

settings.remesh.edge = 20.0
settings.spiral.thickness = 2.0
settings.spiral.width_min = 1.0
settings.spiral.width_max = 2.0
settings.spiral.slot_min = 0.3
settings.spiral.slot_seam = 1.2
settings.spiral.fillet = 0.15
settings.material.material = "pom"
settings.connect.connector = "dovetail"
settings.connect.clearance = 0.05
settings.connect.thinnest = 0.8
settings.connect.rounding = 0.2
settings.cut.kerf_outline = 0.15
settings.cut.kerf_holes = 0.15
settings.cut.mill = 0.0
settings.cut.nozzle = 0.0
settings.cut.line_width = 0.0254
settings.cut.svg_unit = "mm"
settings.cut.lead_in = 0.0
settings.cut.tabs = 0
settings.cut.tab_width = 1.0
settings.sheet.sheet_width = 600.0
settings.sheet.sheet_height = 400.0
settings.sheet.margin = 5.0
settings.sheet.spacing = 3.0
settings.sheet.rotation = "FREE"
settings.sheet.labels = True
settings.export.svg = True
settings.export.dxf = "R2010"
settings.export.pdf = True
settings.export.solids = "NONE"
