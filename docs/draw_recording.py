"""Draw docs/recording.jpg from a finished `make demo`: python docs/draw_recording.py out/demo.

Needs Chromium, and some minutes where it has no graphics card.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np

from recon.viewer import serve_recording

sys.path.append(str(Path(__file__).parents[1] / "tests" / "recon"))
from browsing import page

SIZE = (1500, 1040)


def seen(picture: np.ndarray) -> bool:
    """Return whether the scene, at the left, is drawn."""
    scene = picture[80 : int(0.7 * len(picture)), : SIZE[0] // 2 - 20].astype(int)
    return float((scene.max(axis=2) - scene.min(axis=2) > 30).mean()) > 0.1


def main(folder: Path) -> None:
    """Open the recording of a reconstruction and take a picture of it."""
    served = serve_recording(folder / "recording.rrd", open_browser=False)
    with page(f"{served.url}&renderer=webgl&theme=light", size=SIZE) as tab:
        tab.picture_when(seen, within_s=600)
        time.sleep(20)  # until the last stages are drawn too
        shown = tab.picture()
    path = Path(__file__).with_name("recording.jpg")
    cv2.imwrite(str(path), shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
