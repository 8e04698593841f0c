import pytest

from photomap_gis.core.control import check_names
from photomap_gis.core.errors import UsageError

NAMES = ["a", "b", "c", "d", "e", "f", "g"]


def test_check_points_by_name_or_every_so_often():
    assert check_names(NAMES, ["b", "e"]) == {"b", "e"}
    assert check_names(NAMES, ["every-third"]) == {"c", "f"}
    assert check_names(NAMES, ["every-5", "a"]) == {"e", "a"}
    assert check_names(NAMES, []) == frozenset()
    assert check_names(["every-third", "x"], ["every-third"]) == {"every-third"}


@pytest.mark.parametrize("word", ["z", "every-1", "every-", "every-other", "every-9"])
def test_what_cannot_be_a_check_point_is_told(word):
    with pytest.raises(UsageError, match=word):
        check_names(NAMES, [word])
