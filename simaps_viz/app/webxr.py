"""An Android phone as a live source: a page of ours, opened in its Chrome, sends depth, pictures and poses (WebXR).

WebXR is for secure pages only. ``adb reverse tcp:PORT tcp:PORT`` makes this machine the phone's own localhost, which is
one without a certificate; so this server listens on 127.0.0.1 and nowhere else. Each binary message of the page's
WebSocket is a frame, little-endian: `HEAD`, the depth (u16 [height, width], rows from the top), a JPEG or PNG of the
same view.
"""

import logging
import math
import struct
import threading
from contextlib import suppress
from http import HTTPStatus
from importlib.resources import files
from urllib.parse import urlsplit

import numpy as np
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from simaps_viz.datasets.calibration import Lens, pinhole
from simaps_viz.datasets.images import check_header, decode_color
from simaps_viz.errors import InputError
from simaps_viz.live.phone import PhoneFrame, PhoneSource, phone_pose
from simaps_viz.live.source import Traffic
from simaps_viz.segmentation.protocol import Network
from simaps_viz.viewer.server.access import ENTERED, SAFE_HEADERS, Access, headers_of

HEAD = struct.Struct("<4sHHIdf4f3f4f")
"""Magic; width and height of the depth; bytes of the picture, 0 = none; when it was taken, ms since 1970; metres of a
unit of depth; fx, fy, cx, cy in pixels of the depth; position, and quaternion x y z w, of the camera."""
MAGIC = b"SMX1"
MAX_DEPTH, MAX_PICTURE = 1024, 4096
"""Pixels along a side; phones have 160 to 640, and 2160."""
MAX_MESSAGE = 8 << 20
MAX_MS = 9e12
"""So that nanoseconds fit 64 bits."""
MAX_UNIT_M = 0.01
TAKEN_OVER = 4000
"""The connection was closed as another phone has come."""
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
PERMISSIONS = "camera=(self), xr-spatial-tracking=(self), microphone=(), geolocation=(), usb=(), serial=()"
ASSETS = {"/": ("webxr.html", "text/html; charset=utf-8"), "/webxr.js": ("webxr.js", "text/javascript")}


def read_frame(where: str, message: str | bytes, *, color: bool) -> PhoneFrame:
    """Return the frame of a message; ``color``: decode its picture; raises InputError for anything else."""
    if isinstance(message, str) or len(message) < HEAD.size or message[:4] != MAGIC:
        raise InputError(f"{where}: expected a frame of the page, found another message")
    _, width, height, size, ms, unit_m, fx, fy, cx, cy, *pose = HEAD.unpack_from(message)
    pixels = width * height
    if not (1 <= width <= MAX_DEPTH and 1 <= height <= MAX_DEPTH) or len(message) != HEAD.size + 2 * pixels + size:
        raise InputError(f"{where}: expected depth and a picture, found {width}x{height}, {len(message)} bytes")
    if not (0.0 <= ms < MAX_MS and 0.0 < unit_m <= MAX_UNIT_M):  # NaN is neither
        raise InputError(f"{where}: expected a time and a unit of depth, found {ms:g} ms and {unit_m:g} m")
    camera = pinhole(where, width, height, fx, fy, cx, cy)
    depth = np.frombuffer(message, "<u2", pixels, HEAD.size).reshape(height, width)
    picture, rgb = message[HEAD.size + 2 * pixels :], None
    if picture and color:
        across, down = check_header(where, picture)
        # A view has one shape, whatever the pixels; rounding them costs one each.
        alike = math.isclose(across * height, down * width, abs_tol=across + down + width + height)
        if max(across, down) > MAX_PICTURE or not alike:
            raise InputError(f"{where}: expected a picture like {width}x{height}, found {across}x{down}")
        rgb = decode_color(where, picture)
    return PhoneFrame(
        np.multiply(depth, np.float32(unit_m), dtype=np.float32), rgb, Lens(camera),
        phone_pose(where, pose[:3], pose[3:]), int(ms * 1e6),
    )  # fmt: skip


