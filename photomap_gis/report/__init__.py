"""What a commander reads: how the flight was flown, what became of its frames, and one page that says it all."""

from photomap_gis.report.page import MapPicture, PackedFile, Page, page_html
from photomap_gis.report.times import FlightTimes, Moment, flight_times

__all__ = ["FlightTimes", "MapPicture", "Moment", "PackedFile", "Page", "flight_times", "page_html"]
