"""What a recipe leaves out stays out, and disparities are spread as it says."""

import math
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
import torch

from recon.training import recipe as recipes
from recon.training import scenery
from recon.training.augmentation import Augmentation
from recon.training.casting import Camera, first_hits, windows
from recon.training.composition import Coat, Thing, View, assemble
from recon.training.patterns import PERIODIC, STYLES
from recon.training.recipe import FULL, HARD, REPEATING, SCENES, Recipe, recipe_hash
from recon.training.scenery import KINDS_OF_SCENE, compose
from recon.training.shapes import KINDS
from recon.training.staging import WEAK_WALLS, Dice, Stage

SIZE = (64, 40)
SWITCHES = [field.name for field in fields(Recipe) if field.type == "bool"]


@cache
def composed(count, recipe=FULL):
    """Return scenes and views of seeds; composed once for all tests."""
    return [compose(torch.Generator().manual_seed(seed), SIZE, recipe) for seed in range(count)]


def names_of(numbers, table):
    return {list(table)[number] for number in numbers.tolist()}


def styles_of(scenes):
    return set().union(*(names_of(scene.paints.style, STYLES) for scene, _ in scenes))


def kinds_of(scenes):
    return set().union(*(names_of(scene.shapes.kind, KINDS) for scene, _ in scenes))


def stage(recipe, seed=0):
    view = View(*SIZE, focal_px=80.0, baseline_m=1.0)
    return Stage(Dice(torch.Generator().manual_seed(seed)), view, recipe, 0.2)


def largest_share(seed, recipe=FULL, quantile=0.99):
    """Return a quantile of the disparities of the left view as a share of the width."""
    scene, view = compose(torch.Generator().manual_seed(seed), SIZE, recipe)
    camera = Camera(*SIZE, view.focal_px)
    rays = camera.rays([(0.0, 0.0)], torch.device("cpu"))
    depth = first_hits(scene.shapes, rays, windows(scene.shapes.corners(), camera)).depth
    disparity = view.focal_px * view.baseline_m / depth.flatten()
    return float(torch.quantile(disparity, quantile)) / view.width


def test_every_scene_that_a_recipe_may_name_can_be_made():
    assert tuple(KINDS_OF_SCENE) == SCENES + HARD
    assert set(REPEATING) < set(SCENES)


def test_the_full_recipe_uses_every_kind_of_shape_and_every_style():
    scenes = composed(40)

    assert kinds_of(scenes) == set(KINDS)
    assert styles_of(scenes) == set(STYLES)


def test_without_reliefs_there_are_none():
    without = replace(FULL, reliefs=False)

    assert "relief" not in kinds_of(composed(25, without))
    assert "relief" not in without.kinds


def test_without_repeated_structures_nothing_repeats():
    without = replace(FULL, repeated_structures=False)

    assert not styles_of(composed(25, without)) & set(PERIODIC)
    assert not set(without.kinds) & set(REPEATING)


def test_without_light_every_colour_is_as_it_was_painted():
    for scene, _ in composed(10, replace(FULL, light=False)):
        assert scene.light.ambient == 1
        assert scene.light.lamp_strength == 0
        assert not scene.light.casts_shadows
        assert not scene.paints.gloss.any()


def test_with_light_some_scenes_have_shadows_lamps_and_gloss():
    lights = [scene.light for scene, _ in composed(40)]

    assert {light.casts_shadows for light in lights} == {True, False}
    assert min(light.spread for light in lights) == 0 < max(light.spread for light in lights)
    assert any(light.lamp_strength > 0 for light in lights)


@pytest.mark.parametrize("recipe", [FULL, replace(FULL, weak_texture=False)])
def test_a_set_share_of_the_walls_is_nearly_blank(recipe):
    coats = [stage(recipe, seed).papered(2.0) for seed in range(400)]

    blank = np.mean([coat.style in ("flat", "gradient") for coat in coats])
    expected = WEAK_WALLS if recipe.weak_texture else 0
    assert abs(blank - expected) <= 3 * math.sqrt(expected * (1 - expected) / 400)


def test_most_walls_of_a_bare_room_are_blank():
    found = [
        coat for seed in range(30) for coat in wall_styles(seed, Recipe(scenes=("bare_room",)))
    ]

    assert np.mean(np.isin(found, ("flat", "gradient"))) > 0.4


def test_most_walls_of_a_white_room_are_brighter_than_those_of_a_bare_one():
    def brightness(kind):
        coats = [
            scene.paints.colours[scene.shapes.kind == KINDS.index("rectangle")].mean()
            for scene, _ in (
                compose(torch.Generator().manual_seed(seed), SIZE, Recipe(scenes=(kind,)))
                for seed in range(12)
            )
        ]
        return float(np.mean(coats))

    assert brightness("white_room") > 1.3 * brightness("bare_room")


def wall_styles(seed, recipe):
    """Return the styles of the first four surfaces of a scene, which are walls."""
    scene, _ = compose(torch.Generator().manual_seed(seed), SIZE, recipe)
    return [list(STYLES)[style] for style in scene.paints.style[:4]]


