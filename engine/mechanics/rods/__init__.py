"""The rod model of FlexMaps section 6: one elastic edge between every two joined hubs."""
