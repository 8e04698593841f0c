"""A decoded frame is converted once, by one thread at a time: the scaler belongs to the frame."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from photomap_gis.ingest.stream import picture


@pytest.mark.parametrize("what", ["bgr", "grey"])
def test_a_frame_is_converted_once_whoever_asks(monkeypatch, what):
    inside, most, done = [], [], []
    together = threading.Barrier(8)
    gate = threading.Event()

    def convert(frame):
        inside.append(1)
        most.append(len(inside))
        gate.wait(0.05)  # long enough for the others to come in, were they let
        inside.pop()
        return np.full((4, 6, 3)[: 3 if what == "bgr" else 2], 7, np.uint8)

    monkeypatch.setattr(picture, f"{what}_of", convert)
    decoded = picture.DecodedPicture(SimpleNamespace(height=4, width=6))

    def ask() -> None:
        together.wait()
        done.append(getattr(decoded, what))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] and len(done) == 8 and all(d is done[0] for d in done)
    assert not done[0].flags.writeable
