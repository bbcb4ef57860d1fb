"""The web viewer shows a recording: checked by looking at the page."""

import numpy as np
import pytest
from browsing import chromium, page
from rendered import QUICK, SEARCHED, still_life

from recon import reconstruct
from recon.settings import load_preset
from recon.viewer import RerunObserver, serve_recording

SIZE = (1000, 760)


def drawn(picture):
    """Return the share of pixels that are darker than the page and the grid on its floor."""
    return float((picture.min(axis=2) < 170).mean())


def scene(shown):
    """Return what the page has of the scene: the left half, between its tabs and the stages."""
    return shown[60 : int(0.75 * len(shown)), : SIZE[0] // 2 - 20]


def photographs(shown):
    """Return what the page has of the photographs: the upper right quarter."""
    return shown[60 : int(0.4 * len(shown)), SIZE[0] // 2 + 20 :]


@pytest.fixture
def preset(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    return load_preset(str(tmp_path / "quick.toml"))


def looked_at(tab):
    """Wait until a page has what it should show, and assert that it does."""
    shown = tab.picture_when(
        lambda picture: 0.05 < drawn(scene(picture)) < 0.8, within_s=300, every_s=3
    )
    assert 0.05 < drawn(scene(shown)) < 0.8, "no surface is seen"  # the page is dark at first
    assert drawn(photographs(shown)) > 0.05, "no photograph is seen"
    assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 1000


@pytest.mark.slow
@pytest.mark.skipif(chromium() is None, reason="there is no Chromium")
def test_the_served_recording_is_seen_in_a_browser(tmp_path, preset):
    with RerunObserver(save=tmp_path / "a.rrd") as observe:
        reconstruct(still_life().pair, preset, disparities=SEARCHED, observe=observe)

    served = serve_recording(tmp_path / "a.rrd", open_browser=False)

    with page(f"{served.url}&renderer=webgl&theme=light", size=SIZE) as tab:
        looked_at(tab)


@pytest.mark.slow
@pytest.mark.skipif(chromium() is None, reason="there is no Chromium")
def test_a_page_that_was_open_before_the_run_is_filled_by_it(preset):
    with (
        RerunObserver(show="browser", open_browser=False) as observe,
        page(f"{observe.page.url}&renderer=webgl&theme=light", size=SIZE) as tab,
    ):
        reconstruct(still_life().pair, preset, disparities=SEARCHED, observe=observe)

        looked_at(tab)
