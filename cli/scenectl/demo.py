"""`scenectl demo`: the whole way in one go, with the sample scene that the project brings along."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from scenectl.output import PLAIN, Output, emit
from scenectl.values import HD_QUARTER, PortsOption, SizeOption, whole

app = App(name="demo", help_format="plaintext", help_epilogue="Example: scenectl demo --output demo-output")


@app.default
def demo(
    *,
    to: Annotated[Path, Parameter(name=("--output", "-o"))] = Path("demo-output"),
    nodes: Annotated[int, whole(1, 127)] = 5,
    samples: Annotated[int, whole(1, 1_048_576)] = 32,
    size: SizeOption = HD_QUARTER,
    kill: bool = True,
    ports: PortsOption | None = None,
    output: Output = PLAIN,
) -> None:
    """Start five nodes on this machine, import the sample scene, render it, and write image and report.

    Parameters
    ----------
    to
        Folder for image.exr, image.png and report.json; made if need be.
    nodes
        Number of nodes.
    samples
        Paths for each pixel.
    size
        Width and height in pixels.
    kill
        Kill one node in the midst of the render: the others go on, and the image has the same bits.
    ports
        Ports of the nodes, LOW,HIGH; by default 17349,17350.
    """
    from scenectl.progress import Progress
    from scenectl.running import run
    from scenectl.still import ImageFiles, StillJob, check_files, make_still, report_text
    from scenefold.base.errors import LocalFault
    from scenefold.render.client import StillOptions
    from scenefold.scene.sample import sample_scene_path

    try:
        to.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LocalFault(f"cannot make the folder: {error.strerror}", where=str(to), remedy="choose another --output") from error
    exr, png = to / "image.exr", to / "image.png"
    check_files(None, exr, png)
    options = StillOptions(width=size.width, height=size.height, samples=samples, seed=1, algorithm="bounded-radial", sky=None, camera=None)
    job = StillJob(
        file=sample_scene_path(),
        scene_name="sample",
        profile=None,
        nodes=nodes,
        threads=None,
        ports=ports,
        options=options,
        files=ImageFiles(exr, png),
        kill=kill,
    )
    with Progress(quiet=output.json) as progress:
        report = run(make_still, job, progress)
    (to / "report.json").write_text(json.dumps(report, indent=2, ensure_ascii=False) + "\n")
    emit(output, report, report_text(report) + f"\nThe figures are in {to / 'report.json'}.")
