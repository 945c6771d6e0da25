"""Intervisibility: which cells see which, for all cells of a terrain at once."""

from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._summaries import summary
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.horizon import HorizonOptions
from adret.horizon_run import Progress
from adret.methods import MAX_AZIMUTH_ERROR
from adret.sight_frames import SightFrame
from adret.sight_rays import NEAR, Sight, SightMethod
from adret.sight_sweep import Reduction, SightReport, SightRun
from adret.sweep import Direction
from adret.terrain import Terrain

__all__ = ["CompressedRows", "Intervisibility", "intervisibility"]

Layer = NDArray[np.float32]


class CompressedRows(NamedTuple):
    """A sparse matrix in compressed rows, as ``scipy.sparse.csr_array`` takes it.

    Attributes
    ----------
    data : ndarray, float32
    indices : ndarray, int64
        Column of each entry.
    indptr : ndarray, shape (rows + 1,), int64
        Entries of row i are ``indptr[i]`` to ``indptr[i + 1]``.
    """

    data: NDArray[np.float32]
    indices: NDArray[np.int64]
    indptr: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Intervisibility:
    """Local horizons of every cell towards K azimuths, as ragged lists.

    A local horizon is the far end of a run of visible samples: a sample that is seen, behind which
    the next one is not (or has no data). All that a cell sees lies on or above the line of sight to
    its next nearer local horizon; `visible` lists it.

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
    method : str
    report : SightReport
    """

    offsets: NDArray[np.int64]
    steps: NDArray[np.int32]
    azimuth: NDArray[np.float64]
    terrain: Terrain
    options: HorizonOptions
    method: SightMethod
    report: SightReport
    _latest: list[SightFrame] = field(default_factory=list, init=False, repr=False)

    __repr__ = summary

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

    def cells(self, k: int) -> CompressedRows:
        """Local horizons towards azimuth k as cells, in compressed rows.

        Parameters
        ----------
        k : int

        Returns
        -------
        CompressedRows
            Row and column number are row · columns + column of a receiver and of a cell that is
            nearest to one of its local horizons; entries are distances [m], near to far.
            ``scipy.sparse.csr_array(rows, shape=(cells, cells))`` is the matrix.

        Raises
        ------
        InputError
            If there is no such azimuth.

        Examples
        --------
        >>> import numpy as np, adret
        >>> terrain = adret.Terrain(np.array([[0.0, 2.0, 0.0, 9.0]]), cell_size=(10.0, 10.0))
        >>> east = adret.intervisibility(terrain, azimuths=[np.pi / 2])
        >>> east.cells(0)
        CompressedRows(data=array([10., 30., 20., 10.], dtype=float32), \
indices=array([1, 3, 3, 3]), indptr=array([0, 2, 3, 4, 4]))
        """
        rows, columns = self.terrain.shape
        i = self._place(0, 0, k)
        offsets = self.offsets[i : i + rows * columns + 1]
        steps = self.steps[offsets[0] : offsets[-1]]
        receiver = np.repeat(np.arange(rows * columns), np.diff(offsets))
        cells = np.empty(steps.size, np.int64)
        distance = np.empty(steps.size, np.float32)
        for band in self.terrain.latitude_bands(MAX_AZIMUTH_ERROR):
            some = slice(
                offsets[band.start * columns] - offsets[0],
                offsets[band.stop * columns] - offsets[0],
            )
            frame, sight = self._frame(band.start, k)
            cells[some] = frame.cells_at(sight, receiver[some], steps[some])
            distance[some] = steps[some] * sight.direction.step
        return CompressedRows(distance, cells, offsets - offsets[0])

    def to_awkward(self) -> Any:
        """The lists as an array of Awkward Array, which must be installed.

        Returns
        -------
        awkward.Array, type K * rows * columns * var * int32
            A view of `steps`.

        Raises
        ------
        ImportError
            If there is no package ``awkward``.
        """
        awkward: Any = import_module("awkward")
        rows, columns = self.terrain.shape
        lists = awkward.contents.ListOffsetArray(
            awkward.index.Index64(self.offsets), awkward.contents.NumpyArray(self.steps)
        )
        for size in (columns, rows):
            lists = awkward.contents.RegularArray(lists, size)
        return awkward.Array(lists)

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
        frame, sight = self._frame(row, k)
        receiver = row * self.terrain.shape[1] + column
        steps = frame.visible_steps(sight, receiver, ends)
        cells = frame.cells_at(sight, np.full(steps.size, receiver), steps)
        seen_rows, seen_columns = np.divmod(cells, self.terrain.shape[1])
        return seen_rows, seen_columns

    def _place(self, row: int, column: int, k: int) -> int:
        rows, columns = self.terrain.shape
        for name, value, size in (
            ("k", k, self.azimuth.size),
            ("row", row, rows),
            ("column", column, columns),
        ):
            if not 0 <= value < size:
                raise InputError(name, f"between 0 and {size - 1}", value)
        return (k * rows + row) * columns + column

    def _direction(self, row: int, k: int) -> Direction:
        bands = self.terrain.latitude_bands(MAX_AZIMUTH_ERROR)
        band = next(b for b in bands if b.start <= row < b.stop)
        return Direction.of(float(self.azimuth[k]), band.cell_size)

    def _frame(self, row: int, k: int) -> tuple[SightFrame, Sight]:
        direction = self._direction(row, k)
        if not self._latest or self._latest[0].orientation != direction.orientation:
            self._latest[:] = [SightFrame(self.terrain, direction.orientation)]
        frame = self._latest[0]
        return frame, frame.sight(direction, self.options, self.method)


