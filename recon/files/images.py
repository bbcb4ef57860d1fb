"""Photographs, of any depth and number of channels, as (H, W, 3) uint8 RGB."""

from __future__ import annotations

import io
import os
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pictures
from PIL import UnidentifiedImageError

from calib.pair import Image
from recon.files.writing import atomic
from recon.types import Array

__all__ = [
    "contents_of",
    "encoded",
    "image_size",
    "read_image",
    "read_image_pair",
    "read_side_by_side",
    "write_image",
]

CAUSES = (
    (b"Pf\n", "it is a PFM map; read it with read_pfm"),
    (b"PF\n", "it is a PFM map; read it with read_pfm"),
    (b"version https://git-lfs", "it is a Git LFS pointer; run `git lfs pull`"),
    (b"<", "it is a web page or XML; was a link saved in place of the picture?"),
    (b"%PDF", "it is a PDF document"),
    (b"PK\x03\x04", "it is a zip archive; unpack it first"),
    (b"\x1f\x8b", "it is a gzip archive; unpack it first"),
    (b"\x93NUMPY", "it is a NumPy array"),
    (b"ply", "it is a PLY file"),
    (b"II*\x00", "the TIFF is damaged or of a kind that OpenCV cannot read, such as floats"),
    (b"MM\x00*", "the TIFF is damaged or of a kind that OpenCV cannot read, such as floats"),
    (b"\x89PNG", "the PNG is damaged; was the copy interrupted?"),
    (b"\xff\xd8\xff", "the JPEG is damaged; was the copy interrupted?"),
)
ORIENTATION = 0x0112  # the tag of EXIF
QUARTER_TURNS = (5, 6, 7, 8)
DEPTHS_IN_16_BITS = (8, 10, 12, 14, 16)


def read_image(path: str | os.PathLike[str]) -> Image:
    """Read a photograph.

    Grey becomes three equal channels, transparency is dropped, the orientation noted by a camera
    (EXIF) is applied. Of 16-bit files the depth b is the least of 8, 10, 12, 14 and 16 bits that
    holds the largest value, and v becomes round(255 v / (2^b - 1)): 65535 becomes 255, and so
    does 4095 of a 12-bit camera. Read both images of a pair with `read_image_pair`, which finds
    one depth for both.

    Args:
        path: PNG, JPEG, TIFF, BMP, WebP, PPM or another format of OpenCV.

    Returns:
        (H, W, 3) uint8 RGB.

    Raises:
        FileNotFoundError: if there is no such file.
        IsADirectoryError: if it is a folder.
        ValueError: if it is empty, damaged or not an image; the message names the likely cause.
    """
    image = _decoded(Path(path))
    return _eight_bits(image, _bit_depth(image))


def read_image_pair(
    left: str | os.PathLike[str], right: str | os.PathLike[str]
) -> tuple[Image, Image]:
    """Read two photographs taken together, with one scale of brightness for both.

    Args:
        left: file of the left view.
        right: file of the right view.

    Returns:
        Two (H, W, 3) uint8 RGB images of the same size.

    Raises:
        FileNotFoundError: if there is no such file.
        IsADirectoryError: if one is a folder.
        ValueError: if one is not an image or the sizes differ.
    """
    images = [_decoded(Path(left)), _decoded(Path(right))]
    (rows, columns), (rows_right, columns_right) = (image.shape[:2] for image in images)
    if (rows, columns) != (rows_right, columns_right):
        raise ValueError(
            f"left image {left} is {columns} x {rows} but right image {right} is "
            f"{columns_right} x {rows_right} (width x height); are they of the same pair?"
        )
    depth = max((_bit_depth(image) for image in images if image.dtype == np.uint16), default=8)
    return _eight_bits(images[0], depth), _eight_bits(images[1], depth)


