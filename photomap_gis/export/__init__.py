"""The map in the formats that other programs open: GeoTIFF, KMZ, tiles, MBTiles, poses, and over old imagery."""

from photomap_gis.export.atak import write_atak
from photomap_gis.export.footprint import footprint
from photomap_gis.export.geopackage import write_geopackage
from photomap_gis.export.geopdf import write_geopdf
from photomap_gis.export.geotiff import write_geotiff
from photomap_gis.export.graph import SolvedGraph, write_g2o, write_graph_geojson
from photomap_gis.export.graph_picture import write_graph_picture
from photomap_gis.export.kml import write_kmz
from photomap_gis.export.layers import write_layers
from photomap_gis.export.mbtiles import write_mbtiles
from photomap_gis.export.over import Replacement, write_over
from photomap_gis.export.picture import write_picture
from photomap_gis.export.pmtiles import write_pmtiles
from photomap_gis.export.poses import PoseRow, pose_rows, write_poses
from photomap_gis.export.stac import write_stac_item
from photomap_gis.export.tiles import write_tiles
from photomap_gis.export.vectors import VectorLayer, write_vectors
from photomap_gis.export.warp import overview, target_grid, warped
from photomap_gis.export.words import MapWords

__all__ = [
    "MapWords",
    "PoseRow",
    "Replacement",
    "SolvedGraph",
    "VectorLayer",
    "footprint",
    "overview",
    "pose_rows",
    "target_grid",
    "warped",
    "write_atak",
    "write_g2o",
    "write_geopackage",
    "write_geopdf",
    "write_geotiff",
    "write_graph_geojson",
    "write_graph_picture",
    "write_kmz",
    "write_layers",
    "write_mbtiles",
    "write_over",
    "write_picture",
    "write_pmtiles",
    "write_poses",
    "write_stac_item",
    "write_tiles",
    "write_vectors",
]
