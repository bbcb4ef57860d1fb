"""The observer that sends every stage to Rerun: to a file, a window or a browser."""

from __future__ import annotations

import contextlib
import os
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Literal, TypeGuard

import numpy as np
import rerun as rr

from calib.pair import RectifiedPair
from recon.colours import colour_range
from recon.files import atomic
from recon.types import Array, CostVolume, DisparityMap, Mesh, PointCloud
from recon.viewer.arrangement import HISTOGRAMS, STAGES, SUMMARY, TIMELINE, arranged
from recon.viewer.charts import histogram
from recon.viewer.curves import PROBES, CurveKeeper
from recon.viewer.drawing import CLASSES, WORLD, archetypes, rows_shown
from recon.viewer.serving import APPLICATION, Page, open_page
from recon.viewer.summary import summary
from recon.viewer.thinning import Limits, as_numpy, left_out, thinning_step

__all__ = ["RerunObserver"]

WINDOW_PORT = 9876
CLOCK = "seconds"
RESULT = "depth"
"""The stage after which the disparities change no more."""

REPORT = "run"
UNKNOWN = (0.0, 0.0, 3.0)
"""Where the eye looks while nothing is in space, metres."""


class RerunObserver:
    """Draw every result; the name of the stage is its path in the recording.

    Used in a `with` block. A recording appears under its name when the block ends, whole; if the
    block raises, none appears. A browser is served until the program ends. Without `save` and
    `show` it draws nothing and costs nothing.

    Attributes:
        page: for a browser on this machine; None unless shown in a browser.
    """

    def __init__(
        self,
        *,
        save: str | os.PathLike[str] | None = None,
        show: Literal["nothing", "window", "browser"] = "nothing",
        limits: Limits | None = None,
        probes: Sequence[tuple[int, int]] = (),
        port: int | None = None,
        open_browser: bool = True,
    ) -> None:
        """Start a recording.

        Args:
            save: the .rrd file to write.
            show: a window of Rerun's viewer, or a page for a browser on this machine.
            limits: how much of each result is drawn.
            probes: columns and rows of pixels of the rectified left picture whose costs are
                drawn, beside those that are chosen.
            port: of the page for a browser; its data take the next one. If none is given, 9090 or
                any free one.
            open_browser: open the page at once.

        Raises:
            FileNotFoundError: if the folder of `save` does not exist.
            ValueError: if `port` is in use.
        """
        self.page: Page | None = None
        self._limits = limits or Limits()
        self._file = contextlib.ExitStack()
        self._live = show != "nothing"
        self._open = self._live or save is not None
        self._drawn: dict[str, type] = {}
        self._focus = UNKNOWN
        self._since = time.perf_counter()
        self._ends: list[float] = []
        self._size: tuple[int, int] | None = None
        self._span: tuple[float, float] | None = None
        self._maps: dict[str, DisparityMap[Any]] = {}
        self._notes: list[str] = []
        self._report: Mapping[str, object] = {}
        self._summary = ""
        self._arranged: tuple[str, ...] = ()
        self._curves = CurveKeeper(probes)
        if self._open:
            self._start(save, show, port, open_browser)

    def _start(
        self,
        save: str | os.PathLike[str] | None,
        show: str,
        port: int | None,
        open_browser: bool,
    ) -> None:
        """Connect the recording to its file and its viewer."""
        self._recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        self._recording.set_log_time_enabled(False)
        sinks: list[rr.FileSink | rr.GrpcSink | rr.GrpcServerSink] = []
        if save is not None:
            sinks.append(rr.FileSink(self._file.enter_context(atomic(save))))
        if show == "window":
            rr.spawn(port=WINDOW_PORT, connect=False)
            sinks.append(rr.GrpcSink(f"rerun+http://127.0.0.1:{WINDOW_PORT}/proxy"))
        if show == "browser":
            self.page = open_page(port=port, open_browser=open_browser)
            sinks.append(rr.GrpcSink(self.page.data))
        self._recording.set_sinks(*sinks)
        self._file.callback(self._end)
        self._recording.log("/", rr.ViewCoordinates.RDF, static=True)
        self._recording.log("/", CLASSES, static=True)
        if self._live:
            self._arrange()

    def __call__(self, stage: str, result: object) -> None:
        """Draw what a stage made.

        Args:
            stage: slash-separated name, such as "disparity/left".
            result: of any type; `archetypes` knows how to draw it.

        Raises:
            ValueError: if a pixel to be probed lies outside the pair.
        """
        if not self._open:
            return
        step = self._next_step(stage)
        if isinstance(result, RectifiedPair):
            self._curves.look_at(result)
            self._size = result.geometry.size
        self._note(stage, result)
        for path, archetype in self._drawing(stage, result):
            self._log(path, archetype)
        if isinstance(result, CostVolume):
            self._curves.keep(stage, step, result)
        if stage == RESULT:
            self._draw_probes(step)
        self._draw_summary(stage, result)
        if self._live and tuple(self._drawn) != self._arranged:
            self._arrange()

    def _next_step(self, stage: str) -> int:
        """Go on to the next place of the timelines, and name it."""
        step = len(self._ends)
        begun = self._ends[-1] if self._ends else 0.0
        self._ends.append(round(time.perf_counter() - self._since, 3))
        self._recording.set_time(TIMELINE, sequence=step)
        self._recording.set_time(CLOCK, duration=begun)
        self._recording.log(STAGES, rr.StateChange(state=stage))
        self._go_to(step)
        return step

    def _go_to(self, step: int) -> None:
        self._recording.set_time(TIMELINE, sequence=step)
        self._recording.set_time(CLOCK, duration=self._ends[step])

    def _log(self, path: str, archetype: rr.AsComponents) -> None:
        self._recording.log(path, archetype)
        self._drawn[path] = type(archetype)

    def _drawing(self, stage: str, result: object) -> Iterator[tuple[str, rr.AsComponents]]:
        """Return what to draw of a result, at absolute paths."""
        unchanged: set[str] = set()
        base = f"/{stage}"
        limits = self._limits
        if isinstance(result, PointCloud | Mesh):
            base = f"{WORLD}/{stage}"
        elif self._is_a_picture(result):
            side = "right" if stage.endswith("/right") else "left"
            base = f"{WORLD}/{side}/{stage.removesuffix('/left').removesuffix('/right')}"
            if isinstance(result, DisparityMap):
                unchanged = _unchanged(self._maps.get(side), result)
                self._maps[side] = result
                self._span = self._span or colour_range(as_numpy(result.values))
                limits = replace(limits, disparity_span=self._span)
                if side == "left":
                    yield from _histograms(result)
            else:
                yield from _histogram("depth", as_numpy(result))
        if isinstance(result, CostVolume):
            yield from self._slices(base, result)
            return
        for path, archetype in archetypes(result, limits):
            if path not in unchanged:
                yield path if path.startswith("/") else f"{base}/{path}".rstrip("/"), archetype

    def _slices(self, base: str, volume: CostVolume) -> Iterator[tuple[str, rr.AsComponents]]:
        """Draw the rows of a volume that are drawn of the pair, if they are in it and whole."""
        height, width = volume.cost.shape[:2]
        whole_width, whole_height = self._size or (width, height)
        top, _ = volume.origin
        for row in rows_shown(whole_height):
            if width == whole_width and top <= row < top + height:
                one = replace(volume, cost=volume.cost[row - top : row - top + 1], origin=(row, 0))
                for path, archetype in archetypes(one, self._limits):
                    yield f"{base}/{path}", archetype

    def _is_a_picture(self, result: object) -> TypeGuard[DisparityMap[Any] | Array]:
        """Return whether a result has one value for each pixel of the pair."""
        if isinstance(result, DisparityMap):
            result = result.values
        shape = getattr(result, "shape", ())
        return self._size is not None and tuple(shape) == self._size[::-1]

    def _note(self, stage: str, result: object) -> None:
        """Remember what a person should know of a result."""
        self._notes += [f"{stage}: {note}" for note in left_out(result, self._limits)]
        if isinstance(result, PointCloud) and len(result):
            self._focus = _middle(result.points)
        elif isinstance(result, Mesh) and len(result.vertices) and self._focus == UNKNOWN:
            self._focus = _middle(result.vertices)

    def _draw_probes(self, step: int) -> None:
        """Choose pixels by the final map, and draw their costs at the stages they are of."""
        disparity = self._maps.get("left")
        if disparity is None or self._size is None:
            return
        final = DisparityMap(
            *(as_numpy(a) for a in (disparity.values, disparity.status, disparity.confidence))
        )
        self._curves.choose(final)
        for place, drawing in self._curves.charts(final, step):
            self._go_to(place)
            for path, archetype in drawing:
                self._log(path, archetype)
        self._go_to(step)
        thinned_by = thinning_step(*self._size, self._limits.max_pixels)
        for path, archetype in self._curves.marks(final, thinned_by):
            self._log(path, archetype)

    def _draw_summary(self, stage: str, result: object) -> None:
        if stage == REPORT and isinstance(result, Mapping):
            self._report = result
        text = summary(self._report, self._notes, self._curves.probes)
        if text != self._summary:
            self._summary = text
            self._log(SUMMARY, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _arrange(self) -> None:
        self._arranged = tuple(self._drawn)
        charts = [f"{PROBES}/{probe.name}" for probe in self._curves.probes]
        probes = [path for path in charts if any(at.startswith(path) for at in self._drawn)]
        self._recording.send_blueprint(arranged(self._drawn, self._focus, probes))

    def close(self) -> None:
        """End the recording and give it its name."""
        self.__exit__(None, None, None)

    def _end(self) -> None:
        """Arrange the windows, and write what is not written yet."""
        self._open = False
        self._arrange()
        self._recording.flush()
        self._recording.disconnect()

    def __enter__(self) -> RerunObserver:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.__exit__(kind, error, trace)


def _middle(places: Array) -> tuple[float, float, float]:
    """Return the median of places (N, 3) in metres.

    The vertices of a decimated mesh crowd at its edges, so that a cloud is the better judge.
    """
    x, y, z = (float(value) for value in np.median(places, axis=0))
    return x, y, z


def _unchanged(before: DisparityMap[Any] | None, after: DisparityMap[Any]) -> set[str]:
    """Return the names of the fields that a stage left as they were."""
    if before is None:
        return set()
    names = ("values", "status", "confidence")
    fields = {name: [as_numpy(getattr(m, name)) for m in (before, after)] for name in names}
    return {
        name
        for name, (old, new) in fields.items()
        if np.array_equal(old, new, equal_nan=new.dtype.kind == "f")
    }


def _histograms(disparity: DisparityMap[Any]) -> Iterator[tuple[str, rr.AsComponents]]:
    valid = as_numpy(disparity.valid)
    yield from _histogram("disparity_px", as_numpy(disparity.values))
    yield from _histogram("confidence", as_numpy(disparity.confidence)[valid])


def _histogram(name: str, values: Array) -> Iterator[tuple[str, rr.AsComponents]]:
    if (bars := histogram(values)) is not None:
        yield f"{HISTOGRAMS}/{name}", bars
