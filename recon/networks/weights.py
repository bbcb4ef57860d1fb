"""Weights files: safetensors with the settings of the network in their header."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import nn

from recon.networks.features import Architecture, FeatureNetwork
from recon.networks.regulariser import Regulariser, RegulariserShape

__all__ = [
    "SHIPPED",
    "load_features",
    "load_regulariser",
    "save_features",
    "save_regulariser",
    "shipped_weights",
    "stored_regulariser",
]

SHIPPED = Path(__file__).parent.parent / "weights"
REGULARISER = "regulariser"
NetworkT = TypeVar("NetworkT", bound=nn.Module)


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
    _save(path, network, asdict(network.architecture), about)


def save_regulariser(path: Path, network: Regulariser, *, about: dict[str, str]) -> None:
    """Write a regulariser, to a temporary name first; see `save_features`."""
    _save(path, network, {REGULARISER: asdict(network.shape)}, about)


def _save(path: Path, network: nn.Module, shape: dict[str, Any], about: dict[str, str]) -> None:
    unfinished = path.with_suffix(".part")
    tensors = {name: value.contiguous() for name, value in network.state_dict().items()}
    header = {"network": json.dumps(shape), **about}
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
    network = _load(name, "feature network", lambda shape: FeatureNetwork(Architecture(**shape)))
    if direct_share is not None:
        network.architecture = replace(network.architecture, direct_share=direct_share)
    network = network.to(device)
    return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]


def load_regulariser(name: str, device: str | torch.device = "cpu") -> Regulariser:
    """Return a trained regulariser, ready to use; see `load_features`.

    Raises:
        ValueError: if there is no such file, or it is not the weights of a regulariser.
    """
    return stored_regulariser(name).fused().to(device).laid_out()


def stored_regulariser(name: str) -> Regulariser:
    """Return a regulariser as it was trained, to train it further; see `load_regulariser`."""
    return _load(
        name,
        "regulariser",
        lambda shape: Regulariser(RegulariserShape(**_as_tuples(shape[REGULARISER]))),
    )


def _as_tuples(shape: dict[str, Any]) -> dict[str, Any]:
    """Return settings as they were before they were JSON, which has no tuples."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in shape.items()}


def _load(name: str, kind: str, made: Callable[[dict[str, Any]], NetworkT]) -> NetworkT:
    """Return the network of a file, which is not to be trained further."""
    path = _find(name)
    try:
        with safe_open(path, framework="pt") as file:
            shape = _as_tuples(json.loads((file.metadata() or {})["network"]))
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  not a dict
        network = made(shape)
        network.load_state_dict(tensors)
    except (
        SafetensorError,
        AttributeError,
        KeyError,
        ValueError,
        RuntimeError,
        TypeError,
    ) as error:
        raise ValueError(
            f"{path} does not hold the weights of a {kind} "
            f"({' '.join(str(error).split())[:200]}); is the file truncated or of another version?"
        ) from error
    network.requires_grad_(requires_grad=False)
    return network.eval()
