// Places on Earth, on the map's plane (metres north and east of an origin), and in the tiles of Web Mercator.

const RADIUS_M = 6378137.0; // WGS 84
const FLATTENING = 1 / 298.257223563;
const ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING);
const { PI, sin, cos, tan, atan2, sinh, asinh, hypot } = Math;
const rad = (degrees) => (degrees * PI) / 180;
const deg = (radians) => (radians * 180) / PI;

function ecef([latitude, longitude, altitude]) {
  const [lat, lon] = [rad(latitude), rad(longitude)];
  const across = RADIUS_M / Math.sqrt(1 - ECCENTRICITY_2 * sin(lat) ** 2);
  return [
    (across + altitude) * cos(lat) * cos(lon),
    (across + altitude) * cos(lat) * sin(lon),
    (across * (1 - ECCENTRICITY_2) + altitude) * sin(lat),
  ];
}

/** The plane that touches the Earth at an origin [latitude, longitude, altitude]. */
export class Plane {
  #at; #lat; #lon;

  constructor(origin) {
    this.origin = origin;
    this.#at = ecef(origin);
    [this.#lat, this.#lon] = [rad(origin[0]), rad(origin[1])];
  }

  /** Metres north and east of a latitude and longitude at the origin's altitude. */
  fromGeo(latitude, longitude) {
    const [x, y, z] = ecef([latitude, longitude, this.origin[2]]).map((value, axis) => value - this.#at[axis]);
    const outward = x * cos(this.#lon) + y * sin(this.#lon);
    return [z * cos(this.#lat) - outward * sin(this.#lat), y * cos(this.#lon) - x * sin(this.#lon)];
  }

  /** Latitude and longitude of metres north and east; exact to a millimetre within 100 km. */
  toGeo(north, east) {
    const outward = -north * sin(this.#lat);
    const x = this.#at[0] + outward * cos(this.#lon) - east * sin(this.#lon);
    const y = this.#at[1] + outward * sin(this.#lon) + east * cos(this.#lon);
    const z = this.#at[2] + north * cos(this.#lat);
    const axis = hypot(x, y);
    let latitude = atan2(z, axis * (1 - ECCENTRICITY_2));
    for (let step = 0; step < 5; step++) {
      const across = RADIUS_M / Math.sqrt(1 - ECCENTRICITY_2 * sin(latitude) ** 2);
      latitude = atan2(z + ECCENTRICITY_2 * across * sin(latitude), axis);
    }
    return [deg(latitude), deg(atan2(y, x))];
  }
}

/** Column and row, with fractions, of a place at a zoom. */
export function tileOf(latitude, longitude, zoom) {
  const size = 2 ** zoom;
  return [((longitude + 180) / 360) * size, ((1 - asinh(tan(rad(latitude))) / PI) / 2) * size];
}

/** Latitude and longitude of the north-west corner of a tile. */
export function cornerOf(zoom, column, row) {
  const size = 2 ** zoom;
  return [deg(Math.atan(sinh(PI * (1 - (2 * row) / size)))), (column / size) * 360 - 180];
}

/** The zoom whose tiles have about this many metres a pixel at a latitude. */
export function zoomFor(metresPerPixel, latitude) {
  return Math.log2((2 * PI * RADIUS_M * cos(rad(latitude))) / (256 * metresPerPixel));
}

/** Distance in metres and bearing in degrees from one place to another, on the plane. */
export function away([north, east], [toNorth, toEast]) {
  return [hypot(toNorth - north, toEast - east), (deg(atan2(toEast - east, toNorth - north)) + 360) % 360];
}
