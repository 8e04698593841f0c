"""photomap for QGIS: a remote control of the photomap engine; stdlib and ``qgis.*`` only."""


def classFactory(iface):
    """Return the plugin; QGIS calls this when it loads it."""
    from .plugin import PhotomapPlugin

    return PhotomapPlugin(iface)
