"""The peak is that of the step, not that of the whole process."""

import sys

import numpy as np
import pytest

from recon.evaluation.memory import forget_peak, peak_mb

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")


def test_a_large_array_counts_only_until_it_is_forgotten():
    forget_peak()
    before = peak_mb()

    held = np.ones(50_000_000)  # 400 MB
    during = peak_mb()
    del held
    forget_peak()
    after = peak_mb()

    assert during - before == pytest.approx(400, abs=20)
    assert after - before < 20
