"""Weights files: safetensors with the settings of the network in their header."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from recon.networks.features import Architecture, FeatureNetwork

__all__ = ["SHIPPED", "load_features", "save_features", "shipped_weights"]

SHIPPED = Path(__file__).parent.parent / "weights"


def shipped_weights() -> list[str]:
    """Return the names of the weights that come with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.safetensors"))


def _find(name: str) -> Path:
    """Return the file of shipped weights, or of a path."""
    path = SHIPPED / f"{name}.safetensors"
    if path.exists():
        return path
    if not Path(name).is_file():
        raise ValueError(
            f"no weights called {name!r} and no such file; shipped are "
            f"{', '.join(shipped_weights())}"
        )
    return Path(name)


def save_features(path: Path, network: FeatureNetwork, *, about: dict[str, str]) -> None:
    """Write a fused network, to a temporary name first.

    Args:
        path: ends in .safetensors.
        network: without batch normalisation, see `FeatureNetwork.fused`.
        about: text for the header: command, commit, scores.
    """
    unfinished = path.with_suffix(".part")
    tensors = {name: value.contiguous() for name, value in network.state_dict().items()}
    header = {"network": json.dumps(asdict(network.architecture)), **about}
    try:
        unfinished.write_bytes(save(tensors, metadata=header))  # save_file lets only us read it
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def load_features(
    name: str, device: str | torch.device = "cpu", *, direct_share: float | None = None
) -> FeatureNetwork:
    """Return a trained feature network, ready to use.

    Args:
        name: of shipped weights, such as "fast", or the path of a .safetensors file.
        device: where it computes.
        direct_share: see `Architecture`; that of the file if not given.

    Raises:
        ValueError: if there is no such file, or it is not the weights of such a network.
    """
    path = _find(name)
    try:
        with safe_open(path, framework="pt") as file:
            settings = dict(json.loads((file.metadata() or {})["network"]))
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  not a dict
        settings = {key: tuple(v) if isinstance(v, list) else v for key, v in settings.items()}
        architecture = Architecture(**settings)
        network = FeatureNetwork(architecture)
        network.load_state_dict(tensors)
    except (SafetensorError, KeyError, ValueError, RuntimeError, TypeError) as error:
        raise ValueError(
            f"{path} does not hold the weights of a feature network "
            f"({' '.join(str(error).split())[:200]}); is the file truncated or of another version?"
        ) from error
    if direct_share is not None:
        network.architecture = replace(architecture, direct_share=direct_share)
    network.requires_grad_(requires_grad=False)
    network = network.eval().to(device)
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]
