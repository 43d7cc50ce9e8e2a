"""Single messages of ROS: every encoding of pictures, cameras of every distortion model, transforms of every rate."""

import struct
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores
from scans_bags import Messages, rvl

from simaps_viz.datasets.calibration import Lens, _pixels, see_through
from simaps_viz.datasets.ros_messages import Transforms, decode_color, decode_depth, decode_lens, unpack_rvl
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics

MAKE = Messages(Stores.ROS2_HUMBLE)
K = Intrinsics(160, 120, 130.0, 131.0, 80.0, 61.0)
AZURE = (0.5285, -2.5918, 0.00085, -0.00039, 1.4947, 0.4072, -2.4131, 1.4217)
"""Of an Azure Kinect's colour camera: k1, k2, p1, p2, k3, k4, k5, k6."""


@given(st.lists(st.sampled_from([0, 0, 1, 2, 700, 705, 65535]), min_size=1, max_size=60))
@settings(deadline=None)
def test_rvl_unpacks_what_was_packed(values):
    depth = np.array(values, np.uint16)[None]
    np.testing.assert_array_equal(unpack_rvl("x", rvl(depth), depth.size, 1), depth)


@given(st.binary(max_size=80), st.integers(1, 40), st.integers(1, 4))
@settings(deadline=None)
def test_damaged_rvl_is_refused_or_read(packed, width, height):
    try:
        assert unpack_rvl("here", packed, width, height).shape == (height, width)
    except InputError as error:
        assert str(error).startswith("here: expected a depth image")


def test_compressed_depth_as_rvl():
    steps = np.array([[0, 700, 1234], [2500, 5000, 0]], np.uint16)
    data = bytes(12) + struct.pack("<ii", 3, 2) + rvl(steps)
    found = decode_depth("x", MAKE.compressed(0.0, data, "16UC1; compressedDepth rvl"))
    np.testing.assert_allclose(found, steps * 0.001, rtol=1e-6)
    for cut in (bytes(12), data[:-4]):
        with pytest.raises(InputError, match="RVL"):
            decode_depth("x", MAKE.compressed(0.0, cut, "16UC1; compressedDepth rvl"))


RGB = np.array([[(200, 40, 30), (20, 150, 60)], [(30, 60, 180), (120, 120, 120)]], np.uint8).repeat(8, 0).repeat(8, 1)
"""Four squares of 8 x 8 pixels."""


