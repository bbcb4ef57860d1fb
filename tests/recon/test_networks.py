"""The feature network, and the files that hold its weights."""

import json

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save

from recon.networks import (
    Architecture,
    FeatureNetwork,
    load_features,
    save_features,
    shipped_weights,
)

SMALL = Architecture(channels=(6, 8, 8), depth=2, features=8)
PLAIN = Architecture(channels=(6,), depth=3, features=8)
LOOSE = {"rtol": 1e-4, "atol": 1e-5}  # convolutions choose their algorithm by size


def network_of(architecture, *, normalised=False):
    with torch.random.fork_rng():
        torch.manual_seed(5)
        return FeatureNetwork(architecture, normalised=normalised).eval()


@pytest.fixture
def image(generator):
    return torch.rand(1, 3, 61, 47, generator=generator)


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "some.safetensors"
    save_features(path, network_of(SMALL), about={"command": "by hand"})
    return path


class TestFeatures:
    @pytest.mark.parametrize("size", [(1, 1), (2, 3), (7, 16), (33, 20)])
    @pytest.mark.parametrize("architecture", [SMALL, PLAIN])
    def test_images_of_any_size_get_a_unit_vector_for_each_pixel(
        self, architecture, size, generator, assert_close
    ):
        network = network_of(architecture)

        features = network(torch.rand(2, 3, *size, generator=generator))

        assert features.shape == (2, 8, *size)
        assert_close(features.norm(dim=1), torch.ones(2, *size))

    def test_folding_the_normalisation_changes_nothing(self, image, assert_close):
        network = network_of(SMALL, normalised=True).train()
        for _ in range(3):
            network(torch.cat([image, 1 - image]))  # so that the statistics are not the first ones
        network.eval()

        assert_close(network.fused()(image), network(image), **LOOSE)
        assert not [m for m in network.fused().modules() if isinstance(m, torch.nn.BatchNorm2d)]

    def test_folding_leaves_the_network_in_training(self, image):
        network = network_of(SMALL, normalised=True).train()
        before = {name: value.clone() for name, value in network.state_dict().items()}

        network.fused()

        assert network.training
        assert all(torch.equal(before[n], value) for n, value in network.state_dict().items())

    @pytest.mark.parametrize("architecture", [SMALL, PLAIN])
    def test_a_crop_with_its_margin_has_the_features_of_the_whole(
        self, architecture, generator, assert_close
    ):
        network = network_of(architecture)
        margin, stride = network.margin_px, network.stride_px
        image = torch.rand(1, 3, 3 * margin + 40, 24, generator=generator)
        whole = network(image)
        assert margin % stride == 0

        for first in (stride, 3 * stride):
            stop = first + 2 * margin + 11
            crop = network(image[:, :, first:stop])
            inner = crop[:, :, margin:-margin]
            assert_close(inner, whole[:, :, first + margin : stop - margin], **LOOSE)

    def test_the_margin_is_not_much_larger_than_the_reach(self, generator):
        network = network_of(SMALL)
        row = 2 * network.margin_px
        image = torch.rand(1, 3, 4 * network.margin_px, 9, generator=generator, requires_grad=True)

        network(image)[0, 0, row].sum().backward()

        reached = image.grad.abs().sum(dim=(0, 1, 3)).nonzero()[:, 0]
        reach = max(row - int(reached.min()), int(reached.max()) - row)
        assert reach <= network.margin_px <= 1.6 * reach

    def test_without_pooling_there_is_no_grid(self):
        assert network_of(PLAIN).stride_px == 1
        assert network_of(SMALL).stride_px == 4


class TestWeights:
    def test_what_was_saved_is_loaded(self, weights, image, assert_close):
        network = load_features(str(weights))

        assert network.architecture == SMALL
        assert not network.training
        assert not [p for p in network.parameters() if p.requires_grad]
        assert_close(network(image), network_of(SMALL)(image), **LOOSE)

    def test_the_header_says_where_they_came_from(self, weights):
        with safe_open(weights, framework="pt") as file:
            header = file.metadata()

        assert header["command"] == "by hand"
        assert json.loads(header["network"]) == {"channels": [6, 8, 8], "depth": 2, "features": 8}

    def test_nothing_but_the_file_is_left(self, weights):
        assert list(weights.parent.iterdir()) == [weights]

    def test_other_people_may_read_them(self, weights):
        other = weights.parent / "other"
        other.write_text("")

        assert weights.stat().st_mode == other.stat().st_mode

    @pytest.mark.parametrize("name", shipped_weights())
    def test_weights_that_ship_give_unit_vectors(self, name, image, assert_close):
        features = load_features(name)(image)

        assert_close(features.norm(dim=1), torch.ones(1, *image.shape[2:]))

    def test_an_unknown_name_is_refused_with_those_that_ship(self):
        with pytest.raises(ValueError, match=r"no weights called 'fats' and no such file; .*fast"):
            load_features("fats")

    @pytest.mark.parametrize("name", ["", "."])
    def test_a_folder_is_no_file(self, name):
        with pytest.raises(ValueError, match="no weights called"):
            load_features(name)

    @pytest.mark.parametrize(
        "damage",
        [
            lambda contents: b"",
            lambda contents: contents[:20],
            lambda contents: contents[:-100],
            lambda contents: b"\xff" * 200,
            lambda contents: b"PK\x03\x04 a zip, or a pickle of torch",
            lambda contents: save({"a": torch.zeros(2)}),
            lambda contents: save({"a": torch.zeros(2)}, metadata={"network": "[]"}),
            lambda contents: save({"a": torch.zeros(2)}, metadata={"network": "not JSON"}),
            lambda contents: save({"a": torch.zeros(2)}, metadata={"network": '{"channels": [8]}'}),
            lambda contents: contents.replace(b"mix.bias", b"mix.byas"),
        ],
        ids=[
            "empty",
            "short",
            "truncated",
            "noise",
            "zip",
            "foreign",
            "list",
            "text",
            "other",
            "renamed",
        ],
    )
    def test_a_damaged_or_foreign_file_is_refused_by_name(self, weights, damage):
        weights.write_bytes(damage(weights.read_bytes()))

        with pytest.raises(ValueError, match=r"some\.safetensors does not hold the weights of a"):
            load_features(str(weights))
