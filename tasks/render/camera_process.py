"""The process that draws what cameras on robots see: worlds and poses in, pixels out.

Run as ``python -m tasks.render.camera_process``; ``camera_pool`` starts it, with MUJOCO_GL, and writes its requests, a
line each.
"""

import sys
from collections.abc import Iterator
from typing import BinaryIO

from tasks.render.camera_pool import DRAWN, REQUEST, AddCamera, Draw, Forget
from tasks.render.camera_renderer import CameraRenderer, episode_light, exposed, mounted, say_ready

_SIZE = 16  # of a window that nobody draws into


class _Cameras:
    """Renderers by key."""

    def __init__(self) -> None:
        self._added: dict[str, tuple[AddCamera, CameraRenderer]] = {}

    def answer(self, request: AddCamera | Draw | Forget) -> Iterator[bytes]:
        """Yields the answer to a request."""
        if isinstance(request, AddCamera):
            self._added[request.key] = request, CameraRenderer(request.world, request.camera, request.robot)
            yield DRAWN
        elif isinstance(request, Draw):
            yield from self._drawn(request)
        else:
            self._added.pop(request.key)[1].close()
            yield DRAWN

    def _drawn(self, request: Draw) -> Iterator[bytes]:
        for shot in request.shots:
            added, renderer = self._added[shot.key]
            pose = mounted(added.camera, shot.x_m, shot.y_m, shot.yaw_rad)
            if request.kind == "color":
                renderer.stand(shot.x_m, shot.y_m, shot.yaw_rad)
                pixels = renderer.color(pose, episode_light(added.camera, shot.seed))
                yield exposed(pixels, added.camera, shot.seed, (shot.number, shot.place)).tobytes()
            else:
                for array in renderer.depth_and_solids(pose):
                    yield array.tobytes()


def _serve(asked: BinaryIO, drawn: BinaryIO) -> None:
    cameras = _Cameras()
    for line in asked:
        for part in cameras.answer(REQUEST.validate_json(line)):
            drawn.write(part)
        drawn.flush()


def main() -> None:
    """Draws what standard input asks for, to standard output."""
    context = say_ready(_SIZE, _SIZE)
    _serve(sys.stdin.buffer, sys.stdout.buffer)
    context.free()


if __name__ == "__main__":
    main()