class WebXRSource(PhoneSource):
    """Serves the page, and takes the frames of the phone that came last."""

    def __init__(self, address: str, access: Access, *, network: Network | None, traffic: Traffic) -> None:
        """Take an address, webxr://PORT, and listen.

        Raises:
            InputError: it is none, or the port is taken.
        """
        super().__init__(address, network=network, traffic=traffic)
        port = address.removeprefix("webxr://").rstrip("/")
        if not (port.isascii() and port.isdigit() and int(port) < 65536):
            raise InputError(f"{address}: expected webxr://PORT, such as webxr://8090")
        self._access = access
        self._phone: ServerConnection | None = None
        self._lock = threading.Lock()
        try:
            self._server = serve(
                self._serve, access.host, int(port), process_request=self._answer, compression=None,
                max_size=MAX_MESSAGE, logger=logging.Logger("webxr", logging.CRITICAL + 1), server_header=None,
            )  # fmt: skip
        except OSError as error:
            raise InputError(f"{address}: expected a free port, found it taken ({error.strerror})") from error
        self.port = int(self._server.socket.getsockname()[1])
        self._thread = threading.Thread(target=self._listen, name="webxr", daemon=True)
        self._thread.start()

    @property
    def entrance(self) -> str:
        """Address for the phone's browser, with the token where one is asked for."""
        token = self._access.owner_token or self._access.token
        return f"http://localhost:{self.port}/{f'?token={token}' if token else ''}"

    def state(self) -> str:
        """Describe the connection."""
        if self._phone is not None:
            return "connected"
        return f"waiting for a phone: adb reverse tcp:{self.port} tcp:{self.port}, then open its page there"

    def close(self) -> None:
        """Stop serving."""
        super().close()
        self._server.shutdown()
        with self._lock:
            phone, self._phone = self._phone, None
        if phone is not None:
            phone.close()
        self._thread.join()

    def _listen(self) -> None:
        """Serve until the socket is closed, which may be before the thread has run."""
        with suppress(OSError):
            self._server.serve_forever()

    def decode(self, frame: str | bytes) -> PhoneFrame:
        """Return the frame of a message; raises InputError for anything else."""
        return read_frame(self.name, frame, color=self._color)

    def _serve(self, phone: ServerConnection) -> None:
        with self._lock:
            before, self._phone = self._phone, phone
        if before is not None:
            before.close(TAKEN_OVER, "another phone has come")
        try:
            for message in phone:
                self.feed(message)
        except ConnectionClosed:
            pass  # it may come back
        finally:
            with self._lock:
                self._phone = None if self._phone is phone else self._phone

    def _answer(self, phone: ServerConnection, request: Request) -> Response | None:
        """Answer a request under the rules of the workbench; None = let the phone open its WebSocket."""
        headers, path = headers_of(request.headers.raw_items()), request.path
        upgrades = "upgrade" in headers
        own, peer = str(phone.local_address[0]), str(phone.remote_address[0])
        refusal = self._access.refuse(headers, path, own_address=own, peer=peer, writes=upgrades)
        if refusal is None and upgrades and self._access.role(headers, path) != "owner":
            refusal = HTTPStatus.FORBIDDEN, "only the owner's phone may send frames"
        if refusal is not None:
            return _response(refusal[0], refusal[1].encode(), "text/plain")
        if (cookie := None if upgrades else self._access.entering(headers, path)) is not None:
            return _response(HTTPStatus.OK, ENTERED.format(path="/").encode(), "text/html; charset=utf-8", **cookie)
        name = urlsplit(path).path
        if upgrades and name == "/frames":
            return None
        if upgrades or name not in ASSETS:
            return _response(HTTPStatus.NOT_FOUND, b"no such page", "text/plain")
        file, media_type = ASSETS[name]
        return _response(HTTPStatus.OK, files("simaps_viz.app").joinpath(file).read_bytes(), media_type)


def _response(status: HTTPStatus, body: bytes, media_type: str, **others: str) -> Response:
    """Return an answer that ends the connection."""
    fields = SAFE_HEADERS | {
        "Permissions-Policy": PERMISSIONS, "Content-Security-Policy": CSP, "Cache-Control": "no-store",
        "Content-Type": media_type, "Content-Length": str(len(body)), "Connection": "close", **others,
    }  # fmt: skip
    return Response(status.value, status.phrase, Headers(fields), body)
