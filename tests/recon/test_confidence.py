"""What speaks for a disparity, and whether its probability means what it says."""

import math

import numpy as np
import pytest
import torch

from recon.confidence import EVIDENCE, Confidence, evidence
from recon.evaluation.metrics import reliability_curve
from recon.matcher import Matcher
from recon.settings import load_preset, spelled_out
from recon.training.confidence import Cases, fitted
from recon.types import DisparityMap, PixelStatus

SIZE = (15, 40)
MATCHED, FILLED = int(PixelStatus.MATCHED), int(PixelStatus.FILLED_MISMATCH)
NOTHING = (0.0,) * len(EVIDENCE)


def flat_map(value, status=MATCHED, margin=0.5):
    return DisparityMap(
        torch.full(SIZE, float(value)),
        torch.full(SIZE, status, dtype=torch.uint8),
        torch.full(SIZE, margin),
    )


def spoken(disparity, of_left=None, of_right=None, guide=None):
    found = evidence(
        disparity,
        disparity if of_left is None else of_left,
        flat_map(4, margin=0.2) if of_right is None else of_right,
        torch.zeros(*SIZE, 3) if guide is None else guide,
    )
    return dict(zip(EVIDENCE, found.unbind(-1), strict=True))


class TestEvidence:
    def test_margins_are_those_of_the_pixel_and_of_its_partner(self):
        found = spoken(flat_map(4))

        assert found["margin"][7, 20].exp() == pytest.approx(0.501, rel=1e-4)
        assert found["partner"][7, 20].exp() == pytest.approx(0.201, rel=1e-4)
        assert found["partner"][7, 3].exp() == pytest.approx(0.001, rel=1e-4)  # outside
        plain = (found["plain_margin"], found["plain_partner"])
        assert [float(each[7, 20]) for each in plain] == pytest.approx([0.5, 0.2])
        assert plain[1][7, 3] == 0

    @pytest.mark.parametrize(("theirs", "difference"), [(4.0, 0.0), (5.5, 1.5), (30.0, 3.0)])
    def test_the_partner_may_say_otherwise(self, theirs, difference):
        assert spoken(flat_map(4), of_right=flat_map(theirs))["difference"][7, 20] == difference

    def test_a_pixel_without_partner_differs_most(self):
        assert spoken(flat_map(4))["difference"][7, 3] == 3

    def test_agreement_is_the_share_of_24_pixels_around(self):
        disparity = flat_map(4)
        disparity.values[4, 14:27] = 7  # the five places of one row of three px above
        disparity.values[7, 17] = 5.01  # and one on the left

        found = spoken(disparity, of_left=flat_map(4))

        assert found["agreement"][7, 20] == pytest.approx(18 / 24)

    def test_what_is_filled_around_is_not_matched(self):
        disparity = flat_map(4)
        disparity.status[10, 14:27] = FILLED

        found = spoken(disparity)

        assert found["matched"][7, 20] == pytest.approx(19 / 24)
        assert found["agreement"][7, 20] == 1

    def test_texture_is_how_much_luminance_varies(self):
        guide = torch.zeros(*SIZE, 3)
        guide[:, 20:] = 0.5

        found = spoken(flat_map(4), guide=guide)["texture"].exp() - 1 / 255

        assert found[7, 5] == pytest.approx(0, abs=1e-4)
        assert found[7, 20] == pytest.approx(0.5 * math.sqrt(0.4 * 0.6), rel=1e-3)  # 2 of 5 dark

    def test_near_certainty_is_told_from_certainty(self):
        half, sure = (spoken(flat_map(4, margin=margin))["certainty"][7, 20] for margin in (0.5, 1))

        assert half == pytest.approx(-math.log(0.501), rel=1e-4)
        assert sure == pytest.approx(-math.log(0.001), rel=1e-4)


class TestConfidence:
    def test_each_state_has_weights_of_its_own(self):
        disparity = flat_map(4)
        disparity.status[:, 20:] = FILLED
        disparity.status[:, 30:] = int(PixelStatus.OUTSIDE)
        disparity.values[:, 30:] = torch.nan
        matched, mismatch = (2.0, *NOTHING[1:]), (-1.0, *NOTHING[1:])

        found = Confidence(matched, NOTHING, mismatch)(
            disparity, disparity, disparity, guide=torch.zeros(*SIZE, 3)
        )

        assert found.confidence[0, 0] == pytest.approx(1 / (1 + math.exp(-2)))
        assert found.confidence[0, 25] == pytest.approx(1 / (1 + math.exp(1)))
        assert found.confidence[0, 35] == 0
        assert torch.equal(found.values.nan_to_num(), disparity.values.nan_to_num())

    @pytest.mark.parametrize("weights", [(1.0,), (*NOTHING[1:], math.nan)])
    def test_weights_that_cannot_be_are_refused(self, weights):
        with pytest.raises(ValueError, match=r"filled_mismatch must be 10 finite weights \(always"):
            Confidence(NOTHING, NOTHING, weights)

    def test_a_preset_holds_weights_or_leaves_them_out(self):
        weights = [0.5, *NOTHING[1:]]
        table = {"matched": weights, "filled_occlusion": weights, "filled_mismatch": weights}

        preset = load_preset("census", {"confidence": table})

        assert preset.matcher.confidence == Confidence(*(tuple(weights),) * 3)
        assert spelled_out(preset)["confidence"] == table
        off = load_preset("census", {"confidence": False})
        assert off.matcher.confidence is None
        assert spelled_out(off)["confidence"] is False
        assert isinstance(off.matcher, Matcher)


class TestFit:
    @pytest.fixture
    def cases(self, generator):
        """Cases drawn from known probabilities."""
        spoken = torch.randn(40_000, len(EVIDENCE), generator=generator)
        spoken[:, 0] = 1
        weights = torch.tensor([0.5, 1.0, 0.0, -2.0, 0.3, 0.0, 0.1, 0.4, 0.2, -0.6])
        right = torch.rand(len(spoken), generator=generator) < torch.sigmoid(spoken @ weights)
        error_px = torch.where(right, 0.5, 2.0)
        return Cases(spoken, torch.full((len(spoken),), MATCHED), error_px)

    def test_the_weights_that_cases_were_drawn_with_are_found(self, cases):
        found = fitted(cases)

        expected = (0.5, 1.0, 0.0, -2.0, 0.3, 0.0, 0.1, 0.4, 0.2, -0.6)
        assert found.matched == pytest.approx(expected, abs=0.08)
        assert found.filled_mismatch == NOTHING  # nothing was said of those

    def test_what_is_said_comes_true(self, cases):
        said = fitted(cases).probability(cases.evidence, cases.status)

        assert len(said) == 40_000
        assert self.largest_gap(said, cases.right) < 0.04

    def test_too_much_said_shows(self, cases):
        said = torch.full((len(cases.right),), 0.99)

        assert self.largest_gap(said, cases.right) > 0.2

    def largest_gap(self, said, right):
        everything = np.ones(len(said), bool)
        curve = reliability_curve(right.numpy(), said.numpy(), everything)
        pixels = np.maximum(curve["pixels"], 1)
        return np.abs((np.array(curve["said"]) - curve["right"]) / pixels).max()
