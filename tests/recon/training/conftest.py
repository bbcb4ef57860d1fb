"""Settings with which a training takes a moment."""

from dataclasses import replace

import pytest
import torch
from small_trainings import KEPT, PAIRS, SIZE, SMALL, draw_bands

from recon.networks import architecture
from recon.training.pool import fill_pool
from recon.training.settings import FeatureTraining


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """So small a network only makes threads wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr("recon.training.pool.draw", draw_bands)
    variants = {**architecture.VARIANTS, "small": SMALL, "other": replace(SMALL, depth=2)}
    monkeypatch.setattr(architecture, "VARIANTS", variants)


@pytest.fixture
def pool(tmp_path):
    folder = tmp_path / "pool"
    list(fill_pool(folder, range(PAIRS), SIZE, workers=0))
    return folder


@pytest.fixture
def settings(pool, tmp_path):
    return FeatureTraining(
        variant="small",
        out=tmp_path / "out",
        pool=pool,
        pairs=PAIRS,
        validation_pairs=KEPT,
        uses=2,
        window=3,
        workers=0,
        steps=6,
        batch=2,
        crop_rows=32,
        edges_from=3,
        warm_up=2,
        size=SIZE,
        save_every=2,
    )
