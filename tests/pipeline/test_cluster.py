"""A map made on a cluster is the map made alone, pixel for pixel, and a killed worker changes nothing."""

import shutil

import numpy as np
import pytest
import rasterio

from photomap_gis.pipeline import MapSettings, map_flight
from photomap_gis.store import Mission
from tests.cluster import local_cluster

pytestmark = pytest.mark.slow


def _registrations(folder):
    return sorted((r.a, r.b, r.probability, r.T_a_b, r.covariance) for r in Mission.open(folder).registrations)


def test_a_map_of_a_cluster_is_the_map_made_alone(flown, mapped, tmp_path):
    with local_cluster(tmp_path) as cluster:
        killed = []

        def watch(stage, done, total):
            if stage == "render" and done > total // 2 and not killed:
                killed.append(cluster.workers[0])
                cluster.workers[0].kill()

        folder = tmp_path / "m"
        summary = map_flight([flown.photos], folder, MapSettings(scheduler=cluster.address), on_progress=watch)
    assert killed
    assert summary.frames == mapped.summary.frames and summary.registrations == mapped.summary.registrations
    assert _registrations(folder) == _registrations(mapped.folder)
    with rasterio.open(folder / "map.tif") as a, rasterio.open(mapped.folder / "map.tif") as b:
        assert a.transform == b.transform
        assert np.array_equal(a.read(), b.read())
    assert Mission.open(folder).header.settings["scheduler"] is None
    shutil.rmtree(folder)