def read_side_by_side(path: str | os.PathLike[str]) -> tuple[Image, Image]:
    """Read one picture that holds the left view in its left half and the right view beside it.

    Args:
        path: file of the picture.

    Returns:
        Two (H, W / 2, 3) uint8 RGB images.

    Raises:
        FileNotFoundError: if there is no such file.
        IsADirectoryError: if it is a folder.
        ValueError: if it is not an image, or its width is odd.
    """
    image = read_image(path)
    width = image.shape[1]
    if width % 2:
        raise ValueError(
            f"{path} is {width} pixels wide, which cannot be halved; is it really two views "
            "side by side?"
        )
    return image[:, : width // 2].copy(), image[:, width // 2 :].copy()


def image_size(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Return (width, height) of a picture as `read_image` returns it; only its head is read.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is empty or not an image.
    """
    contents = contents_of(path)
    try:
        with Pictures.open(io.BytesIO(contents)) as picture:
            turned = picture.getexif().get(ORIENTATION, 1) in QUARTER_TURNS
            width, height = picture.size
            return (height, width) if turned else (width, height)
    except (UnidentifiedImageError, OSError) as error:
        raise ValueError(f"{path} is not an image: {_likely_cause(contents)}") from error


def write_image(path: str | os.PathLike[str], image: Array) -> None:
    """Write an image in the format that the name ends in.

    Args:
        path: ending in .png, .jpg or another format of OpenCV.
        image: (H, W, 3) uint8 RGB, or (H, W) uint8 or uint16 (16 bits only as PNG or TIFF).

    Raises:
        ValueError: if no format has this ending.
    """
    contents = encoded(image, Path(path).suffix)
    with atomic(path) as partial:
        partial.write_bytes(contents)


def encoded(image: Array, suffix: str) -> bytes:
    """Return the contents of an image file.

    Args:
        image: (H, W, 3) uint8 RGB, or (H, W) uint8 or uint16.
        suffix: of the file name, such as ".png".

    Raises:
        ValueError: if no format has this ending, or it holds fewer bits.
    """
    if not cv2.haveImageWriter(f"image{suffix}"):
        raise ValueError(f"no image format ends in '{suffix}'; use .png or .jpg")
    if image.dtype == np.uint16 and suffix.lower() not in (".png", ".tif", ".tiff"):
        raise ValueError(f"'{suffix}' files hold 8 bits a channel, not 16; use .png")
    in_bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    _, contents = cv2.imencode(suffix, in_bgr)
    return contents.tobytes()


def _decoded(path: Path) -> Array:
    """Return the pixels of an image file, (H, W, 3) uint8 or uint16 RGB."""
    contents = contents_of(path)
    if _is_truncated(contents):
        raise ValueError(f"{path} ends too early; was the copy interrupted?")
    try:
        # imdecode, not imread: names may hold any character on any system
        image = cv2.imdecode(
            np.frombuffer(contents, np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR
        )
    except cv2.error as error:
        raise ValueError(f"{path} cannot be decoded: {error.err}") from error
    if image is None or contents.startswith((b"Pf", b"PF")):
        raise ValueError(f"{path} is not an image: {_likely_cause(contents)}")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path} has {image.dtype} pixels; expected 8 or 16 bits a channel")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def contents_of(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a file; raise an error that helps if there are none."""
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; expected an image file")
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}{_neighbours(path)}")
    contents = path.read_bytes()
    if not contents:
        raise ValueError(f"{path} is empty (0 bytes); was the copy interrupted?")
    return contents


def _neighbours(path: Path) -> str:
    """Say what the folder holds in place of a missing file."""
    if not path.parent.is_dir():
        return f"; the folder {path.parent} does not exist either"
    names = sorted(entry.name for entry in path.parent.iterdir())
    shown = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    return f"; its folder holds {shown or 'nothing'}"


def _is_truncated(contents: bytes) -> bool:
    """Return whether a PNG or JPEG lacks its end; decoders paint the rest grey and say nothing.

    Inside the pixels of a JPEG a marker byte is always escaped, so an end after the last start
    of a scan is genuine; cameras may append anything behind it.
    """
    if contents.startswith(b"\x89PNG"):
        return b"IEND" not in contents
    if contents.startswith(b"\xff\xd8\xff"):
        return contents.rfind(b"\xff\xd9") < contents.rfind(b"\xff\xda")
    return False


def _likely_cause(contents: bytes) -> str:
    """Say what the first bytes of a file look like."""
    for start, cause in CAUSES:
        if contents.startswith(start):
            return cause
    if contents[4:8] == b"ftyp":
        return "it is a HEIC picture or a video; convert it to PNG or JPEG"
    return f"it begins with {contents[:8]!r}; expected PNG, JPEG, TIFF or similar"


def _bit_depth(image: Array) -> int:
    """Return the least usual bit depth that holds the largest value."""
    needed = int(image.max()).bit_length()
    return next(depth for depth in DEPTHS_IN_16_BITS if depth >= needed)


def _eight_bits(image: Array, depth: int) -> Image:
    """Scale a 16-bit image by its bit depth; leave an 8-bit one as it is."""
    if image.dtype == np.uint8:
        return image
    scale = 255 / (2**depth - 1)
    table = np.rint(np.arange(2**depth) * scale).astype(np.uint8)
    scaled: Image = table[image]
    return scaled
