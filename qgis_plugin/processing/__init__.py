"""photomap's commands as Processing algorithms: in the toolbox, in models, in batch and in ``qgis_process``."""
