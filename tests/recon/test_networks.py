"""The feature network, and the files that hold its weights."""

import itertools
import json
from dataclasses import replace

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save
from torch.utils.flop_counter import FlopCounterMode

from recon.networks import (
    Architecture,
    FeatureNetwork,
    load_features,
    save_features,
    shipped_weights,
)
from recon.networks.architecture import VARIANTS, architecture_named

SMALL = Architecture(channels=(6, 8, 8), depth=2, features=8)
PLAIN = Architecture(channels=(6,), depth=3, features=8)
DILATED = Architecture(channels=(6,), depth=3, features=8, dilations=(1, 2, 5))
BOTH = Architecture(channels=(6, 8), depth=2, features=8, dilations=(1, 3))
DIRECT = Architecture(channels=(6, 8), depth=1, features=32, direct=True)
SHARED = replace(DIRECT, direct_share=0.3)
SHAPES = (SMALL, PLAIN, DILATED, BOTH, DIRECT, SHARED)
LOOSE = {"rtol": 1e-4, "atol": 1e-5}  # convolutions choose their algorithm by size


def network_of(architecture, *, normalised=False):
    with torch.random.fork_rng():
        torch.manual_seed(5)
        return FeatureNetwork(architecture, normalised=normalised).eval()


def thinned(architecture):
    """Return a network with one map where there are many, and no path of weights that cancels."""
    features = 2 + architecture.features - architecture.learned
    thin = replace(architecture, channels=(1,) * len(architecture.channels), features=features)
    network = network_of(thin)
    for value in network.parameters():
        torch.nn.init.uniform_(value, 0.1, 1.0, generator=torch.Generator().manual_seed(6))
    return network


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
    @pytest.mark.parametrize("architecture", SHAPES)
    def test_images_of_any_size_get_a_vector_for_each_pixel(
        self, architecture, size, generator, assert_close
    ):
        network = network_of(architecture)

        features = network(torch.rand(2, 3, *size, generator=generator))

        assert features.shape == (2, architecture.features, *size)
        lengths = features.norm(dim=1)
        if size == (1, 1) and architecture.direct_share:
            assert ((lengths > 0) & (lengths < 1)).all()  # no neighbour to step to
        else:
            assert_close(lengths, torch.ones(2, *size))

    def test_a_direct_network_that_learned_nothing_is_a_soft_census(self, image):
        """Steps of grey count half at the faint step, whatever the network adds is 0."""
        network = network_of(DIRECT)
        torch.nn.init.zeros_(network.last.weight)
        torch.nn.init.zeros_(network.last.bias)
        grey = image.mean(1)[0]
        step = grey[30, 21] - grey[30, 20]

        features = network(image)[0].detach()

        ratio = features[12, 30, 20] / features[11, 30, 20]
        other = grey[30, 19] - grey[30, 20]
        assert ratio == pytest.approx(
            float(step / (step.abs() + 0.015) * (other.abs() + 0.015) / other), rel=1e-4
        )
        assert (features[24:] == 0).all()
        brighter = network(0.5 * image + 0.5)[0].detach()
        assert (brighter[:24].sign() == features[:24].sign()).all()

    def test_steps_with_a_share_keep_it_and_the_rest_is_learned(self, image, assert_close):
        features = network_of(SHARED)(image)
        direct = network_of(DIRECT)(image)

        steps, learned = features[:, :24], features[:, 24:]
        assert_close(steps.square().sum(1), torch.full_like(image[:, 0], 0.3))
        assert_close(
            torch.nn.functional.normalize(steps, dim=1),
            torch.nn.functional.normalize(direct[:, :24], dim=1),
        )
        assert_close(learned.square().sum(1), torch.full_like(image[:, 0], 0.7))

    def test_a_flat_image_has_no_steps_to_share(self):
        features = network_of(SHARED)(torch.full((1, 3, 9, 9), 0.5))

        assert (features[:, :24] == 0).all()

    @pytest.mark.parametrize("architecture", SHAPES)
    def test_folding_the_normalisation_changes_nothing(self, architecture, image, assert_close):
        network = network_of(architecture, normalised=True).train()
        for _ in range(3):
            network(torch.cat([image, 1 - image]))  # so that the statistics are not the first ones
        network.eval()

        assert_close(network.fused()(image), network(image), **LOOSE)
        assert not [m for m in network.fused().modules() if isinstance(m, torch.nn.BatchNorm2d)]

    def test_folding_stays_on_the_device(self):
        network = network_of(SMALL, normalised=True).to("meta")

        assert {value.device.type for value in network.fused().parameters()} == {"meta"}

    def test_folding_leaves_the_network_in_training(self, image):
        network = network_of(SMALL, normalised=True).train()
        before = {name: value.clone() for name, value in network.state_dict().items()}

        network.fused()

        assert network.training
        assert all(torch.equal(before[n], value) for n, value in network.state_dict().items())

    @pytest.mark.parametrize("architecture", SHAPES)
    def test_a_crop_with_its_margin_has_the_features_of_the_whole(
        self, architecture, generator, assert_close
    ):
        network = network_of(architecture)
        margin, stride = network.margin_px, network.stride_px
        image = torch.rand(1, 3, 3 * margin + 40, 24, generator=generator)
        whole = network(image)

        for first in (stride, 3 * stride):
            stop = first + 2 * margin + 11
            crop = network(image[:, :, first:stop])
            inner = crop[:, :, margin:-margin]
            assert_close(inner, whole[:, :, first + margin : stop - margin], **LOOSE)

    @pytest.mark.parametrize("architecture", [*SHAPES, *VARIANTS.values()], ids=str)
    def test_a_vector_depends_on_pixels_as_far_as_the_margin_and_no_further(self, architecture):
        """Under pooling the furthest of all places on the grid counts."""
        network = thinned(architecture)
        margin, stride = network.margin_px, network.stride_px
        middle = -(-(margin + 1) // stride) * stride
        size = 2 * middle + stride
        reaches = []

        for step, axis in itertools.product(range(stride), (2, 3)):
            shape = [1, 3, 2 * stride, 2 * stride]
            shape[axis] = size
            image = torch.full(shape, 0.5, requires_grad=True)
            network(image).select(axis, middle + step).sum().backward()
            seen = image.grad.abs().sum(dim=(0, 1, 5 - axis)).nonzero()
            reaches += [middle + step - int(seen.min()), int(seen.max()) - middle - step]

        assert max(reaches) == margin

    def test_the_margins_of_networks_counted_by_hand(self):
        assert Architecture().margin_px == 2 + 4 + 1
        assert PLAIN.margin_px == 2 + 3 + 1
        assert DILATED.margin_px == 2 + (1 + 2 + 5) + 1

    def test_without_pooling_there_is_no_grid(self):
        assert network_of(PLAIN).stride_px == 1
        assert network_of(SMALL).stride_px == 4

    def test_under_autocast_vectors_keep_length_one(self, image, assert_close):
        with torch.autocast("cpu", torch.bfloat16):
            features = network_of(SMALL)(image)

        assert features.dtype == torch.float32
        assert_close(features.norm(dim=1), torch.ones(1, 61, 47))


class TestGrowth:
    """A network that begins as one with fewer branches."""

    @pytest.fixture
    def image(self, image):
        return image[..., :60, :44]  # which the pooling grid fits

    @pytest.fixture
    def narrow(self):
        return network_of(replace(SMALL, channels=SMALL.channels[:1]))

    def test_at_first_it_is_the_same_function(self, narrow, image, assert_close):
        grown = FeatureNetwork(SMALL, normalised=True)

        grown.begin_from(narrow)

        assert_close(grown.eval()(image), narrow(image))
        assert_close(grown.fused()(image), narrow(image))

    def test_the_new_branches_learn(self, narrow, image):
        grown = FeatureNetwork(SMALL, normalised=True)
        grown.begin_from(narrow)

        grown(image).square().mul(torch.rand_like(image[:, :1])).sum().backward()

        fresh = grown.mix.weight.grad[:, SMALL.channels[0] :]
        assert fresh.abs().sum(dim=0).gt(0).all()

    def test_what_has_trained_is_folded_branch_by_branch(self, narrow, image, assert_close):
        grown = FeatureNetwork(SMALL, normalised=True)
        grown.begin_from(narrow)
        torch.nn.init.normal_(grown.mix.weight)
        grown(torch.rand(2, 3, 40, 40))  # the normalisation sees a batch

        assert_close(grown.fused()(image), grown.eval()(image), **LOOSE)

    def test_another_shape_is_refused(self, narrow):
        with pytest.raises(ValueError, match="cannot begin from the weights of"):
            FeatureNetwork(replace(SMALL, depth=SMALL.depth + 1)).begin_from(narrow)
        with pytest.raises(ValueError, match="cannot begin from the weights of"):
            FeatureNetwork(replace(SMALL, channels=(5, 5))).begin_from(narrow)


class TestArchitecture:
    @pytest.mark.parametrize("architecture", [*SHAPES, *VARIANTS.values()], ids=str)
    def test_the_operations_are_those_that_torch_counts(self, architecture):
        network = network_of(architecture)
        height, width = 32, 48  # of which every branch is a whole share

        with FlopCounterMode(display=False) as counter, torch.no_grad():
            network(torch.zeros(2, 3, height, width))

        assert counter.get_total_flops() == round(
            architecture.gflop_per_megapixel_pair * 1e9 * height * width / 1e6
        )

    def test_the_variants_keep_their_limits(self):
        weights = {
            name: sum(value.numel() for value in FeatureNetwork(shape).parameters())
            for name, shape in VARIANTS.items()
        }

        assert weights["fast"] == 151_912
        assert weights["wide"] <= 1_000_000
        assert VARIANTS["wide"].margin_px > 4 * VARIANTS["fast"].margin_px

    def test_an_unknown_variant_is_refused_with_those_there_are(self):
        assert architecture_named("fast") is VARIANTS["fast"]
        with pytest.raises(ValueError, match="unknown variant 'fats'; there are fast, wide"):
            architecture_named("fats")

    @pytest.mark.parametrize(
        ("settings", "message"),
        [
            ({"channels": ()}, "channels must have from 1 to 5 branches, got 0"),
            ({"channels": (4,) * 6}, "channels must have from 1 to 5 branches, got 6"),
            ({"channels": (4, 0)}, "must be positive"),
            ({"depth": 0}, "must be positive"),
            ({"features": 24, "direct": True}, "features must be more than the 24 steps of a dir"),
            ({"direct": True, "direct_share": 1.0}, r"direct_share must be in \[0, 1\)"),
            ({"direct_share": 0.5}, "0 unless direct, got 0.5 with direct False"),
            ({"faint_step": 0.0}, "faint_step must be positive, got 0.0"),
            ({"dilations": (1, 2)}, "one a convolution: depth is 4 but there are 2"),
            ({"dilations": (1, 2, 0, 1)}, "must be positive"),
        ],
    )
    def test_a_shape_that_cannot_be_is_refused(self, settings, message):
        with pytest.raises(ValueError, match=message):
            Architecture(**settings)


class TestWeights:
    def test_what_was_saved_is_loaded(self, weights, image, assert_close):
        network = load_features(str(weights))

        assert network.architecture == SMALL
        assert not network.training
        assert not [p for p in network.parameters() if p.requires_grad]
        assert_close(network(image), network_of(SMALL)(image), **LOOSE)

    def test_the_steps_can_be_given_another_share_than_that_of_the_training(
        self, tmp_path, image, assert_close
    ):
        path = tmp_path / "direct.safetensors"
        save_features(path, network_of(DIRECT), about={})

        network = load_features(str(path), direct_share=0.3)

        assert_close(network(image), network_of(SHARED)(image), **LOOSE)

    def test_a_share_of_steps_that_are_no_part_of_the_vector_is_refused(self, weights):
        with pytest.raises(ValueError, match="0 unless direct"):
            load_features(str(weights), direct_share=0.3)

    def test_the_header_says_where_they_came_from(self, weights):
        with safe_open(weights, framework="pt") as file:
            header = file.metadata()

        assert header["command"] == "by hand"
        assert json.loads(header["network"]) == {
            "channels": [6, 8, 8],
            "depth": 2,
            "features": 8,
            "direct": False,
            "direct_share": 0.0,
            "faint_step": 0.015,
            "dilations": [],
        }

    def test_dilations_are_kept(self, tmp_path):
        path = tmp_path / "dilated.safetensors"
        save_features(path, network_of(BOTH), about={})

        assert load_features(str(path)).architecture == BOTH

    def test_weights_from_before_there_were_other_shapes_are_loaded(self, tmp_path, image):
        """Their header knows of channels, depth and features alone."""
        path, network = tmp_path / "old.safetensors", network_of(PLAIN)
        shape = json.dumps({"channels": [6], "depth": 3, "features": 8})
        path.write_bytes(save(dict(network.state_dict()), metadata={"network": shape}))

        loaded = load_features(str(path))

        assert loaded.architecture == PLAIN
        assert torch.allclose(loaded(image), network(image), atol=1e-5)

    def test_the_weights_that_ship_still_give_the_same_features(self, assert_close):
        """The values were computed when they were made."""
        y, x = torch.arange(40.0)[:, None], torch.arange(52.0)
        red, green = (
            0.5 + 0.4 * torch.sin(0.7 * x + 0.3 * y),
            0.5 + 0.4 * torch.cos(0.11 * x * y / 7),
        )
        blue = 0.5 + 0.3 * torch.sin(0.9 * y - 0.2 * x)

        features = load_features("fast")(torch.stack([red, green, blue])[None])[0, 22:26]

        assert_close(features[:, 0, 0], [0.142982, 0.142883, 0.203814, 0.000577])
        assert_close(features[:, 20, 26], [0.093527, 0.094481, 0.239198, -0.151364])
        assert_close(features[:, 39, 51], [0.000000, 0.000000, 0.064566, 0.013015])

    def test_nothing_but_the_file_is_left(self, weights):
        assert list(weights.parent.iterdir()) == [weights]

    def test_other_people_may_read_them(self, weights):
        other = weights.parent / "other"
        other.write_text("")

        assert weights.stat().st_mode == other.stat().st_mode

    @pytest.mark.parametrize("name", [name for name in shipped_weights() if name != "regulariser"])
    def test_weights_that_ship_give_vectors_of_length_one_at_most(self, name, image):
        lengths = load_features(name)(image).norm(dim=1)

        assert (lengths < 1 + 1e-5).all()
        assert lengths.mean() > 0.3

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
