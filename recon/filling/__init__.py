"""Disparities for the pixels that have none."""

from recon.filling.background import BackgroundFilling
from recon.filling.protocol import Filling
from recon.filling.surfaces import SurfaceFilling

__all__ = ["FILLINGS", "BackgroundFilling", "Filling", "SurfaceFilling"]

FILLINGS: dict[str, type[Filling]] = {
    "background": BackgroundFilling,
    "surfaces": SurfaceFilling,
}
