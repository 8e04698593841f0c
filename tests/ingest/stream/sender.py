"""Sends a video to an address again and again until it is ended: ``python sender.py VIDEO URL FORMAT [RATE [TURNS]]``.

A process of its own: FFmpeg in one process may hold Python up while it waits for itself.
"""

import contextlib
import sys
import time

import av


def main(video: str, url: str, kind: str, rate: float = 100.0, turns: int = 1000) -> None:
    while True:
        try:
            target = av.open(url, "w", format=kind, timeout=5, options={"flush_packets": "1"})
        except (av.FFmpegError, OSError):
            time.sleep(0.1)  # nobody listens yet
            continue
        with contextlib.suppress(av.FFmpegError, OSError):
            send(video, target, rate, turns)
            return


def send(video: str, target, rate: float, turns: int) -> None:
    with av.open(video) as source:
        stream = source.streams.video[0]
        out = target.add_stream_from_template(stream)
        packets = [(bytes(p), p.pts, p.dts, p.is_keyframe) for p in source.demux(stream) if p.size]
        length = packets[-1][2] - packets[0][2] + round(1 / 10 / stream.time_base)
        for turn in range(turns):
            for data, pts, dts, is_key in packets:
                packet = av.Packet(data)
                packet.pts, packet.dts = pts + turn * length, dts + turn * length
                packet.time_base, packet.is_keyframe, packet.stream = stream.time_base, is_key, out
                target.mux(packet)
                time.sleep(1.0 / rate)
    target.close()


if __name__ == "__main__":
    main(*sys.argv[1:4], *(float(a) for a in sys.argv[4:5]), *(int(a) for a in sys.argv[5:6]))
