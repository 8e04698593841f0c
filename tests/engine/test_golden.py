"""The engine says what the golden documents of the protocol say."""

from pathlib import Path
from typing import Any

import pytest

from tests.engine import golden


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return golden.said_by_an_engine(tmp_path_factory.mktemp("golden"))


@pytest.mark.parametrize("name", sorted(p.stem for p in golden.PROTOCOL.glob("*.json")))
def test_the_engine_says_what_the_protocol_says(said, name):
    assert said[name] == golden.read(name)


def test_every_document_is_kept(said):
    assert set(said) == {p.stem for p in Path(golden.PROTOCOL).glob("*.json")}
