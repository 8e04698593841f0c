"""``photomap cameras``: every camera that it lists with a lens can be planned with."""

import json

import pytest

from photomap_gis.cli import main


def test_every_camera_with_a_lens_can_be_named(capsys):
    from photomap_gis.pipeline.plan_camera import LensNumbers, camera_optics

    assert main(["cameras", "--json"]) == 0
    cameras = json.loads(capsys.readouterr().out)["cameras"]
    assert len(cameras) > 50
    for camera in cameras:
        fov = 60.0 if camera["fov_deg"] is None else None
        optics = camera_optics(camera["name"], LensNumbers(fov_deg=fov))
        assert (optics.width_px, optics.height_px) == (camera["width_px"], camera["height_px"])


def test_words_narrow_the_list(capsys):
    assert main(["cameras", "mavic", "--json"]) == 0
    names = [c["name"] for c in json.loads(capsys.readouterr().out)["cameras"]]
    assert names and all("mavic" in n.lower() for n in names)


def test_a_word_that_nothing_knows_is_told(capsys):
    assert main(["cameras", "no", "such"]) == 0
    out, err = capsys.readouterr()
    assert out == "" and "no such" in err


def test_a_drawing_is_written_beside_the_json(tmp_path, capsys):
    drawing = tmp_path / "drawing.geojson"
    field = "47,8;47,8.004;47.003,8.004;47.003,8.001"
    assert main(["plan", field, "--height", "60", "--json", "-q", "--drawing", str(drawing)]) == 0
    told = json.loads(capsys.readouterr().out)
    drawn = json.loads(drawing.read_text())
    assert told["files"] == [str(drawing)]
    assert sum(f["properties"]["kind"] == "footprint" for f in drawn["features"]) == told["photos"]


@pytest.mark.parametrize("pattern", ["expanding-square", "sector", "spiral", "orbit"])
def test_search_patterns_are_drawn_too(tmp_path, capsys, pattern):
    drawing = tmp_path / "drawing.geojson"
    asked = ["plan", "--pattern", pattern, "--datum", "47,8", "--radius", "200", "--height", "50", "-q"]
    assert main([*asked, "--json", "--drawing", str(drawing)]) == 0
    kinds = {f["properties"]["kind"] for f in json.loads(drawing.read_text())["features"]}
    assert {"path", "waypoint", "covered"} <= kinds
    assert ("footprint" in kinds) == (pattern != "orbit")  # it looks at the datum, not down