def yuv(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ITU-R BT.601, limited range."""
    r, g, b = (rgb[..., i].astype(float) / 255 for i in range(3))
    y = 16 + 65.481 * r + 128.553 * g + 24.966 * b
    u, v = 128 - 37.797 * r - 74.203 * g + 112 * b, 128 + 112 * r - 93.786 * g - 18.214 * b
    return tuple(np.rint(x).astype(np.uint8) for x in (y, u, v))  # pyright: ignore[reportReturnType]


def pairs(first: str) -> np.ndarray:
    y, u, v = yuv(RGB)
    chroma = np.where(np.arange(16) % 2 == 0, u, v)
    return np.stack([chroma, y] if first == "u" else [y, chroma], axis=-1)


def planes(order: str) -> np.ndarray:
    y, u, v = yuv(RGB)
    half = {"u": u[::2, ::2], "v": v[::2, ::2]}
    return np.vstack([y, np.stack([half[c] for c in order], axis=-1).reshape(8, 16)])


def bayer(pattern: str) -> np.ndarray:
    out = np.zeros((16, 16), np.uint8)
    for i, letter in enumerate(pattern):
        out[i // 2 :: 2, i % 2 :: 2] = RGB[i // 2 :: 2, i % 2 :: 2, "rgb".index(letter)]
    return out


PICTURES = {
    "rgb8": RGB, "bgr8": RGB[..., ::-1], "8UC3": RGB[..., ::-1], "rgba8": np.dstack([RGB, RGB[..., 0]]),
    "bgra8": np.dstack([RGB[..., ::-1], RGB[..., 0]]), "yuv422": pairs("u"), "uyvy": pairs("u"),
    "yuv422_yuy2": pairs("y"), "yuyv": pairs("y"), "nv12": planes("uv"), "nv21": planes("vu"),
    **{f"bayer_{pattern}8": bayer(pattern) for pattern in ("rggb", "bggr", "gbrg", "grbg")},
}  # fmt: skip


@pytest.mark.parametrize("encoding", PICTURES)
def test_colours_are_the_same_in_every_encoding(encoding):
    message = MAKE.image(0.0, np.ascontiguousarray(PICTURES[encoding]), encoding)
    message.height = 16
    rgb = decode_color("x", message)
    assert rgb.shape == (16, 16, 3) and rgb.dtype == np.uint8
    for v, u in ((4, 4), (4, 12), (12, 4), (12, 12)):  # amid the squares, where no neighbour is of another colour
        assert np.abs(rgb[v, u].astype(int) - RGB[v, u]).max() <= (3 if "v" in encoding else 0)


def test_pictures_that_are_not_read():
    with pytest.raises(InputError, match=r"x: expected colour as rgb8, .*, found 'rgb16'"):
        decode_color("x", MAKE.image(0.0, RGB, "rgb16"))
    with pytest.raises(InputError, match="a picture in nv12, found one of 15x15 pixels"):
        odd = MAKE.image(0.0, np.zeros((22, 15), np.uint8), "nv12")
        odd.height = 15
        decode_color("x", odd)


def info(model: str, D, **changes) -> SimpleNamespace:
    k = K.matrix()
    fields = {
        "width": K.width, "height": K.height, "distortion_model": model, "d": np.array(D, float), "k": k.ravel(),
        "p": np.hstack([k * [[0.9], [0.9], [1]], np.zeros((3, 1))]).ravel(), "binning_x": 0, "binning_y": 0,
        "roi": SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    }  # fmt: skip
    return SimpleNamespace(**fields | changes)


@pytest.mark.parametrize(
    ("model", "D"),
    [
        ("plumb_bob", (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
        ("plumb_bob", (-0.1, 0.02, 0.001, -0.002)),
        ("rational_polynomial", AZURE),
        ("equidistant", (-0.0128, 0.0421, -0.0397, 0.0072)),
        ("equidistant", (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_lenses_are_those_of_opencv(model, D):
    lens = decode_lens("x", info(model, D), rectified=False)
    args = (K.matrix(), np.array(D), np.eye(3), K.matrix(), (K.width, K.height), cv2.CV_32FC1)
    expected = cv2.fisheye.initUndistortRectifyMap(*args) if lens.fisheye else cv2.initUndistortRectifyMap(*args)
    for found, wanted in zip(_pixels(lens, K), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=2e-3)
    assert lens.fisheye == (model == "equidistant")


def test_where_a_polynomial_turns_back_there_is_nothing():
    """r (1 - r^2 / 2) is largest at r = 0.816; rays farther out would fall on pixels of nearer ones."""
    wide = Intrinsics(400, 4, 130.0, 130.0, 200.0, 2.0)
    seen = see_through(np.full((120, 160), 5, np.uint8), Lens(K, (-0.5,)), wide, exact=True)
    radius = np.abs(np.arange(400) - wide.cx) / wide.fx
    assert not seen[2, radius > 0.82].any() and seen[2, radius < 0.5].all()


def test_rectified_pictures_have_the_camera_of_p_and_raw_ones_that_of_k():
    bent = info("plumb_bob", (0.1, 0, 0, 0, 0))
    assert decode_lens("x", bent, rectified=False).intrinsics == K
    rectified = decode_lens("x", bent, rectified=True)
    assert rectified.intrinsics.fx == pytest.approx(117.0) and not rectified.distortion
    without_p = info("plumb_bob", (0.1, 0, 0, 0, 0), p=np.zeros(12))
    assert decode_lens("x", without_p, rectified=True).distortion == (0.1,)


def test_binned_and_cropped_pictures():
    roi = SimpleNamespace(x_offset=20, y_offset=10, width=120, height=100)
    k = decode_lens("x", info("plumb_bob", (), roi=roi, binning_x=2, binning_y=2), rectified=False).intrinsics
    assert (k.width, k.height, k.fx, k.fy, k.cx, k.cy) == (60, 50, 65.0, 65.5, 30.0, 25.5)


@pytest.mark.parametrize(("model", "D"), [("plumb_bob", AZURE), ("thin_prism", (0.1,)), ("equidistant", (0.1,) * 5)])
def test_other_distortion_is_refused(model, D):
    with pytest.raises(InputError, match=f"x: expected distortion model .*plumb_bob, .*, found '{model}' of"):
        decode_lens("x", info(model, D), rectified=False)


def moved(x: float) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    return T


def test_a_correction_once_a_second_holds_in_between_and_a_silent_drive_does_not():
    """Odometry comes 20 times a second, map to odom once; a robot's localisation does that."""
    tree = Transforms()
    for i in range(201):
        if not 100 < i < 130:
            tree.add("odom", "base", i / 20, moved(i / 20), fixed=False)
    for second in range(1, 9):
        tree.add("map", "odom", float(second), moved(0.1 * second), fixed=False)
    at = np.array([0.0, 1.0, 2.5, 5.5, 9.5])
    T, known = tree.poses("base", at)
    assert known.tolist() == [True, True, True, False, True]
    np.testing.assert_allclose(T[known, 0, 3], [0.1, 1.1, 2.75, 10.3], atol=1e-12)
    alone = Transforms()
    for second in range(9):
        alone.add("map", "base", float(second), moved(second), fixed=False)
    assert alone.poses("base", at)[1].tolist() == [True, True, False, False, False], "nothing else says where it is"


def test_frames_fixed_to_each_other():
    tree = Transforms()
    tree.add("odom", "base", 0.0, moved(5), fixed=False)
    tree.add("base", "depth", 0.0, moved(1), fixed=True)
    tree.add("base", "rgb", 0.0, moved(0.25), fixed=True)
    found = tree.between("rgb", "depth")
    assert found is not None and found[0, 3] == pytest.approx(0.75)
    assert tree.between("odom", "depth") is None and tree.between("elsewhere", "depth") is None
    np.testing.assert_array_equal(tree.between("here", "here"), np.eye(4))
