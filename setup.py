"""Everything is in pyproject.toml but this: data/ is installed as recon.sample."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["calib*", "recon*"]), "recon.sample"],
    package_dir={"recon.sample": "data"},
    package_data={
        "calib": ["py.typed"],
        "recon": [
            *("py.typed", "presets/*.toml", "weights/*"),
            *("evaluation/report/*.j2", "calibration/*.j2", "comparison/*.j2"),
        ],
        "recon.sample": ["*/*", "README.md"],
    },
)
