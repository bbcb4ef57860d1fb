"""Reading photographs and disparities, writing results. Every writer is atomic."""

from recon.files.clouds import CLOUD_FORMATS, read_cloud, write_cloud
from recon.files.depths import read_depth
from recon.files.glb import write_glb
from recon.files.images import (
    image_size,
    read_image,
    read_image_pair,
    read_side_by_side,
    write_image,
)
from recon.files.pfm import read_pfm, write_pfm
from recon.files.pictures import write_depth_png, write_disparity_png, write_status_png
from recon.files.ply import read_ply, write_ply
from recon.files.writing import atomic, write_json

__all__ = [
    "CLOUD_FORMATS",
    "atomic",
    "image_size",
    "read_cloud",
    "read_depth",
    "read_image",
    "read_image_pair",
    "read_pfm",
    "read_ply",
    "read_side_by_side",
    "write_cloud",
    "write_depth_png",
    "write_disparity_png",
    "write_glb",
    "write_image",
    "write_json",
    "write_pfm",
    "write_ply",
    "write_status_png",
]
