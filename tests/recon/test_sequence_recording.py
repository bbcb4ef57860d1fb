"""The recording of a sequence: what is in it, and that a person who opens it sees it."""

from types import SimpleNamespace

import numpy as np
import pytest
from rerun.chunk import RrdReader

from calib import Pose, RectifiedGeometry
from recon.fusion import DepthView, FusedSurface, stereo_noise
from recon.viewer.sequence import SequenceObserver
from recon.viewer.thinning import clustered_surface

SIZE, FOCAL, BASELINE = (64, 40), 50.0, 0.2
COUNT = 20


def sheet(rows, columns, side_m=0.1, depth_m=6.0):
    """A wavy sheet of 2 (rows - 1) (columns - 1) faces across the view."""
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    x, y = side_m * (x - columns / 2), side_m * (y - rows / 2)
    vertices = np.stack([x, y, depth_m + 0.3 * np.sin(x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    upper = np.stack([corner, corner + columns, corner + columns + 1], axis=1)
    lower = np.stack([corner, corner + columns + 1, corner + 1], axis=1)
    count = len(vertices)
    return FusedSurface(
        vertices.astype(np.float32),
        np.concatenate([upper, lower]).astype(np.int32),
        np.tile(np.float32([0, 0, -1]), (count, 1)),
        np.full((count, 3), 90, np.uint8),
        *(np.ones(count, np.float32) for _ in range(3)),
    )


SURFACE = sheet(60, 90)


def frames(turned=None):
    """What fusing tells of a camera that drives on, in a world that is turned to it."""
    turned = turned or Pose.identity()
    geometry = RectifiedGeometry(SIZE, FOCAL, (32, 20), (32, 20), BASELINE)
    K = np.array([[FOCAL, 0, 32], [0, FOCAL, 20], [0, 0, 1]])
    for number in range(COUNT):
        pose = turned @ Pose(np.eye(3), np.array([0.0, 0.0, 0.1 * number]))
        depth = np.full(SIZE[::-1], 6 - 0.1 * number, np.float32)
        depth[:, :4] = np.nan
        image = np.full((*depth.shape, 3), 128, np.uint8)
        view = DepthView(depth, np.ones_like(depth), image, K, stereo_noise(geometry, 0.5), pose)
        part = SURFACE.vertices[: 50 * (number + 1)]
        volume = SimpleNamespace(
            points=lambda part=part: (turned.apply(part), SURFACE.colours[: len(part)]),
            settings=SimpleNamespace(voxel_m=0.1),
        )
        yield SimpleNamespace(
            frame=SimpleNamespace(view=view, name=f"{number:06}"),
            number=number,
            count=COUNT,
            volume=volume,
        )


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "a.rrd"
    return recorded(path)


def recorded(path, turned=None):
    turned = turned or Pose.identity()
    with SequenceObserver(path) as observe:
        for frame in frames(turned):
            observe(f"frames/{frame.frame.name}", frame)
        observe("surface", SURFACE.moved(turned.apply(SURFACE.vertices), SURFACE.normals))
        observe("run", {"in short": "a sheet of 20 frames", "frames": COUNT})
    return path


def steps_of(recording, path):
    """The frames at which something was drawn, None where it is there at all times."""
    chunks = RrdReader(recording).store().stream().to_chunks()
    batches = [chunk.to_record_batch() for chunk in chunks if chunk.entity_path == path]
    steps = [
        batch.column("frame").to_pylist() if "frame" in batch.schema.names else [None]
        for batch in batches
    ]
    return [step for one in steps for step in one]


def blueprint_of(recording, column):
    """All values of a column of the blueprint."""
    reader = RrdReader(recording)
    chunks = reader.store(store=reader.blueprints()[0]).stream().to_chunks()
    batches = [chunk.to_record_batch() for chunk in chunks]
    rows = [
        row
        for batch in batches
        for name in batch.schema.names
        if name.endswith(column)
        for row in batch.column(name).to_pylist()
    ]
    return [value for row in rows for value in row or []]


def test_the_camera_moves_and_the_model_grows(recording):
    model = steps_of(recording, "/world/model")

    assert set(steps_of(recording, "/world/camera")) == set(range(COUNT))
    assert sorted(steps_of(recording, "/world/path")) == list(range(COUNT))
    assert sorted(model) == [*range(0, COUNT - 1, 2), COUNT - 1]


def test_the_mesh_and_the_summary_are_there_at_all_times(recording):
    assert set(steps_of(recording, "/world/mesh")) == {None}
    assert set(steps_of(recording, "/summary")) == {None}


def test_it_opens_on_the_frames_and_plays_them_in_seconds_not_in_a_blink(recording):
    assert blueprint_of(recording, "TimePanelBlueprint:timeline") == ["frame"]
    (fps,) = blueprint_of(recording, "TimePanelBlueprint:fps")
    assert 5 <= COUNT / fps <= 20
    names = blueprint_of(recording, "ViewBlueprint:display_name")
    assert set(names) == {"growing model", "mesh", "frame", "photograph", "depth", "summary"}


@pytest.mark.parametrize(
    "turned",
    [Pose.identity(), Pose.from_values(np.array([0.4, 2.0, -0.3, 50.0, 7.0, -3.0]))],
    ids=["in the frame of the first camera", "in a world turned otherwise"],
)
def test_the_eye_sees_the_model_and_the_way_large_and_upright(tmp_path, turned):
    recording = recorded(tmp_path / "a.rrd", turned)

    names = ("position", "look_target", "eye_up")
    eye, target, up = (blueprint_of(recording, f"EyeControls3D:{name}")[0] for name in names)
    ahead = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    across = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    axes = np.stack([across, np.cross(ahead, across), ahead])
    places = turned.apply(SURFACE.vertices.astype(np.float64))
    way = turned.apply(np.array([[0.0, 0.0, 0.1 * number] for number in range(COUNT)]))
    half = np.tan(np.radians(55 / 2))
    (x, y), (u, v) = (seen[:2] / (half * seen[2]) for seen in (axes @ (p - eye).T
                                                               for p in (places, way)))  # fmt: skip

    assert np.mean((np.abs(x) <= 1) & (np.abs(y) <= 1)) > 0.95
    assert max(np.abs(u).max(), np.abs(v).max()) <= 1 + 1e-6
    assert max(np.ptp(x), np.ptp(y)) > 1.6  # of 2, the whole view
    np.testing.assert_allclose(turned.R.T @ up, [0, -1, 0], atol=1e-6)


def test_a_run_that_fails_leaves_no_recording(tmp_path):
    def fail():
        with SequenceObserver(tmp_path / "a.rrd") as observe:
            observe("frames/0", next(frames()))
            raise RuntimeError("no surface")

    with pytest.raises(RuntimeError, match="no surface"):
        fail()

    assert not list(tmp_path.iterdir())


def test_a_run_that_sees_nothing_leaves_a_recording_that_opens(tmp_path):
    with SequenceObserver(tmp_path / "a.rrd") as observe:
        observe("run", {"frames": 0})

    assert len(RrdReader(tmp_path / "a.rrd").blueprints()) == 1


class TestClusteredSurface:
    def test_has_few_enough_faces_and_not_far_fewer(self):
        coarser = clustered_surface(SURFACE, 1000)

        assert 300 < len(coarser.faces) <= 1000
        assert len(coarser.vertices) == len(coarser.colours) == len(coarser.normals)

    def test_lies_where_the_surface_lies(self):
        coarser = clustered_surface(SURFACE, 1000)

        x, _, z = coarser.vertices.T
        np.testing.assert_allclose(z, 6 + 0.3 * np.sin(x), atol=0.05)
        np.testing.assert_allclose(coarser.normals, np.tile([0, 0, -1], (len(x), 1)), atol=1e-6)
        assert (coarser.colours == 90).all()
        a, b, c = (coarser.vertices[coarser.faces[:, corner]] for corner in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        assert areas.min() > 0
        whole = SURFACE.vertices[SURFACE.faces]
        true = np.linalg.norm(
            np.cross(whole[:, 1] - whole[:, 0], whole[:, 2] - whole[:, 0]), axis=1
        )
        assert areas.sum() == pytest.approx(true.sum() / 2, rel=0.2)

    def test_is_the_surface_itself_if_that_is_small(self):
        assert clustered_surface(SURFACE, len(SURFACE.faces)) is SURFACE
