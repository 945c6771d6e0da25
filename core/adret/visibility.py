"""Intervisibility: which cells see which, for all cells of a terrain at once."""

from dataclasses import dataclass
from typing import get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.horizon import HorizonOptions, Progress
from adret.methods import MAX_AZIMUTH_ERROR
from adret.report import RunReport
from adret.sight_frames import SightFrame
from adret.sight_sweep import Reduction, SightMethod, SightRun
from adret.sweep import Direction
from adret.terrain import Terrain

__all__ = ["Intervisibility", "intervisibility"]

Layer = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Intervisibility:
    """Local horizons of every cell towards K azimuths, as ragged lists.

    A local horizon is the far end of a run of visible samples: a sample that is seen, behind which
    the next one is not (or has no data). From one local horizon inwards, samples are seen as long
    as they lie on or above the line of sight to the next nearer one.

    Attributes
    ----------
    offsets : ndarray, shape (K · rows · columns + 1,), int64
        ``steps[offsets[i]:offsets[i + 1]]`` is the list of azimuth k and cell (row, column), with
        i = (k · rows + row) · columns + column.
    steps : ndarray, shape (offsets[-1],), int32
        Distances of the local horizons, near to far [steps of `step_length`].
    azimuth : ndarray, shape (K,), float64
        Azimuths [radians clockwise from north].
    terrain : Terrain
    options : HorizonOptions
    report : RunReport
    """

    offsets: NDArray[np.int64]
    steps: NDArray[np.int32]
    azimuth: NDArray[np.float64]
    terrain: Terrain
    options: HorizonOptions
    report: RunReport

    def of(self, row: int, column: int, k: int) -> NDArray[np.int32]:
        """Distances of one cell's local horizons towards azimuth k, near to far [steps].

        Parameters
        ----------
        row, column, k : int
            From 0.

        Returns
        -------
        ndarray, shape (number of local horizons,), int32
            A view. Empty where nothing is seen that way, and at nodata cells.

        Raises
        ------
        InputError
            If there is no such cell or azimuth.
        """
        i = self._place(row, column, k)
        return self.steps[self.offsets[i] : self.offsets[i + 1]]

    def step_length(self, row: int, k: int) -> float:
        """Ground length of a step towards azimuth k [m]; it depends on the latitude of the row.

        Parameters
        ----------
        row, k : int

        Returns
        -------
        float
        """
        self._place(row, 0, k)
        return self._direction(row, k).step

    def cells(self, k: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Local horizons towards azimuth k as cells, in compressed rows.

        Parameters
        ----------
        k : int

        Returns
        -------
        offsets : ndarray, shape (rows · columns + 1,), int64
        cells : ndarray, shape (offsets[-1],), int64
            Flat numbers (row · columns + column) of the cells that hold the samples, near to far.
            ``scipy.sparse.csr_array((ones, cells, offsets))`` is the matrix of who has whom as a
            local horizon.

        Raises
        ------
        InputError
            If there is no such azimuth.
        """
        rows, columns = self.terrain.shape
        i = self._place(0, 0, k)
        offsets = self.offsets[i : i + rows * columns + 1]
        steps = self.steps[offsets[0] : offsets[-1]]
        receiver = np.repeat(np.arange(rows * columns), np.diff(offsets))
        cells = np.empty(steps.size, np.int64)
        for band in self.terrain.latitude_bands(MAX_AZIMUTH_ERROR):
            some = slice(
                offsets[band.start * columns] - offsets[0],
                offsets[band.stop * columns] - offsets[0],
            )
            frame, direction = self._frame(band.start, k)
            cells[some] = frame.cells_at(direction, receiver[some], steps[some])
        return offsets - offsets[0], cells

    def visible(self, row: int, column: int, k: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cells that one cell sees towards azimuth k, near to far.

        Parameters
        ----------
        row, column, k : int

        Returns
        -------
        rows, columns : ndarray, shape (number of visible samples,), int64

        Raises
        ------
        InputError
            If there is no such cell or azimuth.
        """
        ends = self.of(row, column, k)
        frame, direction = self._frame(row, k)
        receiver = row * self.terrain.shape[1] + column
        steps = frame.visible_steps(direction, self.options, receiver, ends)
        cells = frame.cells_at(direction, np.full(steps.size, receiver), steps)
        seen_rows, seen_columns = np.divmod(cells, self.terrain.shape[1])
        return seen_rows, seen_columns

    def _place(self, row: int, column: int, k: int) -> int:
        rows, columns = self.terrain.shape
        for field, value, size in (
            ("k", k, self.azimuth.size),
            ("row", row, rows),
            ("column", column, columns),
        ):
            if not 0 <= value < size:
                raise InputError(field, f"between 0 and {size - 1}", value)
        return (k * rows + row) * columns + column

    def _direction(self, row: int, k: int) -> Direction:
        bands = self.terrain.latitude_bands(MAX_AZIMUTH_ERROR)
        band = next(b for b in bands if b.start <= row < b.stop)
        return Direction.of(float(self.azimuth[k]), band.cell_size)

    def _frame(self, row: int, k: int) -> tuple[SightFrame, Direction]:
        direction = self._direction(row, k)
        return SightFrame(self.terrain, direction.orientation), direction


@overload
def intervisibility(
    terrain: Terrain,
    directions: int = 32,
    *,
    azimuths: ArrayLike | None = None,
    method: SightMethod = "tree",
    reduce: None = None,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
    progress: Progress | None = None,
) -> Intervisibility: ...


@overload
def intervisibility(
    terrain: Terrain,
    directions: int = 32,
    *,
    azimuths: ArrayLike | None = None,
    method: SightMethod = "tree",
    reduce: Reduction,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
    progress: Progress | None = None,
) -> Layer: ...


def intervisibility(
    terrain: Terrain,
    directions: int = 32,
    *,
    azimuths: ArrayLike | None = None,
    method: SightMethod = "tree",
    reduce: Reduction | None = None,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
    progress: Progress | None = None,
) -> Intervisibility | Layer:
    """What every cell sees towards K azimuths: all local horizons, or one number a cell.

    Parameters
    ----------
    terrain : Terrain
    directions : int
        Number K of equally spaced azimuths, the first one north.
    azimuths : array_like, shape (K,), optional
        Azimuths [radians clockwise from grid north] instead.
    method : {"tree", "march"}
        "tree": the convex-hull tree of paper P2, in time linear in the local horizons. "march":
        the naive walk from every sample to its line's end. Both give the same result, exactly.
    reduce : str, optional
        None returns all local horizons; mind the memory, some 4 to 40 bytes a cell and azimuth.
        Otherwise a layer, made on the way without storing them:

        - "visible_count": samples seen, in all azimuths together [-]
        - "visible_area": ground seen, in plan [m²]: 2π times the mean over azimuths of the sum of
          distance times step length over the samples seen. The cell itself is left out.
        - "sight_distance": way to the farthest sample seen, mean over azimuths, 0 where none [m]
        - "max_sight_distance": the largest of them [m]
        - "horizon_count": local horizons, in all azimuths together [-]
        - "sky_view": share of the hemisphere over the cell's own plane, weighted by the cosine,
          that is sky above the horizontal [-]
        - "terrain_view": 1 less "sky_view" [-]

    max_distance : float, optional
        Terrain further away than this [m] is not seen.
    radius : float, optional
        Radius of the planet [m], such as ``terrain.body_radius``; None for a flat one.
    refraction : float
        Coefficient k of the ray's curvature. Needs `radius`.
    observer_height : float
        Height of the eye above the surface [m]. What is seen is ground.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.

    Returns
    -------
    Intervisibility or ndarray, shape (rows, columns), float32
        Layers are NaN at nodata cells; their lists are empty.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    Lines run along the azimuth, one cell apart along the minor axis, with one sample a cell of the
    major axis, interpolated between two cells. A cell receives and is seen as the one sample that
    is nearest to it in its own row (or column): no more than half a cell aside along the minor
    axis. Along the axes and the diagonals of cells the samples are the cells. Each sample that
    counts stands for its cell, so that results have no cell twice and none left out.

    On its line a result is exact: a sample is seen if no nearer one lies above the line of sight to
    it, one on it does not hide; heights are rounded to 2⁻²⁴ of a cell (or, where the relief is
    above some 16 000 cells, to 2⁻³⁷ of it), and compared without rounding. Between samples the
    surface is the straight line between them. Off the axes and diagonals the line's samples differ
    from the cells' own rays by up to half a cell aside; horizons where this matters are those of
    `adret.horizon_map`.

    A sample has no data where its cell has none: then it neither sees nor hides nor is seen. Beside
    a cell without data, and at the raster's edge, a sample has its own cell's height.

    References
    ----------
    Timonen, V., "Low-complexity intervisibility in height fields", Computer Graphics Forum 31(8),
    2012 (paper P2). Lines and sampling are those of `adret.sweep`.

    Examples
    --------
    >>> import numpy as np, adret
    >>> heights = np.array([[0.0, 3.0, 1.0, 0.0, 2.0, 2.0, 9.0]])
    >>> terrain = adret.Terrain(heights, cell_size=(10.0, 10.0))
    >>> east = adret.intervisibility(terrain, azimuths=[np.pi / 2])
    >>> east.of(0, 1, 0), east.of(0, 6, 0)
    (array([5], dtype=int32), array([], dtype=int32))
    >>> east.visible(0, 3, 0)[1]
    array([4, 6])
    >>> adret.intervisibility(terrain, azimuths=[np.pi / 2], reduce="visible_count")
    array([[1., 5., 3., 2., 2., 1., 0.]], dtype=float32)
    """
    if method not in get_args(SightMethod):
        raise InputError("method", f"one of {', '.join(get_args(SightMethod))}", method)
    if reduce is not None and reduce not in get_args(Reduction):
        raise InputError("reduce", f"None or one of {', '.join(get_args(Reduction))}", reduce)
    options = HorizonOptions(
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    azimuth = azimuth_set(directions, azimuths)
    run = SightRun(terrain, azimuth, options, method, progress)
    if reduce is None:
        offsets, steps, report = run.lists()
        return Intervisibility(offsets, steps, azimuth, terrain, options, report)
    if reduce in ("sky_view", "terrain_view"):
        sky = run.sky_view()
        return sky if reduce == "sky_view" else np.float32(1.0) - sky
    return run.layer(reduce)
