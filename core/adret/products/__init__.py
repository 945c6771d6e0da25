"""The results that Adret writes to files: one registry for the command line and the service.

A product turns a terrain (or a depth buffer) and its typed parameters into named layers with a unit
and the formula that defines them; `run` writes them as a cloud-optimised GeoTIFF and, if asked, as
a picture.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from adret._gdal import PathLike, atomic, check_output
from adret.cogs import write
from adret.errors import InputError
from adret.parameters import (
    BounceParameters,
    HorizonParameters,
    LightParameters,
    OpennessParameters,
    Parameters,
    ShadowParameters,
    SkyViewParameters,
    Specification,
    SsaoParameters,
    ViewshedParameters,
    VisibilityParameters,
    specifications,
)
from adret.previews import preview
from adret.products import screens, sights, sky, sun
from adret.products.result import Progress, Result

if TYPE_CHECKING:
    from adret.screen import DepthBuffer
    from adret.terrain import Terrain

__all__ = ["PRODUCTS", "Product", "Result", "Specification", "run", "specifications"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """A kind of result.

    Attributes
    ----------
    name, title, description : str
        For the registry and for people.
    parameters : type
        Dataclass of its parameters; `specifications` lists them with limits.
    compute : callable
        compute(source, parameters, progress) -> Result.
    reads : str
        What the source is: a "terrain" or a "depth" buffer.
    """

    name: str
    title: str
    description: str
    parameters: type[Parameters]
    compute: Callable[[Any, Any, Progress | None], Result]
    reads: Literal["terrain", "depth"] = "terrain"


def run(
    product: Product,
    source: "Terrain | DepthBuffer",
    parameters: Parameters,
    out_path: PathLike,
    preview_path: PathLike | None = None,
    progress: Progress | None = None,
    *,
    overwrite: bool = True,
) -> None:
    """Compute a product and write it; the files appear whole or not at all.

    Parameters
    ----------
    product : Product
        One of `PRODUCTS`.
    source : Terrain or DepthBuffer
        What the product reads.
    parameters : Parameters
        Of the product's own class.
    out_path : path-like
        GeoTIFF to write.
    preview_path : path-like, optional
        PNG to write as well.
    progress : callable, optional
        Called as progress(done, total) between azimuths; an exception that it raises stops the
        run and leaves no file.
    overwrite : bool
        Whether files that exist may be replaced.

    Raises
    ------
    InputError
        If a parameter cannot be used with this terrain.
    RasterError
        If a file cannot be written where it is asked for.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from adret import Terrain
    >>> terrain = Terrain(np.zeros((8, 8)), (10, 10))
    >>> openness = PRODUCTS["openness"]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     run(openness, terrain, openness.parameters(directions=8), f"{folder}/openness.tif")
    """
    if not isinstance(parameters, product.parameters):
        raise InputError(
            "parameters", f"of class {product.parameters.__name__}", type(parameters).__name__
        )
    out = check_output(out_path, overwrite=overwrite)
    picture_path = None
    if preview_path is not None:
        picture_path = check_output(preview_path, field="preview", overwrite=overwrite)
        if picture_path == out:
            raise InputError("preview", "another file than out", str(preview_path))
    result = product.compute(source, parameters, progress)
    grid: Any = result.grid or source
    with atomic(out) as unfinished:
        write(
            unfinished,
            result.layers,
            grid,
            names=result.names,
            unit=result.unit,
            tags=result.tags,
            **result.encoding,
        )
        if picture_path is not None:
            preview(Path(picture_path), cell_size=grid.cell_size, **result.picture())


PRODUCTS: dict[str, Product] = {
    product.name: product
    for product in (
        Product(
            name="horizon",
            title="Horizon map",
            description="Elevation of the horizon for every cell and azimuth, in degrees.",
            parameters=HorizonParameters,
            compute=sky.horizon,
        ),
        Product(
            name="sky-view",
            title="Sky view",
            description="Share of the sky that each cell sees.",
            parameters=SkyViewParameters,
            compute=sky.sky_view,
        ),
        Product(
            name="openness",
            title="Openness",
            description="Mean angle between the vertical and the horizon, in degrees.",
            parameters=OpennessParameters,
            compute=sky.openness,
        ),
        Product(
            name="shadow",
            title="Shadow",
            description="Lit, self-shadowed and cast-shadowed ground for one position of the sun.",
            parameters=ShadowParameters,
            compute=sun.shadow,
        ),
        Product(
            name="light",
            title="Direct light",
            description="Light from sun and sky on every cell, as irradiance or radiance.",
            parameters=LightParameters,
            compute=sun.light,
        ),
        Product(
            name="bounce",
            title="Indirect light",
            description="Light that terrain reflects to the terrain that sees it.",
            parameters=BounceParameters,
            compute=sun.bounce,
        ),
        Product(
            name="viewshed",
            title="Viewshed",
            description="What one or many observers see, by exact lines of sight.",
            parameters=ViewshedParameters,
            compute=sights.viewshed,
        ),
        Product(
            name="visibility",
            title="Visibility",
            description="How much every cell sees: area, distance, number of samples.",
            parameters=VisibilityParameters,
            compute=sights.visibility,
        ),
        Product(
            name="ssao",
            title="Screen-space ambient occlusion",
            description="How much of the sky each pixel of a depth buffer does not see.",
            parameters=SsaoParameters,
            compute=screens.ssao,
            reads="depth",
        ),
    )
}