def test_blank_walls_have_faint_grain_and_others_have_contrast():
    coats = [stage(FULL, seed).papered(2.0) for seed in range(300)]

    blank, rich = [], []
    for coat in coats:
        first, second = coat.colours ** (1 / 2.2)
        steps = blank if coat.style in ("flat", "gradient") else rich
        steps.append(float((first - second).abs().max()))
    assert max(blank) < 0.21
    assert np.median(rich) > 0.2


def test_without_textured_background_walls_have_one_colour():
    coats = [
        stage(replace(FULL, textured_background=False), seed).papered(2.0) for seed in range(9)
    ]

    for coat in coats:
        assert coat.style == "flat"
        assert coat.grain == 0
        assert (coat.colours[0] - coat.colours[1]).abs().max() < 1e-3


def twins(scenes):
    """Return how many things have exactly the colours of the first thing of their scene."""
    return sum(
        int((scene.paints.colours == scene.paints.colours[:1]).all(-1).all(-1).sum()) - 1
        for scene, _ in scenes
    )


def test_shared_textures_are_those_of_things_behind():
    rooms = Recipe(scenes=("room", "clutter"))

    assert twins(composed(20, rooms)) > 12
    assert twins(composed(10, replace(rooms, shared_textures=False))) == 0


def test_the_largest_disparities_are_spread_evenly_in_their_logarithm_from_3_to_25_percent():
    sheets = Recipe(scenes=("sheets",))  # few things: quick

    shares = np.array([largest_share(seed, sheets) for seed in range(90)])

    assert shares.min() > 0.025
    assert shares.max() < 0.26
    thirds = np.histogram(np.log(shares), np.log([0.02, 0.061, 0.123, 0.3]))[0]
    assert thirds.min() >= 20  # of 30


def test_a_small_thing_right_before_the_camera_keeps_within_30_percent():
    """It is too small to count in the 99th percentile, which would be 25 %."""
    coat = Coat("flat", torch.zeros(2, 3), 1.0)
    axes, view = torch.eye(3), View(*SIZE, focal_px=64.0, baseline_m=1.0)
    wall = Thing("rectangle", (0, 0, 5), (20, 20, 1), axes, coat)
    fly = Thing("ellipsoid", (0, 0, 1), (0.03, 0.03, 0.03), axes, coat)
    table, up = torch.zeros(512, 512), -axes[1]
    shares = []
    for things in ([wall], [wall, fly]):
        scene = assemble(things, table, up, shadows=False)
        chosen = scenery.with_baseline(view, scene, 0.25)
        shares.append(chosen.focal_px * chosen.baseline_m / SIZE[0] / 5)

    assert shares[0] == pytest.approx(0.25, rel=1e-3)
    assert shares[1] == pytest.approx(0.3 / 5, rel=0.05)


def test_narrow_baselines_are_within_8_to_12_percent():
    narrow = replace(FULL, wide_baselines=False)

    shares = [largest_share(seed, narrow) for seed in range(12)]

    assert min(shares) > 0.07
    assert max(shares) < 0.13


def test_landscapes_are_far_and_close_ups_near():
    far, near = (
        np.mean([largest_share(seed, Recipe(scenes=(kind,))) for seed in range(8)])
        for kind in ("landscape", "close_up")
    )

    assert far < 0.1 < near


def test_focal_lengths_span_a_factor_of_three():
    focal = [view.focal_px / view.width for _, view in composed(40)]

    assert max(focal) > 3 * min(focal)


def test_the_hash_follows_from_every_setting_and_from_nothing_else(monkeypatch):
    hashes = {recipe_hash(FULL), *(recipe_hash(replace(FULL, **{s: False})) for s in SWITCHES)}
    hashes.add(recipe_hash(replace(FULL, scenes=("room",))))
    hashes.add(recipe_hash(FULL, Augmentation()))
    hashes.add(recipe_hash(FULL, Augmentation(occluders=False)))

    assert len(hashes) == len(SWITCHES) + 4
    assert len(SWITCHES) == len(fields(Recipe)) - 1
    assert recipe_hash(Recipe()) == recipe_hash(FULL)
    assert all(len(one) == 12 for one in hashes)
    monkeypatch.setattr(recipes, "VERSION", 0)
    assert recipe_hash(FULL) not in hashes


def test_the_full_recipe_is_known_by_its_hash_and_its_first_scenes():
    """What cards of weights say. Raise `VERSION` with any change that moves a pixel."""
    scenes = composed(40)[:6]

    assert recipe_hash(FULL) == "9bfa66431ce9"
    assert [len(scene.shapes) for scene, _ in scenes] == [6, 27, 14, 132, 20, 34]
    baselines = [view.baseline_m * view.focal_px for _, view in scenes]
    assert baselines == pytest.approx([2.5491, 7.8912, 13.858, 7.4817, 9.3392, 4.971], rel=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scenes": ("room", "moon")}, r"unknown scene 'moon'; there are room, clutter, dense"),
        ({"scenes": ()}, r"no kind of scene is left of \(\)"),
        (
            {"scenes": ("fence",), "repeated_structures": False},
            r"left of \('fence',\) without repeated structures",
        ),
        ({"scenes": ("relief",), "reliefs": False}, r"left of \('relief',\) without reliefs"),
    ],
)
def test_a_recipe_that_makes_nothing_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Recipe(**settings)
