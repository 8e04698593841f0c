"""The live dock: a map that grows in QGIS while the drone flies."""
