"""open3d, imported where it is used: it is slow to load and needs libraries of the system."""

from __future__ import annotations

from typing import Any

__all__ = ["loaded_open3d"]


def loaded_open3d() -> Any:  # noqa: ANN401  the library has no types
    """Return open3d.

    Raises:
        ImportError: if it does not load; says which packages of Debian and Ubuntu it needs.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise ImportError(
            f"open3d does not load ({error}); on Debian or Ubuntu: "
            "apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1"
        ) from error
    return open3d
