"""What a confidence says of an error: falls with it, comes true, and gets to what depends on it."""

import dataclasses

import numpy as np
import pytest
import torch

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.confidence import EVIDENCE
from recon.disparity_noise import KNOTS, DisparityNoise
from recon.fusion import DepthView, stereo_noise
from recon.meshing import Meshing
from recon.settings import load_preset, preset_names, spelled_out
from recon.training.confidence import Cases, fitted_noise
from recon.triangulation import Triangulation, depth_map, depth_sigma
from recon.types import DisparityMap, PixelStatus

MATCHED, FILLED, BETWEEN = (
    PixelStatus.MATCHED,
    PixelStatus.FILLED_OCCLUSION,
    PixelStatus.FILLED_MISMATCH,
)
SIGMAS = tuple(32 * 2.0**-n for n in range(len(KNOTS)))
NOISE = DisparityNoise(SIGMAS, tuple(3 * s for s in SIGMAS), tuple(7 * s for s in SIGMAS))


def states(confidence, status=MATCHED):
    return np.full(np.shape(confidence), status, np.uint8)


def a_map(confidence, status=MATCHED, disparity=8.0):
    status = np.broadcast_to(np.uint8(status), confidence.shape).copy()
    present = np.isin(status, PixelStatus.with_disparity())
    values = np.where(present, np.float32(disparity), np.float32(np.nan))
    return DisparityMap(values, status, confidence.astype(np.float32))


class TestNoise:
    def test_at_the_knots_it_is_what_was_told_by_how_the_disparity_came_about(self):
        knots = np.array(KNOTS)

        for status, times in ((MATCHED, 1), (FILLED, 3), (BETWEEN, 7)):
            np.testing.assert_allclose(
                NOISE(knots, states(knots, status)), times * np.array(SIGMAS), rtol=1e-5
            )

    def test_it_never_rises_with_the_confidence_and_stays_beyond_the_knots(self):
        confidence = np.linspace(0, 1, 2001).astype(np.float32)

        sigma = NOISE(confidence, states(confidence))

        assert (np.diff(sigma) <= 0).all()
        assert sigma[0] == SIGMAS[0]
        assert sigma[-1] == pytest.approx(SIGMAS[-1])
        between = (sigma > SIGMAS[5] * 1.01) & (sigma < SIGMAS[4] * 0.99)
        assert between.sum() > 100

    def test_there_is_none_where_there_is_no_disparity(self):
        status = np.array([[MATCHED, PixelStatus.OCCLUDED, PixelStatus.OUTSIDE]], np.uint8)

        sigma = NOISE(np.full((1, 3), 0.9), status)

        np.testing.assert_array_equal(np.isnan(sigma), [[False, True, True]])
        assert sigma.dtype == np.float32

    @pytest.mark.parametrize(
        ("sigmas", "message"),
        [
            (SIGMAS[:-1], r"matched must be 11 positive numbers of pixels.*0\.1, 0\.2"),
            ((*SIGMAS[:-1], 0.0), "positive numbers"),
            ((*SIGMAS[:-1], float("nan")), "positive numbers"),
            (SIGMAS[::-1], "matched must not rise"),
        ],
    )
    def test_rows_that_cannot_be_are_refused(self, sigmas, message):
        with pytest.raises(ValueError, match=message):
            dataclasses.replace(NOISE, matched=sigmas)


class TestFit:
    @pytest.fixture
    def cases(self, generator):
        """Normal errors whose standard deviation is that of `NOISE`, and their confidences."""
        said = torch.rand(200_000, generator=generator)
        status = torch.full((len(said),), int(MATCHED), dtype=torch.uint8)
        status[::2] = int(FILLED)
        sigma = torch.from_numpy(NOISE(said.numpy(), status.numpy()))
        error_px = (torch.randn(len(said), generator=generator) * sigma).abs()
        return Cases(torch.zeros(len(said), len(EVIDENCE)), status, error_px), said

    def test_two_thirds_of_the_errors_are_within_what_is_stated_at_every_confidence(self, cases):
        drawn, said = cases
        found = fitted_noise(drawn, said)

        stated = found(said.numpy(), drawn.status.numpy())
        within = drawn.error_px.numpy() <= stated
        for low in np.arange(0.05, 0.95, 0.1):
            for status in (MATCHED, FILLED):
                here = (said >= low) & (said < low + 0.1) & (drawn.status == int(status))
                assert within[here.numpy()].mean() == pytest.approx(0.6827, abs=0.04)

    def test_what_nothing_is_known_of_has_the_same_sigma_everywhere(self, cases):
        found = fitted_noise(*cases)

        assert len(set(found.filled_mismatch)) == 1

    def test_errors_that_rise_with_the_confidence_are_averaged(self, generator):
        said = torch.rand(50_000, generator=generator)
        error_px = said.square()
        status = torch.full((len(said),), int(MATCHED), dtype=torch.uint8)

        found = fitted_noise(Cases(torch.zeros(len(said), len(EVIDENCE)), status, error_px), said)

        assert len(set(found.matched)) == 1
        assert 0.05 < found.matched[0] < 0.95


