"""The map page: one HTML document with its own script, which asks no other host for anything."""

import base64
import hashlib

__all__ = ["PAGE", "SECURITY"]

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>Adret</title>
<style>
  html, body { margin: 0; height: 100%; font: 13px system-ui, sans-serif; background: #e4e2dd }
  #map { position: absolute; inset: 0; overflow: hidden; touch-action: none; cursor: grab }
  #map img { position: absolute; image-rendering: pixelated; user-select: none;
             pointer-events: none }
  #panel { position: absolute; top: 8px; left: 8px; padding: 6px 8px; background: #fffd;
           border-radius: 4px }
  #said { position: absolute; bottom: 8px; left: 8px; padding: 3px 6px; background: #fffd;
          border-radius: 4px }
  button, select { font: inherit }
</style>
<div id="map"></div>
<div id="panel"><button id="in">+</button> <button id="out">−</button>
<select id="band" title="band"></select>
<select id="colours" title="colours"><option value="">grey</option><option>viridis</option>
<option>terrain</option><option>magma</option><option>cividis</option><option>rdylbu_r</option>
</select></div>
<div id="said">…</div>
<script>
"use strict";
const SIDE = 256, map = document.getElementById("map"), said = document.getElementById("said");
const colours = document.getElementById("colours"), band = document.getElementById("band");
const token = new URLSearchParams(location.search).get("token");
let grid, zoom, x = 0, y = 0, tiles = new Map();   // x, y: middle of the view in pixels at `zoom`

function project(lon, lat, z) {
  const n = SIDE * 2 ** z, s = Math.sin(lat * Math.PI / 180);
  return [n * (lon + 180) / 360, n * (0.5 - Math.log((1 + s) / (1 - s)) / (4 * Math.PI))];
}
function unproject(px, py, z) {
  const n = SIDE * 2 ** z;
  return [360 * px / n - 180, 180 / Math.PI * Math.atan(Math.sinh(Math.PI * (1 - 2 * py / n)))];
}
const onEarth = () => grid.grid === "WebMercatorQuad";
function address(z, tx, ty) {
  const query = new URLSearchParams({bidx: band.value});
  if (colours.value) query.set("colormap_name", colours.value);
  if (token) query.set("token", token);
  return `tiles/${z}/${tx}/${ty}.png?${query}`;
}
function draw() {
  const wide = map.clientWidth, high = map.clientHeight, left = x - wide / 2, top = y - high / 2;
  const wanted = new Set(), most = 2 ** zoom;
  for (let ty = Math.floor(top / SIDE); ty * SIDE < top + high; ty++)
    for (let tx = Math.floor(left / SIDE); tx * SIDE < left + wide; tx++) {
      if (tx < 0 || ty < 0 || tx >= most || ty >= most) continue;
      const source = address(zoom, tx, ty);
      wanted.add(source);
      let tile = tiles.get(source);
      if (!tile) {
        tile = new Image(SIDE, SIDE);
        tile.onerror = () => { tile.style.visibility = "hidden" };
        tile.src = source;
        tiles.set(source, tile);
        map.append(tile);
      }
      tile.style.transform =
        `translate(${Math.round(tx * SIDE - left)}px, ${Math.round(ty * SIDE - top)}px)`;
    }
  for (const [source, tile] of tiles)
    if (!wanted.has(source)) { tile.remove(); tiles.delete(source) }
}
function zoomTo(z, px = map.clientWidth / 2, py = map.clientHeight / 2) {
  z = Math.max(0, Math.min(onEarth() ? 22 : grid.maxzoom + 3, z));
  const factor = 2 ** (z - zoom), dx = px - map.clientWidth / 2, dy = py - map.clientHeight / 2;
  x = (x + dx) * factor - dx; y = (y + dy) * factor - dy; zoom = z;
  draw();
}
let grip = null, moved = 0;
map.onpointerdown = e => { grip = [e.clientX, e.clientY]; moved = 0;
                           map.setPointerCapture(e.pointerId) };
map.onpointermove = e => {
  if (!grip) return;
  x -= e.clientX - grip[0]; y -= e.clientY - grip[1];
  moved += Math.abs(e.clientX - grip[0]) + Math.abs(e.clientY - grip[1]);
  grip = [e.clientX, e.clientY];
  draw();
};
map.onpointerup = async e => {
  grip = null;
  if (moved > 4 || !onEarth()) return;
  const [lon, lat] = unproject(x + e.clientX - map.clientWidth / 2,
                               y + e.clientY - map.clientHeight / 2, zoom);
  const place = `${lat.toFixed(5)}, ${lon.toFixed(5)}`;
  const answer = await fetch(`point?lon=${lon}&lat=${lat}&bidx=${band.value}${
    token ? "&token=" + token : ""}`);
  const body = await answer.json();
  said.textContent = answer.ok ? `${place}: ${body.values[0] ?? "no data"} ${body.unit ?? ""}`
                               : `${place}: outside`;
};
map.onwheel = e => { e.preventDefault(); zoomTo(zoom - Math.sign(e.deltaY), e.clientX, e.clientY) };
document.getElementById("in").onclick = () => zoomTo(zoom + 1);
document.getElementById("out").onclick = () => zoomTo(zoom - 1);
band.onchange = colours.onchange = () => draw();
addEventListener("resize", draw);
fetch(token ? `tilejson.json?token=${token}` : "tilejson.json").then(a => a.json()).then(found => {
  grid = found;
  for (const [i, name] of grid.bands.entries()) band.append(new Option(name, i + 1));
  const [west, south, east, north] = grid.bounds;
  const corners = z => onEarth() ? [project(west, north, z), project(east, south, z)]
    : [[0, 0], [east, north].map(cells => cells / 2 ** (grid.maxzoom - z))];
  const fits = z => { const [a, b] = corners(z);
    return b[0] - a[0] <= map.clientWidth && b[1] - a[1] <= map.clientHeight };
  zoom = grid.maxzoom;
  while (zoom > 0 && !fits(zoom)) zoom--;
  const [a, b] = corners(zoom);
  x = (a[0] + b[0]) / 2; y = (a[1] + b[1]) / 2;
  said.textContent = onEarth() ? "click for the value" : "";
  draw();
});
</script>
</html>
"""


def _allowed(tag: str) -> str:
    """Return the digest by which a policy knows the one element of that name in the page."""
    inside = PAGE.split(f"<{tag}>")[1].split(f"</{tag}>")[0]
    return f"'sha256-{base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()}'"


SECURITY = (
    "default-src 'none'; img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    f"frame-ancestors 'self'; style-src {_allowed('style')}; script-src {_allowed('script')}"
)
