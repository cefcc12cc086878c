"""Renders a plain scene a few times and prints the driver and the median time, as JSON."""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Sequence

from OpenGL import GL

from simulation.world.gl import mujoco

_SCENE = """<mujoco><worldbody>
<light pos='0 0 9' castshadow='false'/><geom type='plane' size='9 9 1'/><geom size='1'/>
</worldbody></mujoco>"""
_PICTURES = 6


def main(arguments: Sequence[str]) -> int:
    """Render pictures of a size (columns, rows); 1 when they are black."""
    width, height = (int(text) for text in arguments)
    model = mujoco.MjModel.from_xml_string(_SCENE)
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.offsamples = 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    times_ms = []
    with mujoco.Renderer(model, height, width) as renderer:
        for _ in range(_PICTURES):
            began_s = time.perf_counter()
            renderer.update_scene(data)
            lit = bool(renderer.render().any())
            times_ms.append((time.perf_counter() - began_s) * 1e3)
        driver = (GL.glGetString(GL.GL_RENDERER) or b"unknown driver").decode()
    if not lit:
        print("the picture is black", file=sys.stderr)
        return 1
    print(json.dumps({"driver": driver, "ms": statistics.median(times_ms)}))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
