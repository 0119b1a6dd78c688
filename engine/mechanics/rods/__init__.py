"""The rod model of FlexMaps section 6: one elastic edge from hub to hub."""
