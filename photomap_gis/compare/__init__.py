"""What has changed between old imagery and a new map: laid on each other, freed of light and season, scored."""

from photomap_gis.compare.align import LaidPair, coarser, field_on, fine_field
from photomap_gis.compare.detect import NODATA, sample_windows, score_window, score_windows
from photomap_gis.compare.evidence import Pair, look_at_pair
from photomap_gis.compare.field import ShiftField
from photomap_gis.compare.imagery import ColourPatch, Imagery
from photomap_gis.compare.picture import change_picture
from photomap_gis.compare.polygons import ChangedArea, outlines, scored

__all__ = [
    "NODATA",
    "ChangedArea",
    "ColourPatch",
    "Imagery",
    "LaidPair",
    "Pair",
    "ShiftField",
    "change_picture",
    "coarser",
    "field_on",
    "fine_field",
    "look_at_pair",
    "outlines",
    "sample_windows",
    "score_window",
    "score_windows",
    "scored",
]
