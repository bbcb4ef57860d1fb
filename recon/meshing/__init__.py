"""From a disparity map to a textured triangle mesh that never bridges a depth edge."""

from recon.meshing.grid import grid_faces
from recon.meshing.meshing import Meshing
from recon.meshing.pieces import components
from recon.meshing.watertight import Watertight

__all__ = ["Meshing", "Watertight", "components", "grid_faces"]
