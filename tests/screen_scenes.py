"""Scenes whose ambient occlusion is known in closed form, as depth images.

Everything is made by analytic intersection of rays with planes, boxes, spheres and cylinders in
float64, and shares no code with the library. World: (x, y, h), h up. A `Scene` knows its surface,
which points of it have a closed form, and the closed forms; `look` makes a depth image of it.

    view = look(step(1.1), "perspective", 160)
    camera = Camera.perspective(view.width, view.height, **view.lens)   # or orthographic
    buffer = DepthBuffer(view.depth, camera)                             # normals=view.normals
    rows, columns = view.receivers(12)                # spread over the receivers
    view.truth("cosine", rows, columns)               # W = 1; or falloff="hard", radius=2.0

`truth` raises KeyError where a scene has no closed form for what is asked.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

BIG = 1e9


@dataclass(frozen=True)
class Scene:
    """A surface and its known occlusion.

    `hit(origin, direction)` gives distance along the ray and the outer normal; both arguments are
    (3, n) arrays. `open_points` says where the closed forms hold. `forms` maps (weight, falloff)
    to a function of (points (3, n), radius or falloff scale).
    """

    name: str
    hit: Callable[..., tuple[np.ndarray, np.ndarray]]
    open_points: Callable[[np.ndarray, np.ndarray], np.ndarray]
    forms: dict[tuple[str, str], Callable[..., np.ndarray]]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    extent: float = 8.0
    stretch: float = 1.0
    """Height of a pixel in pixel widths: what is endless along y needs few rows."""
    lean: tuple[float, float] = (0.0, 0.0)
    """By how much the orthographic view, and the perspective one, lean to the left [radians]."""
    thickness: float = math.inf
    notes: str = ""


@dataclass(frozen=True)
class View:
    """A depth image of a scene. `lens` are the camera's numbers."""

    scene: Scene
    perspective: bool
    width: int
    height: int
    lens: dict[str, object]
    depth: np.ndarray  # (rows, columns), along the viewing axis
    points: np.ndarray  # (3, rows, columns), world
    normals: np.ndarray  # (3, rows, columns), view space (right, up, back)
    pixel: float  # side of a pixel at the scene's centre
    usable: np.ndarray = field(repr=False)

    def receivers(self, count: int, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of `count` pixels spread over those with closed forms."""
        rows, columns = np.nonzero(self.usable)
        if margin:
            middle = np.abs(rows - 0.5 * self.height) < (0.5 - margin) * self.height
            middle &= np.abs(columns - 0.5 * self.width) < (0.5 - margin) * self.width
            rows, columns = rows[middle], columns[middle]
        at = np.linspace(0, len(rows) - 1, min(count, len(rows))).round().astype(int)
        return rows[at], columns[at]

    def truth(
        self,
        weight: str,
        rows: np.ndarray,
        columns: np.ndarray,
        falloff: str = "none",
        size: float = math.inf,
    ) -> np.ndarray:
        """Closed form at pixels; `size` is the radius, or r of "timonen"."""
        form = self.scene.forms[weight, falloff]
        points = self.points[:, rows, columns]
        return form(points) if falloff == "none" else form(points, size)


def look(
    scene: Scene,
    projection: str,
    pixels: int,
    *,
    lean: float | None = None,
    pitch: float = 0.0,
    distance: float = 3.0,
    rows: int | None = None,
) -> View:
    """A depth image of `pixels` columns and as many rows, its middle at the scene's centre.

    `distance` of the perspective eye in units of the scene's extent; `lean` turns the eye about
    the world's y towards -x, `pitch` about its x towards -y [radians].
    """
    perspective = projection == "perspective"
    lean = scene.lean[perspective] if lean is None else lean
    height = rows or pixels
    back = np.array([-math.sin(lean), 0.0, math.cos(lean)])
    right = np.array([math.cos(lean), 0.0, math.sin(lean)])
    up = np.array([0.0, 1.0, 0.0])
    up, back = (
        math.cos(pitch) * up + math.sin(pitch) * back,
        math.cos(pitch) * back - math.sin(pitch) * up,
    )
    away = distance * scene.extent
    eye = np.array(scene.centre) + away * back
    row, column = np.mgrid[0:height, 0:pixels]
    across = (column + 0.5 - 0.5 * pixels).ravel()
    above = scene.stretch * (0.5 * height - row - 0.5).ravel()
    pixel = scene.extent / pixels
    if perspective:
        focal = away / pixel
        direction = np.outer(right, across / focal) + np.outer(up, above / focal) - back[:, None]
        origin = np.repeat(eye[:, None], across.size, axis=1)
        lens: dict[str, object] = {"fx": focal, "fy": focal / scene.stretch}
    else:
        direction = np.repeat(-back[:, None], across.size, axis=1)
        origin = eye[:, None] + np.outer(right, across * pixel) + np.outer(up, above * pixel)
        lens = {"extent": (pixels * pixel, height * pixel * scene.stretch)}
    t, normal = scene.hit(origin, direction)
    points = origin + t * direction
    depth = -(back @ (points - eye[:, None]))
    seen = np.stack([right @ normal, up @ normal, back @ normal])
    shape = (height, pixels)
    usable = scene.open_points(points, normal).reshape(shape)
    # A border pixel's normal is one-sided, which is right on these surfaces too; but leave it out.
    usable[[0, -1]] = False
    usable[:, [0, -1]] = False
    return View(
        scene=scene,
        perspective=perspective,
        width=pixels,
        height=height,
        lens=lens,
        depth=depth.reshape(shape),
        points=points.reshape(3, *shape),
        normals=seen.reshape(3, *shape),
        pixel=pixel,
        usable=usable,
    )


# --- Surfaces --------------------------------------------------------------------------------


def _nearest(*hits: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    t, normal = (each.copy() for each in hits[0])
    for other, other_normal in hits[1:]:
        nearer = other < t
        t[nearer] = other[nearer]
        normal[:, nearer] = other_normal[:, nearer]
    return t, normal


def _plane(o, d, normal, offset, keep=None):
    """Plane normal · p = offset, where `keep(points)` holds."""
    n = np.asarray(normal, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (offset - n @ o) / (n @ d)
        t = np.where((t > 0.0) & np.isfinite(t), t, np.inf)
        if keep is not None:
            t = np.where(keep(np.where(np.isfinite(t), o + t * d, 0.0)), t, np.inf)
    return t, np.repeat(n[:, None], o.shape[1], axis=1)


def _box(o, d, low, high):
    """Axis-parallel box from outside; limits may be ±BIG."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (np.asarray(low, dtype=float)[:, None] - o) / d
        last = (np.asarray(high, dtype=float)[:, None] - o) / d
    near, far = np.fmin(first, last), np.fmax(first, last)
    axis = near.argmax(axis=0)
    enter, leave = near.max(axis=0), far.min(axis=0)
    normal = np.zeros_like(o)
    each = np.arange(o.shape[1])
    normal[axis, each] = -np.sign(d[axis, each])
    return np.where((enter < leave) & (enter > 0.0), enter, np.inf), normal


def _floor(points, normal):
    return (np.abs(points[2]) < 1e-9) & (normal[2] > 0.5)


# --- What an occluder that is endless along y hides, seen from h = 0 in a plane's own frame -----


def _slot(low, high=None):
    """Elevations low..high on one side [radians]: cosine and uniform occlusion, W = 1."""
    if high is None:
        low, high = 0.0 * low, low
    return {
        "cosine": 0.5 * (np.cos(low) - np.cos(high)),
        "uniform": (high - low) / np.pi,
    }


def plane() -> Scene:
    """Flat ground: 0 whatever the tilt of the view and the falloff."""

    def zero(points, *_):
        return np.zeros(points.shape[1])

    forms = {
        (weight, falloff): zero
        for weight in ("cosine", "uniform")
        for falloff in ("none", "hard", "quadratic", "timonen")
    }
    return Scene(
        name="plane",
        hit=lambda o, d: _plane(o, d, (0, 0, 1), 0.0),
        open_points=_floor,
        forms={**forms, ("volumetric", "hard"): zero},
    )


def _beside(height, reach):
    """Floor with a block that fills x > 0 up to `height`; receivers within `reach` of it."""

    def hit(o, d):
        return _nearest(
            _plane(o, d, (0, 0, 1), 0.0, lambda p: p[0] < 0.0),
            _box(o, d, (0.0, -BIG, -BIG), (BIG, BIG, height)),
        )

    def receives(points, normal):
        near = (points[0] < -reach[0]) & (points[0] > -reach[1])
        return _floor(points, normal) & near & (np.abs(points[1]) < 1.0)

    return hit, receives


def step(height: float = 1.1, reach: tuple[float, float] = (0.5, 1.5)) -> Scene:
    """A step up at x = 0, endless along y: (1 - cos β)/2 and β/π with β = atan(H/a)."""
    hit, receives = _beside(height, reach)
    forms = {
        (weight, "none"): lambda p, w=weight: _slot(np.arctan(height / -p[0]))[w]
        for weight in ("cosine", "uniform")
    }
    return Scene("step", hit, receives, forms, extent=12.0, stretch=4.0)


def wall(height: float = 3.0, reach: tuple[float, float] = (0.5, 1.5)) -> Scene:
    """A wall, as high as a radius of up to `height` can tell: hard, quadratic, tangent sphere."""
    hit, receives = _beside(height, reach)

    def cut(points, radius):
        c = np.minimum(-points[0] / radius, 1.0)
        return c, np.sqrt(1.0 - c * c)

    def quadratic(points, radius):
        c, s = cut(points, radius)
        return ((1.0 + 2.0 * c * c) * np.arccos(c) - 3.0 * c * s) / np.pi

    def hard(points, radius):
        c, s = cut(points, radius)
        return (np.arccos(c) - c * s) / np.pi

    def sphere(points, radius):  # the tangent sphere's own radius is half of it
        c = np.minimum(-points[0] / (0.5 * radius), 1.0)
        return (1.0 - c) ** 2 * (2.0 + c) / 4.0

    return Scene(
        "wall",
        hit,
        receives,
        {
            ("cosine", "hard"): hard,
            ("uniform", "hard"): lambda p, radius: (1.0 - cut(p, radius)[0]) / 2.0,
            ("cosine", "quadratic"): quadratic,
            ("uniform", "quadratic"): lambda p, radius: (1.0 - cut(p, radius)[0]) ** 2 / 2.0,
            ("volumetric", "hard"): sphere,
        },
        extent=8.0,
        lean=(0.3, 0.2),
        notes="radius at most the height",
    )


def high_wall(height: float = 12.0, reach: tuple[float, float] = (0.4, 0.9)) -> Scene:
    """A wall high enough for W = r/(r + d²): what lies above it weighs under 4e-4 (r = 4)."""
    hit, receives = _beside(height, reach)

    def cosine(points, r):
        k = -points[0] / math.sqrt(r)
        return 0.5 + k * k - k * np.sqrt(1.0 + k * k)

    def uniform(points, r):
        k = -points[0] / math.sqrt(r)
        return 0.5 * (1.0 - k * np.arctan(1.0 / k))

    return Scene(
        "high wall",
        hit,
        receives,
        {("cosine", "timonen"): cosine, ("uniform", "timonen"): uniform},
        extent=20.0,
        stretch=2.0,
        lean=(0.3, 0.2),
        notes="falloff timonen, r about 4",
    )


def dihedral(angle: float = math.radians(120.0), length: float = 6.0) -> Scene:
    """Floor x < 0 and a face that rises from x = 0, interior angle 90° to 180° between them.

    The face is `length` long, so β falls short of its limit π - angle by what is given here.
    """
    top = (-length * math.cos(angle), length * math.sin(angle))
    normal = (-math.sin(angle), 0.0, -math.cos(angle))

    def hit(o, d):
        return _nearest(
            _plane(o, d, (0, 0, 1), 0.0, lambda p: p[0] < 0.0),
            _plane(o, d, normal, 0.0, lambda p: (p[0] >= 0.0) & (p[2] <= top[1]) & (p[2] >= 0.0)),
            _plane(o, d, (0, 0, 1), top[1], lambda p: p[0] > top[0] - 1e-12),
        )

    def beta(points):
        return np.arctan2(top[1], top[0] - points[0])

    return Scene(
        "dihedral",
        hit,
        lambda p, n: _floor(p, n) & (p[0] < -0.5) & (p[0] > -1.5) & (np.abs(p[1]) < 1.0),
        {
            (weight, "none"): lambda p, w=weight: _slot(beta(p))[w]
            for weight in ("cosine", "uniform")
        },
        extent=20.0,
        stretch=4.0,
    )


def trench(left: float = 1.0, right: float = 1.5, height: float = 1.2) -> Scene:
    """Floor between walls at x = -left and x = right, both `height` high and endless along y."""

    def hit(o, d):
        return _nearest(
            _plane(o, d, (0, 0, 1), 0.0),
            _box(o, d, (-BIG, -BIG, -BIG), (-left, BIG, height)),
            _box(o, d, (right, -BIG, -BIG), (BIG, BIG, height)),
        )

    def both(points, weight):
        first = _slot(np.arctan(height / (points[0] + left)))[weight]
        return first + _slot(np.arctan(height / (right - points[0])))[weight]

    return Scene(
        "trench",
        hit,
        lambda p, n: _floor(p, n) & (np.abs(p[0]) < 0.6) & (np.abs(p[1]) < 1.0),
        {(w, "none"): lambda p, w=w: both(p, w) for w in ("cosine", "uniform")},
        extent=10.0,
        stretch=4.0,
    )


def groove(slope: float = math.radians(40.0), half_width: float = 6.0) -> Scene:
    """A V-shaped valley along y; sin² slope and 2 slope/π at its bottom, less what the rim cuts."""
    rise = math.tan(slope)
    top = half_width * rise
    s, c = math.sin(slope), math.cos(slope)

    def hit(o, d):
        return _nearest(
            _plane(o, d, (-s, 0, c), 0.0, lambda p: (p[0] >= 0.0) & (p[0] <= half_width)),
            _plane(o, d, (s, 0, c), 0.0, lambda p: (p[0] < 0.0) & (p[0] >= -half_width)),
            _plane(o, d, (0, 0, 1), top, lambda p: np.abs(p[0]) > half_width - 1e-12),
        )

    def beta(points):
        # Seen from the right wall, the far rim is elevated above the wall's own plane by this.
        x = np.abs(points[0])
        return np.arctan2(top - points[2], half_width + x) + slope

    return Scene(
        "groove",
        hit,
        lambda p, n: (np.abs(p[0]) > 0.3) & (np.abs(p[0]) < 1.5) & (np.abs(p[1]) < 1.0),
        {
            (weight, "none"): lambda p, w=weight: _slot(beta(p))[w]
            for weight in ("cosine", "uniform")
        },
        extent=20.0,
        stretch=4.0,
    )


def corner(height: float = 8.0) -> Scene:
    """Two walls that meet at a right angle, and the floor: 3/4 far below their top.

    Exact for the height, by quadrature over azimuths.
    """

    def hit(o, d):
        return _nearest(
            _plane(o, d, (0, 0, 1), 0.0),
            _box(o, d, (0.0, -BIG, -BIG), (BIG, BIG, height)),
            _box(o, d, (-BIG, 0.0, -BIG), (BIG, BIG, height)),
        )

    nodes, weights = np.polynomial.legendre.leggauss(400)

    def occlusion(points, weight):
        result = np.zeros(points.shape[1])
        for k, (a, b) in enumerate(zip(-points[0], -points[1], strict=True)):
            # Azimuths from -90° to the corner belong to the first wall, the others to the second.
            split = math.atan2(b, a)
            for low, high, away in (
                (-0.5 * math.pi, split, a),
                (split - 0.5 * math.pi, 0.5 * math.pi, b),
            ):
                azimuth = 0.5 * (high - low) * nodes + 0.5 * (high + low)
                horizon = np.arctan(height / away * np.cos(azimuth))
                hidden = np.sin(horizon) ** (2 if weight == "cosine" else 1)
                result[k] += 0.5 * (high - low) * (weights @ hidden) / (2.0 * math.pi)
        return result

    def receives(points, normal):
        near = (points[:2] < -0.5).all(axis=0) & (points[:2] > -1.5).all(axis=0)
        return _floor(points, normal) & near

    return Scene(
        "corner",
        hit,
        receives,
        {(w, "none"): lambda p, w=w: occlusion(p, w) for w in ("cosine", "uniform")},
        centre=(-1.0, -1.0, 0.0),
        extent=48.0,
    )


def bowl(radius: float = 3.0, depth: float = 2.0) -> Scene:
    """A spherical bowl in flat ground: depth/(2 radius) at every point of it."""
    rim = math.sqrt(radius**2 - (radius - depth) ** 2)
    middle = np.array([0.0, 0.0, radius - depth])[:, None]

    def hit(o, d):
        to = o - middle
        a, b, c = (d * d).sum(0), (to * d).sum(0), (to * to).sum(0) - radius**2
        square = b * b - a * c
        with np.errstate(invalid="ignore"):
            t = (-b + np.sqrt(square)) / a
        point = o + t * d
        inside = (square > 0.0) & (point[2] <= 0.0)
        shell = np.where(inside, t, np.inf), (middle - point) / radius
        return _nearest(_plane(o, d, (0, 0, 1), 0.0, lambda p: np.hypot(p[0], p[1]) >= rim), shell)

    def bottom(points):
        return np.full(points.shape[1], math.sqrt(depth / (2.0 * radius)))

    return Scene(
        "bowl",
        hit,
        lambda p, n: (np.hypot(p[0], p[1]) < 0.8 * rim) & (p[2] < 0.0),
        {("cosine", "none"): lambda p: np.full(p.shape[1], depth / (2.0 * radius))},
        centre=(0.0, 0.0, 0.0),
        extent=3.0 * radius,
        notes=f"uniform at the bottom only: {bottom(np.zeros((3, 1)))[0]:.6f}",
    )


def well(radius: float = 1.0, depth: float = 1.3) -> Scene:
    """A round pit with upright walls: H²/(a² + H²) and H/√(a² + H²) at its bottom's centre."""

    def hit(o, d):
        a = d[0] ** 2 + d[1] ** 2
        b = o[0] * d[0] + o[1] * d[1]
        square = b * b - a * (o[0] ** 2 + o[1] ** 2 - radius**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            t = (-b + np.sqrt(square)) / a
        point = o + np.where(np.isfinite(t), t, 0.0) * d
        inside = (square > 0.0) & (a > 0.0) & (point[2] <= 0.0) & (point[2] > -depth)
        side = np.stack([-point[0], -point[1], 0.0 * point[0]]) / radius
        return _nearest(
            _plane(o, d, (0, 0, 1), -depth),
            _plane(o, d, (0, 0, 1), 0.0, lambda p: np.hypot(p[0], p[1]) >= radius),
            (np.where(inside, t, np.inf), side),
        )

    ratio = depth / math.hypot(radius, depth)
    return Scene(
        "well",
        hit,
        lambda p, n: (np.hypot(p[0], p[1]) < 0.06) & (p[2] < -0.5 * depth),
        {
            ("cosine", "none"): lambda p: np.full(p.shape[1], ratio**2),
            ("uniform", "none"): lambda p: np.full(p.shape[1], ratio),
        },
        extent=4.0 * radius,
        notes="at the centre; receivers within 0.06 of it differ by under 0.002",
    )


def bar(
    top: float = 1.5,
    width: float = 0.8,
    thick: float = 0.4,
    reach: tuple[float, float] = (0.5, 1.2),
) -> Scene:
    """A bar over the floor, from x = 0 to `width`, endless along y, `thick` deep below its top.

    What is hidden beneath it cannot be seen from above; G_t with that thickness is its truth.
    """

    def hit(o, d):
        return _nearest(
            _plane(o, d, (0, 0, 1), 0.0),
            _box(o, d, (0.0, -BIG, top - thick), (width, BIG, top)),
        )

    def form(points, weight):
        low = np.arctan((top - thick) / (width - points[0]))
        return _slot(low, np.arctan(top / -points[0]))[weight]

    def receives(points, normal):
        near = (points[0] < -reach[0]) & (points[0] > -reach[1])
        return _floor(points, normal) & near & (np.abs(points[1]) < 1.0)

    return Scene(
        "bar",
        hit,
        receives,
        {(w, "none"): lambda p, w=w: form(p, w) for w in ("cosine", "uniform")},
        extent=10.0,
        stretch=4.0,
        thickness=thick,
        notes="the closed form holds for views from straight above",
    )


SCENES: dict[str, Callable[[], Scene]] = {
    "plane": plane,
    "step": step,
    "wall": wall,
    "high wall": high_wall,
    "dihedral": dihedral,
    "trench": trench,
    "groove": groove,
    "corner": corner,
    "bowl": bowl,
    "well": well,
    "bar": bar,
}
