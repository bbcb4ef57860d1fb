"""The names that other people's programs may use."""

import importlib
import inspect

import pytest
from test_architecture import FILES

PUBLIC = {
    "calib": """CalibrationRecord Camera CameraModel Image LengthUnit Matches Pose RectifiedGeometry
        RectifiedPair Rectifier RowCorrection StereoCalibration StereoPair VerticalResidual
        corrected_pair corrected_rig estimate_row_correction match_views read_calibration
        vertical_residual write_calibration""",
    "calib.trajectories": """TRAJECTORY_READERS TRAJECTORY_WRITERS Trajectory TrajectoryReader
        read_trajectory write_trajectory""",
    "calib.formats": """READERS WRITERS CalibrationFile CalibrationRecord LengthUnit Reader Writer
        check_writable read_calibration write_calibration""",
    "recon": """Preset Reconstruction check_rectification load_preset read_pair reconstruct
        rectify_and_check""",
    "recon.filling": "FILLINGS BackgroundFilling Filling SurfaceFilling",
    "recon.aggregation": """AGGREGATIONS Aggregation BilateralAggregation BoxAggregation
        NoAggregation""",
    "recon.files": """CLOUD_FORMATS atomic image_size read_cloud read_depth read_image
        read_image_pair read_pfm read_ply read_side_by_side write_cloud write_depth_png
        write_disparity_png write_glb write_image write_json write_pfm write_ply
        write_status_png""",
    "recon.fusion": """DepthNoise DepthView FusedSurface Fusion KINECT_NOISE Volume
        stereo_noise""",
    "recon.sequence": """DepthSource FrameOnDisk FusedFrame FusedSequence RgbdSource
        SequenceSettings StereoSource find_depth_frames find_pairs fuse_sequence poses_of_frames""",
    "recon.matching_cost": """MATCHING_COSTS AbsoluteDifference AdCensus Census LearnedCost
        MatchingCost NormalisedCrossCorrelation SoftCensus SumOfAbsoluteDifferences
        SumOfSquaredDifferences VectorCost ZeroMeanNormalisedCrossCorrelation""",
    "recon.networks": """Architecture FeatureNetwork LEAST_LENGTH Regulariser RegulariserShape
        STEP_REACH_PX load_features load_regulariser saturated_steps save_features save_regulariser
        shipped_weights stored_regulariser""",
    "recon.optimisation": """LearnedOptimisation OPTIMISATIONS Optimisation SemiGlobal
        WinnerTakesAll""",
    "recon.refinement": "REFINEMENTS DomainTransform LocalPlanes Median Refinement WeightedMedian",
    "recon.viewer": "Drawing Limits Page RerunObserver archetypes open_recording serve_recording",
}


@pytest.mark.parametrize("name", PUBLIC)
def test_a_package_offers_these_names_and_no_others(name):
    assert sorted(importlib.import_module(name).__all__) == sorted(PUBLIC[name].split())


@pytest.mark.parametrize("name", FILES)
def test_every_listed_name_exists_and_is_explained(name):
    module = importlib.import_module(name)

    for listed in getattr(module, "__all__", ()):
        value = getattr(module, listed)
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__doc__, f"{name}.{listed} has no docstring"


def test_a_name_that_the_package_lacks_is_an_attribute_error():
    recon = importlib.import_module("recon")

    with pytest.raises(AttributeError, match="module 'recon' has no attribute 'reconstruction'"):
        recon.reconstruction  # noqa: B018
