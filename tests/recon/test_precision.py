"""In which arithmetic networks compute."""

import pytest
import torch

from recon.matching_cost import LearnedCost
from recon.optimisation import LearnedOptimisation
from recon.precision import _has_bfloat16, in_precision
from recon.settings import load_preset

CPU = torch.device("cpu")


@pytest.fixture
def processor(monkeypatch):
    """Return a function that gives this machine another processor."""

    def become(**capabilities):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities, raising=False)
        _has_bfloat16.cache_clear()

    yield become
    _has_bfloat16.cache_clear()


def kind_of_products(precision):
    with in_precision(precision, CPU):
        return (torch.ones(4, 4) @ torch.ones(4, 4)).dtype


@pytest.mark.parametrize("name", ["avx512_bf16", "amx_bf16", "bf16"])
def test_auto_takes_half_precision_where_the_processor_has_it(processor, name):
    processor(avx2=True, **{name: True})

    assert kind_of_products("auto") == torch.bfloat16
    assert kind_of_products("float32") == torch.float32


def test_auto_takes_full_precision_elsewhere(processor):
    processor(avx2=True, avx512_bf16=False)

    assert kind_of_products("auto") == torch.float32
    assert kind_of_products("bfloat16") == torch.bfloat16


def test_a_torch_that_does_not_know_the_processor_computes_in_full(monkeypatch):
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    _has_bfloat16.cache_clear()

    assert kind_of_products("auto") == torch.float32
    _has_bfloat16.cache_clear()


def test_costs_in_half_precision_are_nearly_those_in_full(generator):
    left, right = torch.rand(2, 24, 40, 3, generator=generator)

    half, full = (
        LearnedCost(precision=precision)(left, right, range(8)).cost
        for precision in ("bfloat16", "float32")
    )

    assert half.dtype == torch.float32
    known = full.isfinite()
    assert torch.equal(half.isfinite(), known)
    apart = (half - full)[known].abs()
    assert 0 < apart.max() < 0.02


@pytest.mark.parametrize("stage", [LearnedCost, LearnedOptimisation])
def test_another_precision_is_refused_with_those_there_are(stage):
    with pytest.raises(ValueError, match="precision must be one of auto, float32, bfloat16, got"):
        stage(precision="float16")


def test_a_preset_can_say_which():
    matcher = load_preset("best", {"matching_cost": {"precision": "float32"}}).matcher

    assert matcher.matching_cost.precision == "float32"
    with pytest.raises(ValueError, match="precision"):
        load_preset("best", {"matching_cost": {"precision": "half"}})
