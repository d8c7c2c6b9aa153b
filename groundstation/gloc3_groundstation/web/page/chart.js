// The map's picture on a canvas: tiles or a grid, mission, fences, trails, vehicles; moved and zoomed by mouse and fingers.

import { Plane, cornerOf, tileOf, zoomFor } from "./geo.js";

const COLOURS = ["#58a6ff", "#f778ba", "#f0b72f", "#4ae168", "#d2a8ff", "#ff9b6a", "#7ee0e0", "#c9d1d9"];
const FINEST = 0.005, COARSEST = 500; // metres a pixel
const TILES_AT_ONCE = 12, TILES_KEPT = 300;
const TAP_PX = 8;
const MARGIN_PX = 50;

export const colourOf = (number) => COLOURS[number % COLOURS.length];

export class Chart {
  #canvas; #pen; #view = { north: 0, east: 0, scale: 0.2 }; #plane = null; #tiles = null; #loaded = new Map(); #loading = 0;
  #pointers = new Map(); #moved = 0; #pinch = null; #isDrawing = false; #isFitting = true;

  /** @param canvas where it is drawn. @param onTap called with north and east of a tapped place. @param onMove after a move by hand. */
  constructor(canvas, onTap, onMove) {
    this.#canvas = canvas;
    this.#pen = canvas.getContext("2d");
    this.onTap = onTap;
    this.onMove = onMove;
    this.picture = null; // of the server
    this.plan = null;
    this.trails = new Map(); // name to places, null for a gap
    this.mark = null; // [north, east] that was tapped
    this.attribution = "";
    new ResizeObserver(() => this.#resize()).observe(canvas);
    for (const [kind, handle] of Object.entries({
      pointerdown: this.#down, pointermove: this.#move, pointerup: this.#up, pointercancel: this.#up, wheel: this.#wheel,
    })) canvas.addEventListener(kind, handle.bind(this), { passive: false });
  }

  /** Uses the station's tiles: {least_zoom, most_zoom, attribution}; null for none. */
  set tiles(info) { this.#tiles = info; this.attribution = info?.attribution ?? ""; this.draw(); }

  /** The plane on Earth; null where it is unknown. */
  get plane() { return this.#plane; }

  set origin(origin) {
    const is = origin ? origin.join() : "";
    if (is !== (this.#plane?.origin.join() ?? "")) this.#plane = origin ? new Plane(origin) : null;
  }

  fit() { this.#isFitting = true; this.draw(); }
  zoom(steps) { this.#scaleAt(this.#width / 2, this.#height / 2, 2 ** (-steps / 2)); }
  centre([north, east]) { this.#isFitting = false; Object.assign(this.#view, { north, east }); this.draw(); }

  /** Draws with the next frame. */
  draw() {
    if (this.#isDrawing) return;
    this.#isDrawing = true;
    requestAnimationFrame(() => { this.#isDrawing = false; this.#paint(); });
  }

  // --- place and picture ---

  get #width() { return this.#canvas.clientWidth; }
  get #height() { return this.#canvas.clientHeight; }
  #xy([north, east]) {
    const { north: n, east: e, scale } = this.#view;
    return [this.#width / 2 + (east - e) / scale, this.#height / 2 - (north - n) / scale];
  }
  #placeOf(x, y) {
    const { north, east, scale } = this.#view;
    return [north + (this.#height / 2 - y) * scale, east + (x - this.#width / 2) * scale];
  }
  #scaleAt(x, y, factor) {
    const [north, east] = this.#placeOf(x, y);
    const scale = Math.min(COARSEST, Math.max(FINEST, this.#view.scale * factor));
    this.#isFitting = false;
    this.#view = { scale, north: north - (this.#height / 2 - y) * scale, east: east - (x - this.#width / 2) * scale };
    this.onMove();
    this.draw();
  }

  #resize() {
    const dots = devicePixelRatio || 1;
    [this.#canvas.width, this.#canvas.height] = [Math.round(this.#width * dots), Math.round(this.#height * dots)];
    this.draw();
  }

  #fitAll() {
    const { vehicles = [] } = this.picture ?? {};
    const plan = this.plan ?? { fence: [], paths: [], home: null };
    const places = [...vehicles.map(({ place }) => place), plan.home, ...plan.fence, ...plan.paths.flatMap(({ points }) => points)]
      .filter(Boolean);
    if (!places.length) return;
    const [norths, easts] = [0, 1].map((axis) => places.map((place) => place[axis]));
    const low = (values) => values.reduce((a, b) => Math.min(a, b)), high = (values) => values.reduce((a, b) => Math.max(a, b));
    const across = high(easts) - low(easts), down = high(norths) - low(norths);
    const room = (px) => Math.max(50, px - 2 * MARGIN_PX);
    this.#view = {
      north: (high(norths) + low(norths)) / 2, east: (high(easts) + low(easts)) / 2,
      scale: Math.min(COARSEST, Math.max(0.02, across / room(this.#width), down / room(this.#height))),
    };
  }

  // --- hands ---

  #down(event) {
    event.preventDefault();
    this.#canvas.setPointerCapture(event.pointerId);
    if (!this.#pointers.size) this.#moved = 0;
    this.#pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.#pinch = null;
  }

  #move(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    this.#pointers.set(event.pointerId, now);
    const held = [...this.#pointers.values()];
    if (held.length === 2) {
      const [[ax, ay], [bx, by]] = held;
      const pinch = { x: (ax + bx) / 2, y: (ay + by) / 2, wide: Math.hypot(ax - bx, ay - by) || 1 };
      if (this.#pinch) {
        this.#pan(pinch.x - this.#pinch.x, pinch.y - this.#pinch.y);
        this.#scaleAt(pinch.x, pinch.y, this.#pinch.wide / pinch.wide);
      }
      this.#pinch = pinch;
      this.#moved = Infinity;
      return;
    }
    this.#moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (this.#moved > TAP_PX) this.#pan(now[0] - before[0], now[1] - before[1]);
  }

  #pan(right, down) {
    this.#isFitting = false;
    this.#view.north += down * this.#view.scale;
    this.#view.east -= right * this.#view.scale;
    this.onMove();
    this.draw();
  }

  #up(event) {
    const isTap = this.#pointers.size === 1 && this.#moved <= TAP_PX && event.type === "pointerup";
    if (this.#pointers.delete(event.pointerId) && isTap) this.onTap(this.#placeOf(event.offsetX, event.offsetY));
    this.#pinch = null;
  }

  #wheel(event) {
    event.preventDefault();
    this.#scaleAt(event.offsetX, event.offsetY, 2 ** (Math.sign(event.deltaY) / 3));
  }

  // --- paint ---

  #paint() {
    if (this.#isFitting) this.#fitAll();
    const pen = this.#pen, dots = devicePixelRatio || 1;
    pen.setTransform(dots, 0, 0, dots, 0, 0);
    pen.fillStyle = "#0c1116";
    pen.fillRect(0, 0, this.#width, this.#height);
    if (!this.#paintTiles()) this.#paintGrid();
    if (this.plan) this.#paintPlan(this.plan);
    for (const vehicle of this.picture?.vehicles ?? []) this.#paintTrail(vehicle);
    for (const vehicle of this.picture?.vehicles ?? []) this.#paintVehicle(vehicle);
    if (this.mark) this.#cross(this.mark, "#fff", 9);
    this.#paintFrame();
  }

  /** Draws the tiles that are here and requests the others; returns whether there are any. */
  #paintTiles() {
    if (!this.#tiles || !this.#plane) return false;
    const [latitude] = this.#plane.origin;
    const wanted = Math.round(zoomFor(this.#view.scale / Math.min(devicePixelRatio || 1, 2), latitude));
    const zoom = Math.max(this.#tiles.least_zoom, Math.min(this.#tiles.most_zoom, wanted));
    if (wanted < this.#tiles.least_zoom - 3) return false;
    const corners = [[0, 0], [this.#width, 0], [0, this.#height], [this.#width, this.#height]]
      .map(([x, y]) => tileOf(...this.#plane.toGeo(...this.#placeOf(x, y)), zoom));
    const [columns, rows] = [0, 1].map((axis) => corners.map((corner) => Math.floor(corner[axis])));
    const wide = Math.max(...columns) - Math.min(...columns), tall = Math.max(...rows) - Math.min(...rows);
    if (!(wide * tall < 400)) return false;
    this.#pen.globalAlpha = 0.75; // so that what is drawn on it stands out
    for (let column = Math.min(...columns); column <= Math.max(...columns); column++)
      for (let row = Math.min(...rows); row <= Math.max(...rows); row++) this.#paintTile(zoom, column, row);
    this.#pen.globalAlpha = 1;
    return true;
  }

  #paintTile(zoom, column, row) {
    if (column < 0 || row < 0 || column >= 2 ** zoom || row >= 2 ** zoom) return;
    const corner = (c, r) => this.#xy(this.#plane.fromGeo(...cornerOf(zoom, c, r)));
    const [x, y] = corner(column, row);
    const image = this.#tile(zoom, column, row);
    if (image) {
      const [right, along] = corner(column + 1, row), [left, down] = corner(column, row + 1);
      const pen = this.#pen;
      pen.save();
      pen.transform((right - x) / image.width, (along - y) / image.width, (left - x) / image.height, (down - y) / image.height, x, y);
      pen.drawImage(image, 0, 0, image.width + 0.5, image.height + 0.5);
      pen.restore();
    }
  }

  #tile(zoom, column, row) {
    const key = `${zoom}/${column}/${row}`;
    const known = this.#loaded.get(key);
    if (known !== undefined) {
      this.#loaded.delete(key);
      this.#loaded.set(key, known);
      return known;
    }
    if (this.#loading >= TILES_AT_ONCE) return null;
    this.#loading++;
    this.#loaded.set(key, null);
    fetch(`tiles/${key}`)
      .then(async (reply) => this.#loaded.set(key, reply.ok ? await createImageBitmap(await reply.blob()) : null))
      .catch(() => this.#loaded.delete(key))
      .finally(() => {
        this.#loading--;
        while (this.#loaded.size > TILES_KEPT) this.#loaded.delete(this.#loaded.keys().next().value);
        this.draw();
      });
    return null;
  }

  #paintGrid() {
    const step = roundLength(this.#view.scale * 120), pen = this.#pen;
    const [north, west] = this.#placeOf(0, 0), [south, east] = this.#placeOf(this.#width, this.#height);
    pen.lineWidth = 1;
    for (let at = Math.ceil(west / step) * step; at <= east; at += step) this.#line([[north, at], [south, at]], Math.abs(at) < step / 2 ? "#3d4752" : "#1c242c");
    for (let at = Math.ceil(south / step) * step; at <= north; at += step) this.#line([[at, west], [at, east]], Math.abs(at) < step / 2 ? "#3d4752" : "#1c242c");
  }

  #paintPlan({ fence, keep_out: keepOut, paths, waypoints, home, is_loaded: isLoaded }) {
    const pen = this.#pen;
    pen.lineWidth = 2;
    for (const area of keepOut) {
      this.#line(area, "#ff6a69");
      pen.fillStyle = "#ff6a6933";
      pen.fill();
    }
    this.#line(fence, "#f0b72f");
    for (const { points, is_over: isOver } of paths) {
      pen.setLineDash(isOver || !isLoaded ? [2, 6] : [8, 5]);
      this.#line(points, isOver || !isLoaded ? "#9ea7b1" : "#f0f3f6");
    }
    pen.setLineDash([]);
    pen.font = "12px 'Roboto Mono', monospace";
    pen.textAlign = "center";
    let last = null;
    waypoints.forEach((place, index) => {
      const [x, y] = this.#xy(place);
      if (last && Math.hypot(x - last[0], y - last[1]) < 18) return;
      last = [x, y];
      this.#label(String(index + 1), x, y - 6, "#f0f3f6");
    });
    if (home) this.#label("⌂", ...this.#xy(home).map((value, axis) => value + 7 * axis), "#4ae168", 20);
  }

  #paintTrail({ name, number }) {
    const pen = this.#pen;
    pen.lineWidth = 2;
    const places = this.trails.get(name) ?? [];
    pen.beginPath();
    let isDown = false;
    for (const place of places) {
      if (place) pen[isDown ? "lineTo" : "moveTo"](...this.#xy(place));
      isDown = Boolean(place);
    }
    pen.strokeStyle = colourOf(number);
    pen.stroke();
  }

  #paintVehicle({ name, number, place, heading_deg: heading, wanted, is_stale: isStale }) {
    if (!place) return;
    const pen = this.#pen, [x, y] = this.#xy(place), isSelected = name === this.picture.selected;
    if (isSelected && wanted && !isStale) this.#cross(wanted, "#f0f3f6", 5);
    pen.save();
    pen.translate(x, y);
    pen.rotate((heading * Math.PI) / 180);
    pen.beginPath();
    for (const [right, up] of [[0, 14], [9, -10], [0, -5], [-9, -10]]) pen.lineTo(right, -up);
    pen.closePath();
    pen.fillStyle = isStale ? "#56616d" : colourOf(number);
    pen.fill();
    pen.lineWidth = isSelected ? 2.5 : 1;
    pen.strokeStyle = isSelected ? "#fff" : "#0c1116";
    pen.stroke();
    pen.restore();
    pen.textAlign = "left";
    this.#label(isStale ? `${name} ?` : name, x + 14, y - 10, isStale ? "#9ea7b1" : "#fff", isSelected ? 14 : 12);
  }

  #paintFrame() {
    const pen = this.#pen, length = roundLength(this.#view.scale * 140), px = length / this.#view.scale;
    pen.lineWidth = 2;
    pen.strokeStyle = "#f0f3f6";
    pen.beginPath();
    for (const [x, y] of [[12, -18], [12, -12], [12 + px, -12], [12 + px, -18]]) pen.lineTo(x, this.#height + y);
    pen.stroke();
    pen.textAlign = "left";
    this.#label(lengthText(length), 16, this.#height - 18, "#f0f3f6");
    pen.textAlign = "right";
    if (this.attribution && this.#plane) this.#label(this.attribution, this.#width - 6, this.#height - 6, "#c9d1d9", 11);
    this.#label(this.picture && !this.picture.has_north ? "x up" : "N up", this.#width - 12, 24, "#f0f3f6", 16);
  }

  #line(places, colour) {
    const pen = this.#pen;
    pen.beginPath();
    for (const place of places) pen.lineTo(...this.#xy(place));
    pen.strokeStyle = colour;
    pen.stroke();
  }

  #cross(place, colour, size) {
    const [x, y] = this.#xy(place), pen = this.#pen;
    pen.lineWidth = 2;
    pen.strokeStyle = colour;
    pen.beginPath();
    for (const [dx, dy] of [[-size, -size], [size, size], null, [-size, size], [size, -size]].map((at) => at ?? [NaN]))
      if (Number.isNaN(dx)) pen.moveTo(x - size, y + size); else pen.lineTo(x + dx, y + dy);
    pen.stroke();
  }

  #label(text, x, y, colour, size = 12) {
    const pen = this.#pen;
    pen.font = `${size}px 'Roboto Mono', monospace`;
    pen.lineWidth = 3;
    pen.strokeStyle = "#0c1116";
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }
}

/** The longest of 1, 2, 5, 10, 20, 50 … that is no longer. */
function roundLength(most) {
  const decade = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((step) => step * decade).find((length) => length <= most * (1 + 1e-9)) ?? decade;
}

export function lengthText(metres) {
  return metres >= 1000 ? `${+(metres / 1000).toPrecision(3)} km` : metres >= 1 ? `${+metres.toPrecision(3)} m` : `${Math.round(metres * 100)} cm`;
}
