"""A real RTSP server on loopback, GStreamer's: a moving ball as JPEG. For the system's Python, which has the bindings.

Usage: rtsp_server.py PORT WIDTH HEIGHT RATE
"""

from __future__ import annotations

import sys

import gi  # pyright: ignore[reportMissingImports]

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # pyright: ignore[reportMissingImports]  # noqa: E402


def main() -> None:
    """Serve `rtsp://127.0.0.1:PORT/down` until killed."""
    port, width, height, rate = sys.argv[1:5]
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(
        f"( videotestsrc is-live=true pattern=ball ! video/x-raw,format=I420,width={width},"
        f"height={height},framerate={rate}/1 ! jpegenc ! rtpjpegpay name=pay0 pt=26 )"
    )
    server.get_mount_points().add_factory("/down", factory)
    server.attach(None)
    print("serving", flush=True)
    GLib.MainLoop().run()


if __name__ == "__main__":
    main()