@overload
def intervisibility(
    terrain: Terrain,
    directions: int = 32,
    *,
    azimuths: ArrayLike | None = None,
    method: SightMethod = "rays",
    near: int | None = None,
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
    method: SightMethod = "rays",
    near: int | None = None,
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
    method: SightMethod = "rays",
    near: int | None = None,
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
    method : {"rays", "tree", "march"}
        "rays": every cell's own ray to its end; neighbours walk together, and pass over what is
        too low to be seen. "tree": own rays up to `near`, and beyond it the convex-hull tree of
        paper P2 on swept lines, in time linear in the local horizons. "march": as "tree", but by
        the naive walk from every sample to its line's end; the result is the same, exactly.
    near : int, optional
        Steps [cells along the larger axis component], 0 to 4096, up to which every crossing of the
        own ray with the grid hides; more is slower and more accurate. None: 4096 for "rays", which
        makes it exact, and 32 otherwise. Beyond, "rays" looks at the crossings with the grid
        lines across the larger component. "tree" with 0 is the paper's structure.
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
          that is sky above the horizontal [-]: ``sky_view_factor(kind="normal")``
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
        Layers are NaN at nodata cells; their lists are empty. `last_run_report` is a `SightReport`.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    Samples are the crossings of a ray with the grid lines across its larger component: one a step.
    A sample is seen if no crossing before it is above the line of sight to it; one on it does not
    hide. Between cells the surface is the straight line between them. On own rays slopes are in
    float32, and a sample counts as on the line if it lies below it by less than heights and slopes
    in float32 are off by. A crossing that touches nodata is neither seen nor hides.

    Swept lines run along the azimuth, one cell apart along the minor axis, with one sample a step.
    A cell receives and is seen as the sample nearest to it in its own row (or column): no more than
    half a cell aside. With a near field, it receives at its own height. On the line the result is
    exact: heights are rounded to 2⁻²⁴ of a cell (or, where the relief is above some 16 000 cells,
    to 2⁻³⁷ of it) and compared without rounding. A sample on a line has no data where its cell has
    none; beside one, and at the raster's edge, it has its own cell's height.

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
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    if method not in get_args(SightMethod):
        raise InputError("method", f"one of {', '.join(get_args(SightMethod))}", method)
    if reduce is not None and reduce not in get_args(Reduction):
        raise InputError("reduce", f"None or one of {', '.join(get_args(Reduction))}", reduce)
    options = HorizonOptions(
        near=NEAR[method] if near is None else near,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    azimuth = azimuth_set(directions, azimuths)
    run = SightRun(terrain, azimuth, options, method, progress)
    if reduce is None:
        offsets, steps, report = run.lists()
        return Intervisibility(offsets, steps, azimuth, terrain, options, method, report)
    if reduce in ("sky_view", "terrain_view"):
        sky = run.sky_view()
        return sky if reduce == "sky_view" else np.float32(1.0) - sky
    return run.layer(reduce)
