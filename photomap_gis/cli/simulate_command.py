"""``photomap simulate``: a flight with known truth."""

from __future__ import annotations

import json
from pathlib import Path

import click

from photomap_gis.cli.progress import ProgressBars


@click.command(name="simulate", short_help="Simulate a flight with known truth over any picture.")
@click.argument("ground", metavar="GROUND")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder to fill.")
@click.option("--video/--photos", default=False, help="An MP4 with its .SRT, or JPEGs with EXIF and XMP.",
              show_default=True)  # fmt: skip
@click.option("--frames", type=click.IntRange(1), default=80, show_default=True, help="Photos, or frames of the video.")
@click.option("--altitude", type=float, metavar="M", help="Height above ground; default: the frames fill the ground.")
@click.option("--height", "height_path", type=click.Path(path_type=Path, exists=True), metavar="FILE",
              help="Heights of GROUND in metres, a raster of the same size.")  # fmt: skip
@click.option("--ground-gsd", type=float, metavar="M", help="Pixel of GROUND, where it has no georeference.")
@click.option("--fov-deg", type=float, default=73.74, show_default=True, help="Horizontal field of view.")
@click.option("--width", type=int, default=1600, show_default=True, help="Frame width in pixels.")
@click.option("--frame-height", type=int, default=1200, show_default=True, help="Frame height in pixels.")
@click.option("--front", type=float, default=0.75, show_default=True, help="Front overlap of photos, 0-1.")
@click.option("--side", type=float, default=0.65, show_default=True, help="Side overlap, 0-1.")
@click.option("--heading", "headings", type=float, multiple=True, default=(0.0,), show_default=True, metavar="DEG",
              help="Direction of the strips from grid north; repeat to fly the pattern again.")  # fmt: skip
@click.option("--speed", type=float, default=6.0, show_default=True, help="Metres a second.")
@click.option("--jitter-deg", type=float, default=1.0, show_default=True, help="Sigma of roll and pitch.")
@click.option("--lean-deg", type=float, default=0.0, show_default=True, help="The camera looks ahead by this.")
@click.option("--report-attitude/--no-report-attitude", default=True, show_default=True,
              help="Whether the files say how the camera stood.")  # fmt: skip
@click.option("--gps-sigma", type=float, default=2.0, show_default=True, help="Gauss-Markov error per axis, metres.")
@click.option("--gps-tau", type=float, default=60.0, show_default=True, help="Its correlation time, seconds.")
@click.option("--gps-white", type=float, default=0.2, show_default=True, help="White error per axis, metres.")
@click.option("--gps-bias", type=float, nargs=2, default=(0.0, 0.0), show_default=True, metavar="E N",
              help="Constant error, metres.")  # fmt: skip
@click.option("--gps-dropouts", type=float, default=0.0, show_default=True, help="Share of frames without a fix.")
@click.option("--error-frames", type=float, default=0.0, show_default=True, help="Share of broken frames.")
@click.option("--rolling-shutter-ms", type=float, default=0.0, show_default=True, help="Read-out time of a frame.")
@click.option("--thermal", is_flag=True, help="The look of a thermal camera.")
@click.option("--bitrate", type=float, default=4.0, show_default=True, metavar="MBIT_S", help="Of the video.")
@click.option("--video-rate", type=float, default=5.0, show_default=True, metavar="HZ", help="Of the video.")
@click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same flight.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON on stdout.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    ground: str,
    output: Path,
    *,
    video: bool,
    frames: int,
    altitude: float | None,
    height_path: Path | None,
    ground_gsd: float | None,
    fov_deg: float,
    width: int,
    frame_height: int,
    front: float,
    side: float,
    headings: tuple[float, ...],
    speed: float,
    jitter_deg: float,
    lean_deg: float,
    report_attitude: bool,
    gps_sigma: float,
    gps_tau: float,
    gps_white: float,
    gps_bias: tuple[float, float],
    gps_dropouts: float,
    error_frames: float,
    rolling_shutter_ms: float,
    thermal: bool,
    bitrate: float,
    video_rate: float,
    seed: int,
    as_json: bool,
    quiet: bool,
) -> None:
    """Simulate a flight over GROUND: a picture, a GeoTIFF, or the word ``procedural`` for a made scene with relief.

    \b
    photomap simulate procedural -o sim
    photomap simulate ortho.tif --frames 40 --altitude 80 --jitter-deg 2 --no-report-attitude -o sim
    photomap simulate procedural --video --frames 300 --error-frames 0.02 -o sim-video

    DIR then holds photos/ or video/ as a drone would write them, and truth/ with the true poses and ground.
    """
    from photomap_gis.simulate import FlightSpec, GpsError, Imaging, Motion, run_simulation

    spec = FlightSpec(
        frames=frames,
        altitude_m=altitude,
        hfov_deg=fov_deg,
        width_px=width,
        height_px=frame_height,
        front_overlap=front,
        side_overlap=side,
        speed_m_s=speed,
        headings_deg=headings,
        video_rate_hz=video_rate,
        bitrate_bit_s=round(bitrate * 1e6),
        report_attitude=report_attitude,
        motion=Motion(tilt_deg=jitter_deg, lean_deg=lean_deg),
        gps=GpsError(
            white_sigma_m=gps_white,
            walk_sigma_m=gps_sigma,
            walk_tau_s=gps_tau,
            bias_east_m=gps_bias[0],
            bias_north_m=gps_bias[1],
            dropout_share=gps_dropouts,
        ),
        imaging=Imaging(rolling_shutter_ms=rolling_shutter_ms, thermal=thermal, error_share=error_frames),
        seed=seed,
    )
    with ProgressBars(quiet=quiet) as bars:
        result = run_simulation(
            ground,
            output,
            spec,
            video=video,
            pixel_size_m=ground_gsd,
            height_path=height_path,
            on_progress=lambda done, total: bars("simulate", done, total),
        )
    if as_json:
        document = {
            "source": str(result.source),
            "truth": str(result.truth.folder),
            "frames": len(result.truth.frames),
            "gsd_m_per_px": result.truth.gsd_m_per_px,
            "outputs": [str(result.source), str(result.truth.folder)],
        }
        click.echo(json.dumps(document, indent=1))
    else:
        click.echo(f"{result.source}: {len(result.truth.frames)} frames at {result.truth.gsd_m_per_px * 100:.1f} cm; "
                   f"truth in {result.truth.folder}\nmap it: photomap map {result.source} -o MISSION")  # fmt: skip
