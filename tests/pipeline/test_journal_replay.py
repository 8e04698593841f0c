"""Registrations of earlier runs: taken from the journal, never measured twice, never lost to a later failure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from photomap_gis.core.measurement import Registration
from photomap_gis.core.posegraph import EdgeKind
from photomap_gis.core.similarity import Similarity2D
from photomap_gis.pipeline.measure import Measurements, Pair
from photomap_gis.pipeline.settings import MapSettings
from photomap_gis.store import RegistrationRecord

RIGHT = RegistrationRecord.of(
    Registration(Similarity2D.identity(), np.eye(4), 0.99, (64, 64), accepted=True, a=0, b=1), EdgeKind.SEQUENTIAL
)
FAILED = replace(RIGHT, accepted=False, probability=0.1)


def measurements(*journal):
    mission = SimpleNamespace(registrations=list(journal))
    return Measurements(mission, None, {}, MapSettings(), lambda *_: None), mission


def test_what_the_journal_holds_is_not_measured_again():
    m, mission = measurements(RIGHT)  # without a shelf of spectra, measuring would fail
    assert m.accepted == []
    assert m._take([Pair(0, 1, EdgeKind.SEQUENTIAL)], "register") == 1
    assert m.accepted == [RIGHT] and mission.registrations == [RIGHT]


def test_a_pair_that_is_asked_for_twice_takes_both_tries():
    m, _ = measurements(FAILED, RIGHT)
    assert m._take([Pair(0, 1, EdgeKind.SEQUENTIAL)], "register") == 0
    assert m._take([Pair(0, 1, EdgeKind.LOOP)], "join", again=True) == 1


def test_what_nothing_asks_for_is_taken_over_but_undoes_nothing():
    m, _ = measurements(RIGHT, FAILED)
    assert m._take([Pair(0, 1, EdgeKind.SEQUENTIAL)], "register") == 1
    assert m.take_missing([]) == 0
    assert m.accepted == [RIGHT]
    alone, _ = measurements(RIGHT)
    assert alone.take_missing([]) == 1 and alone.accepted == [RIGHT]
