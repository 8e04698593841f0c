"""Real flights: consecutive photos register, loops of three close, and strangers are not accepted."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from photomap_gis.core.camera import Camera, PlaneView
from photomap_gis.ifmi import judge_frame, make_spectrum, make_working, register


def spectra(folder, names):
    out = []
    for index, name in enumerate(names):
        image = cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)
        work = make_working(image, PlaneView.flat(Camera(image.shape[1], image.shape[0])), size_px=512)
        assert judge_frame(work.grey).ok
        out.append(make_spectrum(work.grey, index=index))
    return out


def corner_gap_px(T, U):
    corners = np.array([[0, 0], [511, 0], [0, 383], [511, 383]], float)
    return float(np.abs(T.apply(corners) - U.apply(corners)).max())


def test_consecutive_photos_of_caliterra_register_and_loops_close(shared_data):
    folder = shared_data / "caliterra" / "images"
    names = sorted(p.name for p in folder.iterdir())[10:16]
    s = spectra(folder, names)
    steps = [register(a, b, fallback=False) for a, b in pairwise(s)]
    assert all(r.accepted for r in steps)
    for a, b, first, second in zip(s, s[2:], steps, steps[1:], strict=False):
        across = register(a, b)
        if across.accepted:
            slack = 12.0 + 4.0 * (first.model_sigma_px + second.model_sigma_px + across.model_sigma_px)
            assert corner_gap_px(across.T_a_b, first.T_a_b @ second.T_a_b) < slack


def test_strangers_are_not_accepted(shared_data):
    sets = []
    for name in ("caliterra", "seneca", "boruszyn"):
        folder = shared_data / name / "images"
        sets.append(spectra(folder, sorted(p.name for p in folder.iterdir())[3:20:8]))
    for i, one in enumerate(sets):
        for other in sets[i + 1 :]:
            for a in one[:2]:
                for b in other[:2]:
                    assert not register(a, b).accepted


@pytest.mark.slow
def test_all_consecutive_photos_of_caliterra_register(shared_data):
    folder = shared_data / "caliterra" / "images"
    s = spectra(folder, sorted(p.name for p in folder.iterdir()))
    assert all(register(a, b, fallback=False).accepted for a, b in pairwise(s))