class TestUse:
    GEOMETRY = RectifiedGeometry((40, 30), 100.0, (19.5, 14.5), (19.5, 14.5), 0.1)
    CONFIDENCE = np.linspace(0.01, 0.999, 1200).reshape(30, 40)

    def test_every_point_has_the_error_of_its_own_confidence(self, flat_pair):
        disparity = a_map(self.CONFIDENCE)

        cloud = Triangulation(noise=NOISE)(disparity, flat_pair)

        sigma_px = NOISE(cloud.confidence, cloud.status)
        expected = depth_sigma(cloud.points[:, 2], self.GEOMETRY, sigma_px)
        np.testing.assert_allclose(cloud.depth_sigma_m, expected, rtol=1e-6)
        assert cloud.depth_sigma_m.max() > 500 * cloud.depth_sigma_m.min()

    def test_a_constant_that_is_set_overrides_the_confidence(self):
        disparity = a_map(self.CONFIDENCE)

        stated = Triangulation(disparity_sigma_px=0.3, noise=NOISE).disparity_sigma(disparity)
        unknown = Triangulation().disparity_sigma(disparity)

        np.testing.assert_array_equal(stated, np.float32(0.3))
        np.testing.assert_array_equal(unknown, np.float32(0.5))

    def test_pixels_without_disparity_state_no_error_either_way(self):
        status = np.where(self.CONFIDENCE > 0.5, MATCHED, PixelStatus.OCCLUDED)
        disparity = a_map(self.CONFIDENCE, status)

        for points in (Triangulation(), Triangulation(noise=NOISE)):
            assert (np.isnan(points.disparity_sigma(disparity)) == ~disparity.valid).all()

    def test_a_mesh_keeps_to_what_is_sure_and_gives_way_where_it_is_not(self, flat_pair):
        rough = 8 + np.random.default_rng(0).normal(0, 0.15, (30, 40)).astype(np.float32)
        sure, unsure = np.full((30, 40), 0.995), np.full((30, 40), 0.6)

        def faces(confidence):
            meshing = Meshing(Triangulation(noise=load_preset("fast").triangulation.noise))
            return len(meshing(a_map(confidence, disparity=rough), flat_pair).faces)

        assert faces(unsure) < 0.5 * faces(sure)

    def test_the_error_of_a_view_is_that_of_the_formula_in_every_pixel(self):
        disparity = a_map(self.CONFIDENCE)
        depth = depth_map(disparity, self.GEOMETRY)
        sigma_px = NOISE(disparity.confidence, disparity.status)
        image = np.zeros((30, 40, 3), np.uint8)

        view = DepthView(
            depth, disparity.confidence, image, np.eye(3), stereo_noise(self.GEOMETRY), None,
            sigma_px,
        )  # fmt: skip

        np.testing.assert_allclose(
            view.sigma_m, depth_sigma(depth, self.GEOMETRY, sigma_px), rtol=1e-5
        )
        with pytest.raises(ValueError, match=r"noise_times \(2, 2\)"):
            dataclasses.replace(view, noise_times=np.ones((2, 2)))


class TestPresets:
    def test_what_is_fitted_belongs_to_a_confidence(self):
        fitted = {name for name in preset_names() if load_preset(name).triangulation.noise}

        assert fitted >= {"best", "context", "fast", "sgm"}
        for name in fitted:
            noise = load_preset(name).triangulation.noise
            assert noise.matched[-1] < 0.3 < 1 < noise.matched[0]
            assert load_preset(name).meshing.points.noise == noise

    def test_a_margin_is_no_confidence_so_the_noise_goes_with_it(self):
        assert load_preset("fast", {"confidence": False}).triangulation.noise is None
        assert load_preset("fast", {"disparity_noise": False}).triangulation.noise is None

    @pytest.mark.parametrize("change", [{}, {"disparity_noise": False}, {"confidence": False}])
    def test_a_preset_spelled_out_is_read_as_the_same(self, change):
        preset = load_preset("fast", change)

        assert load_preset("fast", spelled_out(preset)) == preset

    def test_a_mistake_in_the_section_is_named(self):
        with pytest.raises(ValueError, match="disparity_noise matched"):
            load_preset("fast", {"disparity_noise": {"matched": "wide"}})
        with pytest.raises(ValueError, match="unknown setting 'px' in disparity_noise"):
            load_preset("fast", {"disparity_noise": {"px": 1.0}})
        with pytest.raises(ValueError, match="unknown setting 'noise' in triangulation"):
            load_preset("fast", {"triangulation": {"noise": 1.0}})


@pytest.fixture
def flat_pair():
    image = np.zeros((30, 40, 3), np.uint8)
    return RectifiedPair(image, image, TestUse.GEOMETRY)
