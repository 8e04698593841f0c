"""JSON values become the words of a command line, and click reads from those words the values that were meant."""

import math

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.cli.engine_command import job_command
from photomap_gis.cli.places import TakesCoordinates
from photomap_gis.core.errors import UsageError
from photomap_gis.engine.arguments import argv_of, command_document, offered
from photomap_gis.engine.kinds import KINDS


@click.command(cls=TakesCoordinates)
@click.argument("places", nargs=-1, required=True)
@click.option("-n", "--name", "called")
@click.option("--size", type=float)
@click.option("--count", type=int)
@click.option("--both", type=float, nargs=2)
@click.option("--many", multiple=True)
@click.option("--loud", "--shout", is_flag=True)
@click.option("--keep/--drop", default=None)
@click.option("--mode", type=click.Choice(["a", "b"]))
@click.option("--json", "as_json", is_flag=True)
def toy(**_: object) -> None:
    """A command of every sort of parameter."""


def understood(argv: list[str]) -> dict[str, object]:
    """What click makes of a job's words: the twin that every law here is held against."""
    return toy.make_context("toy", argv[1:]).params


words = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=30)
finite = st.floats(allow_nan=False, allow_infinity=False)


meant = st.fixed_dictionaries(
    {},
    optional={
        "name": words,
        "size": finite,
        "count": st.integers(-(2**40), 2**40),
        "both": st.lists(finite, min_size=2, max_size=2),
        "many": st.lists(words, max_size=3),
        "loud": st.booleans(),
        "keep": st.booleans(),
        "mode": st.sampled_from("ab"),
    },
)
plain = st.none() | st.booleans() | finite | words
anything = st.recursive(plain, lambda v: st.lists(v, max_size=3) | st.dictionaries(words, v, max_size=2), max_leaves=5)


@given(st.lists(words, min_size=1, max_size=4), meant)
def test_click_reads_what_the_client_gave(places, options):
    params = understood(argv_of("toy", toy, {"places": places, **options}, ["as_json"]))
    assert params["as_json"] is True
    assert [p.strip() for p in params["places"]] == [p.strip() for p in places]  # a coordinate is set off by a blank
    given_as = {"name": "called"}
    for name, value in options.items():
        got = params[given_as.get(name, name)]
        assert (list(got) if isinstance(value, list) else got) == value


@given(
    st.dictionaries(words | st.sampled_from(["size", "count", "both", "many", "loud", "mode"]), anything, max_size=4)
)
def test_anything_else_is_refused_with_words(arguments):
    try:
        argv = argv_of("toy", toy, {"places": ["x"], **arguments})
    except UsageError as error:
        assert str(error)
    else:
        understood(argv)  # what is not refused is what click can read


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "PLACES"),
        ({"places": ["x"], "size": "1"}, "size takes a number"),
        ({"places": ["x"], "count": 1.0}, "whole number"),
        ({"places": ["x"], "loud": 1}, "switch"),
        ({"places": ["x"], "both": [1]}, "2 values"),
        ({"places": ["x"], "both": 1}, "2 values"),
        ({"places": ["x"], "mode": "c"}, "'c' is not one of"),
        ({"places": ["x"], "loud": True, "shout": True}, "twice"),
        ({"places": ["x"], "size": math.nan}, None),
        ({"places": ["x"], "n": "short"}, "no argument 'n'"),
        ({"places": ["x"], "json": True}, "no argument 'json'"),
        ({"places": [None]}, "places takes"),
    ],
)
def test_refusals_name_the_argument(arguments, words):
    if words is None:
        assert argv_of("toy", toy, arguments)
        return
    with pytest.raises(UsageError, match=words):
        argv_of("toy", toy, arguments)


def test_null_is_as_if_it_were_not_given():
    assert argv_of("toy", toy, {"places": ["x"], "size": None}) == ["toy", "--", "x"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_command_that_tells_a_document(kind):
    command = job_command(kind)
    assert command.name == kind
    assert {"as_json"} <= {p.name for p in command.params}
    document = command_document(kind, command)
    assert [p.name for p in document.parameters] == list(offered(command))
    assert len(set(offered(command))) == len(offered(command))
    document.model_dump_json()  # every default can be said
