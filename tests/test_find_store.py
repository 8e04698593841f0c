"""Finds on disk: whole or not at all, others' features kept, crashes survived."""

import json
import threading
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.core.errors import DataError
from photomap_gis.core.find import FindAnchor, FindKind, MarkedFind
from photomap_gis.find_store import FindStore, _feature_of, _find_of

NUMBER = st.floats(-1e9, 1e9)
PLACE = st.tuples(st.floats(-180, 180), st.floats(-90, 90))
FINDS = st.builds(
    MarkedFind,
    st.from_regex(r"f-[a-z0-9]{1,20}", fullmatch=True),
    st.sampled_from(FindKind),
    st.text(min_size=1, max_size=80),
    st.just("2026-05-01T10:00:00Z"),
    st.text(max_size=200),
    st.none() | PLACE,
    st.none() | st.tuples(NUMBER, NUMBER),
    st.none() | st.floats(0, 1e6),
    st.none() | st.builds(FindAnchor, st.integers(0, 10**7), NUMBER, NUMBER),
    st.booleans(),
)


@given(FINDS)
def test_a_find_comes_back_as_it_went(find):
    feature = json.loads(json.dumps(_feature_of(find), allow_nan=False))
    assert _find_of(feature) == find
    assert (feature["geometry"] is None) == (find.lon_lat is None)


LEAVES = st.none() | st.booleans() | st.floats() | st.text(max_size=5)
KEYS = st.sampled_from(["properties", "geometry", "id", "kind", "coordinates"])
ANYTHING = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner))


@given(ANYTHING)
def test_whatever_others_wrote_is_no_find_of_ours(value):
    feature = value if isinstance(value, dict) else {"properties": value}
    assert _find_of(feature) is None


def add(store: FindStore, kind: FindKind = FindKind.VICTIM, **more) -> MarkedFind:
    return store.add(kind, time_utc="2026-05-01T10:00:00Z", lon_lat=(9.0, 48.0), **more)


def test_features_of_others_are_kept(tmp_path):
    theirs = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [1, 2]}, "properties": {"name": "x"}}
    (tmp_path / "finds.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [theirs]}))
    store = FindStore(tmp_path)
    find = add(store, jpeg=b"\xff\xd8")
    store.change(find.id, note="n")
    assert store.features()[0] == theirs and len(store.all()) == 1
    store.remove(find.id)
    assert store.features() == [theirs] and list((tmp_path / "finds").iterdir()) == []


def test_many_at_once_lose_none(tmp_path):
    store = FindStore(tmp_path)
    threads = [threading.Thread(target=lambda: [add(store) for _ in range(5)]) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    finds = FindStore(tmp_path).all()
    assert len({f.id for f in finds}) == 30
    assert sorted(f.name for f in finds) == sorted(f"Victim {n}" for n in range(1, 31))


def test_a_killed_writer_leaves_the_old_finds(tmp_path, monkeypatch):
    store = FindStore(tmp_path)
    first = add(store)

    def die(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("photomap_gis.publish._replace", die)
    with pytest.raises(KeyboardInterrupt):
        add(store)
    monkeypatch.undo()
    assert FindStore(tmp_path).all() == (first,)


def test_moving_writes_only_where_something_moved(tmp_path):
    store = FindStore(tmp_path)
    find = add(store, anchor=FindAnchor(3, 1.5, 2.5))
    stamp = store.path.stat().st_mtime_ns
    assert not store.move(lambda f: f) and store.path.stat().st_mtime_ns == stamp
    assert store.move(lambda f: replace(f, lon_lat=(9.5, 48.5)))
    assert store.get(find.id).lon_lat == (9.5, 48.5) and store.get(find.id).anchor == find.anchor


@pytest.mark.parametrize("text", ["", "[", "7", "[]", '{"features": 3}', "{" * 100000])
def test_a_damaged_file_is_told_and_left_alone(tmp_path, text):
    (tmp_path / "finds.geojson").write_text(text)
    store = FindStore(tmp_path)
    assert store.all() == ()
    with pytest.raises(DataError, match=r"finds\.geojson"):
        add(store)
    assert (tmp_path / "finds.geojson").read_text() == text


@pytest.mark.parametrize("id", ["../mission", "", "F-1", "a/b", "x" * 41, "f-\n"])
def test_a_name_is_never_a_path(tmp_path, id):
    (tmp_path / "mission.jpg").write_bytes(b"x")
    (tmp_path / "finds").mkdir()
    with pytest.raises(KeyError):
        FindStore(tmp_path).snapshot(id)
    with pytest.raises(KeyError):
        FindStore(tmp_path).remove(id)
